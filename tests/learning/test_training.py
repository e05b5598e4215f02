"""Training: the same weights by the same seed, whatever stopped it; that it learns, and stops; what it refuses."""

import hashlib
import json
import math
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from other_runs import held_by_another_run
from safetensors.torch import load_file, save_file
from tiny_training import config, lesson, weights
from viewpoint_sets import collect, small

from gvp_lib.errors import CheckpointError, DatasetError, InvalidParameterError, TrainingDivergedError
from gvp_lib.learning import training
from gvp_lib.learning.checkpoints import load_trained, save_trained, write_tensors
from gvp_lib.learning.config import OBJECTIVES
from gvp_lib.learning.resnet import ResNet
from gvp_lib.learning.training import check_loss, check_sets, evaluate, make_optimizer, train, train_epoch

pytestmark = pytest.mark.usefixtures("tiny")


@pytest.fixture(scope="module")
def straight(lessons, tmp_path_factory):
    """Two epochs at one go, without the module's patches: the tiny network is put in and taken out here."""
    from tiny_training import TINY

    from gvp_lib.learning.resnet import NETWORKS

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(NETWORKS, "tiny", TINY)
        threads = torch.get_num_threads()
        torch.set_num_threads(1)
        done = lesson(lessons, tmp_path_factory.mktemp("straight"))
        torch.set_num_threads(threads)
    return done


def stop_after(epochs):
    def on_epoch(line):
        if line["epoch"] == epochs:
            raise KeyboardInterrupt

    return on_epoch


def test_the_same_seed_gives_the_same_weights_to_the_bit_and_another_seed_others(lessons, straight, tmp_path):
    lesson(lessons, tmp_path / "again")
    assert weights(tmp_path / "again") == weights(straight.folder)
    other = lesson(lessons, tmp_path / "other", seed=1)
    assert not torch.equal(other.trained.network.conv1.weight, straight.trained.network.conv1.weight)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"optimizer": "adamw", "schedule": "one cycle", "turns": True},
        pytest.param({"momentum": 0.0}, marks=pytest.mark.full),
    ],
)
def test_a_training_that_is_taken_up_ends_at_the_weights_of_one_that_was_not_stopped(options, lessons, tmp_path):
    whole = lesson(lessons, tmp_path / "whole", **options)
    with pytest.raises(KeyboardInterrupt):
        train(lessons, tmp_path / "cut", config(**options), device="cpu", progress=False, on_epoch=stop_after(1))
    again = lesson(lessons, tmp_path / "cut", **options)
    assert (whole.epochs, again.epochs, len(again.history)) == (2, 1, 2)
    assert weights(tmp_path / "cut") == weights(tmp_path / "whole")


def test_an_optimizer_goes_through_the_networks_own_memory_in_the_order_in_which_it_lies(lessons, tmp_path):
    lesson(lessons, tmp_path, epochs=1)
    run = training._Run([lessons], tmp_path, config(epochs=1), "cpu", {})
    assert run.resume()
    own, views = list(run.network.parameters()), run.optimizer.param_groups[0]["params"]
    assert any(not parameter.is_contiguous() for parameter in own)
    for parameter, view in zip(own, views, strict=True):
        assert view.is_contiguous()
        assert view.data_ptr() == parameter.data_ptr()
        assert run.optimizer.state[view]["momentum_buffer"].shape == view.shape


@pytest.mark.parametrize("name", ["sgd", "adamw"])
def test_a_step_is_the_optimizers_that_knows_nothing_of_memory(name):
    options = {"lr": 0.01, "foreach": False, "fused": False}
    plain = {
        "sgd": lambda parameters: torch.optim.SGD(parameters, momentum=0.9, **options),
        "adamw": lambda parameters: torch.optim.AdamW(parameters, weight_decay=0.1, **options),
    }[name]
    chosen = config(optimizer=name, learning_rate=0.01, weight_decay=0.0 if name == "sgd" else 0.1)
    stepped = []
    for make in (plain, None):
        torch.manual_seed(0)
        network = ResNet("tiny").to(memory_format=torch.channels_last)
        optimizer = make_optimizer(network, chosen) if make is None else make(network.parameters())
        for _ in range(3):
            for parameter in network.parameters():
                parameter.grad = torch.randn_like(parameter)
            optimizer.step()
        stepped.append([parameter.detach().clone() for parameter in network.parameters()])
    for expected, got in zip(*stepped, strict=True):
        torch.testing.assert_close(got, expected, rtol=1e-5, atol=1e-6)
    assert all(view.grad is None for group in optimizer.param_groups for view in group["params"])


_KILLED = """
import os, signal, sys
sys.path.insert(0, sys.argv[3])
import torch
from tiny_training import TINY, lesson
patience = int(sys.argv[4]) or None
from gvp_lib.learning.dataset import ViewpointDataset
from gvp_lib.learning.resnet import NETWORKS
NETWORKS["tiny"] = TINY
torch.set_num_threads(1)
batch = ViewpointDataset.batch
def last_batch(self, indices):
    if self.split == "train" and self.epoch == 1 and 40 in indices:  # somewhere in the second epoch
        os.kill(os.getpid(), signal.SIGKILL)
    return batch(self, indices)
ViewpointDataset.batch = last_batch
lesson(sys.argv[1], sys.argv[2], patience=patience, epochs=4 if patience else 2)
"""


@pytest.mark.full
@pytest.mark.parametrize("patience", [None, 1])
def test_a_training_killed_in_the_middle_of_an_epoch_ends_at_the_same_bytes(patience, lessons, straight, tmp_path):
    tests, killed = Path(__file__).parents[1], tmp_path / "killed"
    run = subprocess.run(
        [sys.executable, "-c", _KILLED, str(lessons), str(killed), str(tests), str(patience or 0)],
        capture_output=True,
        text=True,
    )
    assert run.returncode == -signal.SIGKILL, run.stderr
    assert len(json.loads((killed / "history.json").read_text())) == 1
    options = {"patience": patience, "epochs": 4} if patience else {}
    whole = lesson(lessons, tmp_path / "whole", **options) if patience else straight
    again = lesson(lessons, killed, **options)
    assert (again.epochs, len(again.history)) == (len(whole.history) - 1, len(whole.history))
    assert weights(killed) == weights(whole.folder)


def test_a_training_killed_between_its_weights_and_its_state_repeats_the_epoch(
    lessons, straight, tmp_path, monkeypatch
):
    with monkeypatch.context() as patch:

        def killed(path, *rest):
            if "state" in made:
                raise KeyboardInterrupt
            made.append("state")
            write_tensors(path, *rest)

        made: list[str] = []
        patch.setattr(training, "write_tensors", killed)
        with pytest.raises(KeyboardInterrupt):
            lesson(lessons, tmp_path)
    assert weights(tmp_path) == weights(straight.folder)  # of epoch 2, beside the state of epoch 1
    assert lesson(lessons, tmp_path).epochs == 1
    assert weights(tmp_path) == weights(straight.folder)


def test_a_finished_training_runs_nothing_and_its_files_say_what_they_are(lessons, straight):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(training, "ViewpointDataset", lambda *_, **__: pytest.fail("read the pictures"))
        again = lesson(lessons, straight.folder)
    assert again.epochs == 0
    assert again.history == straight.history == json.loads((straight.folder / "history.json").read_text())
    about = straight.trained.about
    assert (about["network"], about["target"], about["size"], about["crop"], about["outputs"]) == (
        "tiny",
        "action",
        32,
        128,
        5,
    )
    assert about["config"] == config().to_dict()
    assert about["data"][0]["recipe"]["target"] == "cuboid_1x2"
    assert set(about["scores"]) == {"validation_loss", "validation_accuracy"}
    assert str(straight.folder) not in json.dumps(about)


def test_actions_are_learned(lessons, tmp_path):
    done = lesson(lessons, tmp_path, optimizer="adamw", learning_rate=0.01, schedule="one cycle", epochs=12, shift=0)
    assert done.history[-1]["loss"] < 0.5 < math.log(5) < done.history[0]["loss"] + 0.5
    assert done.history[-1]["accuracy"] > 0.85
    assert [line["epoch"] for line in done.history] == list(range(1, 13))


def test_tilts_are_learned_with_their_uncertainty(lessons, tmp_path):
    done = lesson(
        lessons,
        tmp_path,
        target="tilt",
        optimizer="adamw",
        learning_rate=0.01,
        schedule="one cycle",
        epochs=30,
        shift=0,
    )
    first, last = done.history[0], done.history[-1]
    assert last["error_deg"] < 0.6 * first["error_deg"]
    assert last["loss"] < first["loss"]
    assert last["validation_calibration"] > 0


def test_patience_stops_early_and_keeps_the_best(lessons, tmp_path, monkeypatch):
    losses = iter([1.0, 0.5, 0.7, 0.6, 0.4])
    monkeypatch.setattr(training, "evaluate", lambda *_: {"loss": next(losses), "accuracy": 0.5})
    done = lesson(lessons, tmp_path, epochs=9, patience=2)
    assert len(done.history) == 4
    assert (done.trained.about["epoch"], done.trained.about["scores"]["validation_loss"]) == (2, 0.5)
    assert lesson(lessons, tmp_path, epochs=9, patience=2).epochs == 0


def test_the_rate_of_every_step_is_the_schedule_s(lessons, tmp_path):
    done = lesson(lessons, tmp_path, epochs=3, decay_every=1)
    np.testing.assert_allclose([line["rate"] for line in done.history], [1e-3, 1e-4, 1e-5])


def test_a_last_batch_of_one_goes_with_the_one_before(lessons, tmp_path, monkeypatch):
    sizes = []
    monkeypatch.setattr(
        training, "train_epoch", lambda n, o, data, *rest: (sizes.append(len(data)), train_epoch(n, o, data, *rest))[1]
    )
    done = lesson(lessons, tmp_path, epochs=1, batch=11)  # 45 = 4 x 11 + 1; one picture of 32 px has no statistics
    assert sizes == [45]
    assert math.isfinite(done.history[0]["loss"])


def test_evaluation_is_the_mean_over_all_samples_whatever_the_batches(lessons, straight, monkeypatch):
    from gvp_lib.learning.dataset import ViewpointDataset

    data = ViewpointDataset(lessons, "validation", size=32, step=np.radians(20))
    whole = evaluate(straight.trained.network, data)
    monkeypatch.setattr(training, "_AT_ONCE", 7)
    assert evaluate(straight.trained.network, data) == pytest.approx(whole, rel=1e-5)
    assert whole["loss"] == pytest.approx(straight.history[-1]["validation_loss"], rel=1e-5)


def test_an_empty_set_has_no_mean_loss(lessons, straight):
    from gvp_lib.learning.dataset import ViewpointDataset

    none = ViewpointDataset(lessons, "validation", size=32, share=0.999, step=np.radians(20))
    assert not len(none)
    with pytest.raises(DatasetError, match="the split 'validation' of the set is empty; collect more, or choose"):
        evaluate(straight.trained.network, none)


def test_a_loss_without_bound_is_an_error_and_the_weights_before_are_kept(lessons, tmp_path, monkeypatch):
    with pytest.raises(
        TrainingDivergedError, match=r"in epoch 1 .* nothing is kept\. A smaller .* than 100 may do, say 10"
    ):
        lesson(lessons, tmp_path / "at once", learning_rate=100.0)
    real = training.train_epoch
    monkeypatch.setattr(training, "train_epoch", lambda *a: real(*a) if a[5] == 0 else (math.nan, 0.2))
    with pytest.raises(
        TrainingDivergedError, match=r"in epoch 2 the training loss is nan; the weights of epoch 1 are kept"
    ):
        lesson(lessons, tmp_path / "later")
    assert load_trained(tmp_path / "later" / "weights.safetensors").about["epoch"] == 1


def test_a_loss_that_grows_is_an_error_while_it_is_finite_and_the_last_good_weights_are_kept(lessons, tmp_path):
    options = {"learning_rate": 3.0, "schedule": "one cycle", "epochs": 20}  # whose first epochs are slower
    good = []
    with pytest.raises(
        TrainingDivergedError, match=r"training loss grew to \d\S*, over 6 times the 1.61 .* kept"
    ) as error:
        train(lessons, tmp_path, config(**options), device="cpu", progress=False, on_epoch=good.append)
    assert good
    assert f"in epoch {len(good) + 1} " in str(error.value)
    assert f"the weights of epoch {len(good)} are kept in {tmp_path}" in str(error.value)
    assert all(line["loss"] < 6 * math.log(5) for line in good)
    assert load_trained(tmp_path / "weights.safetensors").about["epoch"] == len(good)
    assert json.loads((tmp_path / "history.json").read_text()) == good
    kept = weights(tmp_path)
    with pytest.raises(TrainingDivergedError):  # taken up it comes to the same
        lesson(lessons, tmp_path, **options)
    assert weights(tmp_path) == kept


def test_with_patience_a_loss_that_grows_leaves_the_best_weights(lessons, tmp_path, monkeypatch):
    losses, real = iter([1.0, 0.5, 0.7, 0.6]), training.train_epoch
    monkeypatch.setattr(training, "evaluate", lambda *_: {"loss": next(losses), "accuracy": 0.5})
    monkeypatch.setattr(training, "train_epoch", lambda *a: real(*a) if a[5] < 3 else (real(*a)[0] + 30, 0.2))
    with pytest.raises(TrainingDivergedError, match=r"in epoch 4 .* the weights of epoch 2 are kept in"):
        lesson(lessons, tmp_path, epochs=9, patience=5)
    assert load_trained(tmp_path / "weights.safetensors").about["epoch"] == 2


def test_only_the_loss_over_the_training_is_bounded(lessons, tmp_path, monkeypatch):
    losses = iter([1780.0, math.inf])
    monkeypatch.setattr(training, "evaluate", lambda *_: {"loss": next(losses), "accuracy": 0.5})
    with pytest.raises(TrainingDivergedError, match=r"in epoch 2 the validation loss is inf; the weights of epoch 1"):
        lesson(lessons, tmp_path)


@pytest.mark.parametrize(("target", "outputs"), [("action", [0.0] * 5), ("tilt", [0.0, 0.0, 9.0])])
def test_a_network_that_knows_nothing_costs_what_its_objective_says(target, outputs):
    objective = OBJECTIVES[target]
    targets = torch.arange(5) if target == "action" else torch.full((5, 2), 0.3)
    found = float(objective.loss(torch.tensor([outputs] * 5), targets))
    assert found == pytest.approx(objective.ignorance, rel=0.1)


def test_a_set_without_one_of_the_actions_is_refused_by_the_action_s_name(lessons, plain, tmp_path):
    with pytest.raises(DatasetError, match=r"lack .*NO_OP.* collect more samples.*a larger step has more of it"):
        lesson(lessons, tmp_path / "none", step=np.radians(0.01))
    assert not (tmp_path / "none" / "weights.safetensors").exists()
    lesson(plain, tmp_path / "tilt", step=None, target="tilt", epochs=1)  # which needs no actions


def test_sets_of_several_sizes_need_a_crop(lessons, tmp_path):
    wide = collect(tmp_path / "wide", small(crop=160)).folder
    with pytest.raises(InvalidParameterError, match=r"\[128, 160\] px.*crop=128"):
        lesson([lessons, wide], tmp_path / "out")
    done = lesson([lessons, wide], tmp_path / "out", crop=128, epochs=1)
    assert done.trained.about["crop"] == 128
    assert len(done.trained.about["data"]) == 2


def test_a_folder_of_another_training_is_refused_with_what_differs(lessons, plain, straight):
    before = weights(straight.folder)
    with pytest.raises(CheckpointError, match=r"holds another training .seed 0 there, 1 here.; choose another folder"):
        lesson(lessons, straight.folder, seed=1)
    with pytest.raises(CheckpointError, match=r"holds another training .of other data"):
        lesson([lessons, plain], straight.folder)
    assert weights(straight.folder) == before


def test_a_state_that_is_damaged_or_foreign_is_refused(lessons, straight, tmp_path):
    state = (straight.folder / "training.safetensors").read_bytes()
    file = tmp_path / "training.safetensors"
    file.write_bytes(state[: len(state) // 2])
    with pytest.raises(CheckpointError, match="cannot be read as safetensors"):
        lesson(lessons, tmp_path)
    save_trained(file, straight.trained)
    with pytest.raises(CheckpointError, match="is no training's state"):
        lesson(lessons, tmp_path)
    about = {"recipe": json.loads(json.dumps(recipe_of(straight))), "history": straight.history}
    (straight.folder / "training.safetensors").write_bytes(state)
    tensors = load_file(straight.folder / "training.safetensors")
    for name in ("network.conv1.weight", "optimizer.0.momentum_buffer"):
        write_tensors(file, {key: tensor for key, tensor in tensors.items() if key != name}, about)
        with pytest.raises(CheckpointError, match="is damaged: it is no state of this training"):
            lesson(lessons, tmp_path)
        write_tensors(file, {**tensors, name: torch.zeros(3)}, about)
        with pytest.raises(CheckpointError, match="is damaged"):
            lesson(lessons, tmp_path)


def recipe_of(done):
    return {name: done.trained.about[name] for name in ("config", "data")}


def test_an_unknown_device_is_an_error_that_says_what_would_do(lessons, tmp_path):
    with pytest.raises(InvalidParameterError, match=r"device 'abacus' is not at hand here .*'cpu' is"):
        train(lessons, tmp_path, config(), device="abacus", progress=False)


def test_a_training_begins_with_a_file_s_weights_of_any_precision_and_number_of_outputs(lessons, straight, tmp_path):
    save_trained(tmp_path / "first.safetensors", straight.trained, "int8")
    options = {"weights": str(tmp_path / "first.safetensors"), "learning_rate": 1e-9, "epochs": 1}
    close = {"atol": 0.01, "rtol": 0}
    for target in ("action", "tilt"):
        network = lesson(lessons, tmp_path / target, target=target, **options).trained.network
        torch.testing.assert_close(network.conv1.weight, straight.trained.network.conv1.weight, **close)
    save_file(straight.trained.network.state_dict(), tmp_path / "bare.safetensors")
    lesson(lessons, tmp_path / "bare", **{**options, "weights": str(tmp_path / "bare.safetensors")})
    with pytest.raises(CheckpointError, match="there are no weights at 'nobody'"):
        lesson(lessons, tmp_path / "none", weights="nobody")


def test_first_weights_of_the_same_name_and_other_content_are_another_training(lessons, straight, tmp_path):
    first, options = tmp_path / "weights.safetensors", {"weights": str(tmp_path / "weights.safetensors"), "epochs": 1}
    save_trained(first, straight.trained)
    done = lesson(lessons, tmp_path / "out", **options)
    assert lesson(lessons, tmp_path / "out", **options).epochs == 0
    digest = done.trained.about["weights_sha256"]
    assert digest == hashlib.sha256(first.read_bytes()).hexdigest()
    save_trained(first, straight.trained, "float16")
    with pytest.raises(CheckpointError, match=rf"another training .weights_sha256 '{digest}' there, '\w+' here"):
        lesson(lessons, tmp_path / "out", **options)
    assert "weights_sha256" not in straight.trained.about  # what begins at random is told as before


def test_a_folder_in_which_another_process_trains_is_refused_until_that_ends(lessons, straight, tmp_path, monkeypatch):
    with pytest.raises(KeyboardInterrupt):
        train(lessons, tmp_path, config(), device="cpu", progress=False, on_epoch=stop_after(1))
    before = weights(tmp_path)
    with held_by_another_run(tmp_path / ".lock"), monkeypatch.context() as patch:
        patch.setattr(training, "ViewpointDataset", lambda *_, **__: pytest.fail("read the pictures"))
        with pytest.raises(CheckpointError, match=r"is in use by another training; wait for it, or choose another"):
            lesson(lessons, tmp_path)
    assert weights(tmp_path) == before
    assert lesson(lessons, tmp_path).epochs == 1
    assert weights(tmp_path) == weights(straight.folder)


def test_a_training_that_another_began_in_a_new_folder_meanwhile_is_taken_up(lessons, straight, tmp_path, monkeypatch):
    out, real = tmp_path / "out", training.open_locked

    def meanwhile(*arguments):
        monkeypatch.setattr(training, "open_locked", real)
        lesson(lessons, out)
        return real(*arguments)

    monkeypatch.setattr(training, "open_locked", meanwhile)
    assert lesson(lessons, out).epochs == 0
    assert weights(out) == weights(straight.folder)


def test_a_folder_that_cannot_be_written_is_noticed_before_the_first_epoch(lessons, tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setattr(training, "train_epoch", lambda *_: pytest.fail("ran an epoch"))
    for folder in ("file", "file/below"):
        with pytest.raises(CheckpointError, match=r"cannot be written .*; choose another"):
            lesson(lessons, tmp_path / folder)


@pytest.mark.parametrize("patience", [None, 1])
def test_weights_that_are_gone_are_written_again_as_they_were(patience, lessons, straight, tmp_path, monkeypatch):
    losses = iter([1.0, 0.5])
    if patience:
        monkeypatch.setattr(training, "evaluate", lambda *_: {"loss": next(losses), "accuracy": 0.5})
    lesson(lessons, tmp_path, patience=patience)
    before = weights(tmp_path)
    (tmp_path / "weights.safetensors").unlink()
    assert lesson(lessons, tmp_path, patience=patience).epochs == 0
    assert weights(tmp_path) == before


def test_the_best_weights_of_a_training_with_patience_cannot_be_written_again(lessons, tmp_path, monkeypatch):
    losses = iter([0.5, 1.0])
    monkeypatch.setattr(training, "evaluate", lambda *_: {"loss": next(losses), "accuracy": 0.5})
    lesson(lessons, tmp_path, patience=1)
    (tmp_path / "weights.safetensors").unlink()
    with pytest.raises(CheckpointError, match=r"is gone, and with it the weights of epoch 1, the best; remove .* anew"):
        lesson(lessons, tmp_path, patience=1)


@pytest.mark.parametrize(
    "change",
    [
        lambda recipe, history: {"recipe": [], "history": history},
        lambda recipe, history: {"recipe": {**recipe, "config": None}, "history": history},
        lambda recipe, history: {"recipe": recipe, "history": []},
        lambda recipe, history: {"recipe": recipe, "history": [{"epoch": 1, "rate": 0.1, "loss": 1.0}]},
    ],
)
def test_a_state_with_a_damaged_recipe_or_history_is_refused(change, lessons, straight, tmp_path):
    tensors = load_file(straight.folder / "training.safetensors")
    about = change(json.loads(json.dumps(recipe_of(straight))), straight.history)
    write_tensors(tmp_path / "training.safetensors", tensors, about)
    with pytest.raises(CheckpointError, match="is damaged: it is no state of this training"):
        lesson(lessons, tmp_path)


@pytest.mark.parametrize("threads", [0, -1, 1.5, True])
def test_a_number_of_threads_that_is_none_is_refused(threads, lessons, tmp_path):
    with pytest.raises(InvalidParameterError, match=r"threads is a whole number, 1 or more, or None .* got"):
        train(lessons, tmp_path / "out", config(), device="cpu", threads=threads, progress=False)
    assert not (tmp_path / "out").exists()


def check(target, **line):
    check_loss({"epoch": 3, "validation_loss": 1.0, **line}, OBJECTIVES[target], 0.1, "the weights of epoch 2 are kept")


@pytest.mark.check
@pytest.mark.parametrize("target", OBJECTIVES)
def test_a_loss_passes_up_to_six_times_that_of_knowing_nothing(target):
    bound = 6 * OBJECTIVES[target].ignorance
    check(target, loss=0.99 * bound, validation_loss=1e6)  # which a training may pass through and recover from
    with pytest.raises(TrainingDivergedError, match=r"in epoch 3 the training loss grew .*epoch 2 are kept.*say 0\.01"):
        check(target, loss=1.01 * bound)


@pytest.mark.check
@pytest.mark.parametrize("worth", [math.nan, math.inf])
def test_a_loss_that_is_no_finite_number_is_named(worth):
    with pytest.raises(TrainingDivergedError, match=f"the training loss is {worth}"):
        check("action", loss=worth)
    with pytest.raises(TrainingDivergedError, match=f"the validation loss is {worth}"):
        check("action", loss=1.0, validation_loss=worth)


class Samples:
    def __init__(self, *actions, target="action"):
        self.actions, self.target = np.array(actions), target

    def __len__(self):
        return len(self.actions)


@pytest.mark.check
def test_sets_teach_if_each_action_occurs_among_those_for_training():
    check_sets(Samples(0, 1, 2, 3, 4), Samples(0))
    check_sets(Samples(0, 1, target="tilt"), Samples(0))  # of a tilt there are no classes
    with pytest.raises(DatasetError, match="4 samples for training lack NO_OP"):
        check_sets(Samples(0, 1, 2, 3), Samples(4))


@pytest.mark.check
@pytest.mark.parametrize(("teaching", "validation"), [((0,), (0,)), ((0, 1, 2, 3, 4), ())])
def test_sets_that_are_too_few_are_refused(teaching, validation):
    with pytest.raises(DatasetError, match=f"{len(teaching)} samples to train and {len(validation)} to validate"):
        check_sets(Samples(*teaching), Samples(*validation))

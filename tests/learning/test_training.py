"""Training: the same weights by the same seed, whatever stopped it; that it learns, and stops; what it refuses."""

import hashlib
import json
import math
import shutil
from functools import partial

import numpy as np
import pytest
import torch
from other_runs import held_by_another_run
from tiny_training import config, lesson, weights
from viewpoint_sets import collect, small

from gvp_lib.errors import CheckpointError, DatasetError, InvalidParameterError, TrainingDivergedError
from gvp_lib.learning import training
from gvp_lib.learning.checkpoints import load_trained, save_trained
from gvp_lib.learning.config import OBJECTIVES
from gvp_lib.learning.dataset import ViewpointDataset
from gvp_lib.learning.resnet import ResNet
from gvp_lib.learning.training import check_loss, check_sets, evaluate, make_optimizer, train, train_epoch

pytestmark = pytest.mark.usefixtures("tiny")


@pytest.fixture(scope="module")
def straight(tiny, lessons, tmp_path_factory):
    """Two epochs at one go."""
    return lesson(lessons, tmp_path_factory.mktemp("straight"))


def stop_after_an_epoch(line):
    raise KeyboardInterrupt


def no_pictures(*_, **__):
    pytest.fail("read the pictures")


def losses(monkeypatch, *losses):
    """Let these be the validation losses, epoch by epoch."""
    given = iter(losses)
    monkeypatch.setattr(training, "evaluate", lambda *_: {"loss": next(given), "accuracy": 0.5})


# --- the same weights -----------------------------------------------------------------------------------------------


def test_the_same_seed_gives_the_same_weights_to_the_bit_and_another_seed_others(lessons, straight, tmp_path):
    lesson(lessons, tmp_path / "again")
    assert weights(tmp_path / "again") == weights(straight.folder)
    other = lesson(lessons, tmp_path / "other", seed=1, epochs=1)
    assert not torch.equal(other.trained.network.conv1.weight, straight.trained.network.conv1.weight)


@pytest.mark.parametrize(
    "options",
    [
        {"optimizer": "adamw", "schedule": "one cycle", "dihedral": True, "patience": 1},
        pytest.param({"momentum": 0.0}, marks=pytest.mark.full),
    ],
)
def test_a_training_that_is_taken_up_ends_at_the_weights_of_one_that_was_not_stopped(options, lessons, tmp_path):
    whole, cut = lesson(lessons, tmp_path / "whole", **options), tmp_path / "cut"
    with pytest.raises(KeyboardInterrupt):
        train(lessons, cut, config(**options), device="cpu", progress=False, on_epoch=stop_after_an_epoch)
    again = lesson(lessons, cut, **options)
    assert (whole.epochs, again.epochs, len(again.history)) == (2, 1, 2)
    assert weights(cut) == weights(whole.folder)


@pytest.mark.parametrize(
    ("during", "epoch", "repeated"),
    [("an epoch", 2, 1), ("history.json", 1, 2), ("history.json", 2, 1), ("state.pt", 1, 2)],
)
def test_a_training_killed_at_any_moment_ends_at_the_same_bytes(
    during, epoch, repeated, lessons, straight, tmp_path, monkeypatch
):
    written, write, batch = [], training.write_file, ViewpointDataset.batch

    def write_file(path, data):
        written.append(path.name)
        if path.name == during and written.count(during) == epoch:
            raise KeyboardInterrupt
        write(path, data)

    def some_batch(data, indices):
        if during == "an epoch" and data.split == "train" and data.epoch == epoch - 1 and 40 in indices:
            raise KeyboardInterrupt
        return batch(data, indices)

    monkeypatch.setattr(training, "write_file", write_file)
    monkeypatch.setattr(ViewpointDataset, "batch", some_batch)
    with pytest.raises(KeyboardInterrupt):
        lesson(lessons, tmp_path)
    monkeypatch.undo()
    assert lesson(lessons, tmp_path).epochs == repeated
    assert weights(tmp_path) == weights(straight.folder)


def test_a_finished_training_runs_nothing_and_its_files_say_what_they_are(lessons, straight, monkeypatch):
    monkeypatch.setattr(training, "ViewpointDataset", no_pictures)
    again = lesson(lessons, straight.folder)
    assert again.epochs == 0
    assert str(again).startswith("Training(tiny, action, 2 epochs (0 now), best validation accuracy 0.")
    assert again.history == straight.history == json.loads((straight.folder / "history.json").read_text())
    metadata = straight.trained.metadata
    expected = {
        "network": "tiny",
        "target": "action",
        "size": 32,
        "crop": 128,
        "outputs": 5,
        "config": config().to_dict(),
    }
    assert {name: metadata[name] for name in expected} == expected
    assert metadata["data"][0]["recipe"]["target"] == "cuboid_1x2"
    assert set(metadata["scores"]) == {"validation_loss", "validation_accuracy"}
    assert "weights_sha256" not in metadata  # it began at random
    assert str(straight.folder) not in json.dumps(metadata)


# --- steps ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "plain"),
    [("sgd", partial(torch.optim.SGD, momentum=0.9)), ("adamw", partial(torch.optim.AdamW, weight_decay=0.1))],
)
def test_a_step_is_the_optimizers_that_knows_nothing_of_memory(name, plain):
    chosen = config(optimizer=name, learning_rate=0.01, weight_decay=plain.keywords.get("weight_decay", 0.0))
    networks = [ResNet("tiny").to(memory_format=torch.channels_last) for _ in range(2)]
    networks[1].load_state_dict(networks[0].state_dict())
    own, twins = (list(network.parameters()) for network in networks)
    optimizer, other = make_optimizer(networks[0], chosen), plain(twins, lr=0.01, foreach=False, fused=False)
    for _ in range(3):
        for parameter, twin in zip(own, twins, strict=True):
            parameter.grad = torch.randn_like(parameter)
            twin.grad = parameter.grad.clone()
        optimizer.step()
        other.step()
    assert any(not parameter.is_contiguous() for parameter in own)
    for parameter, twin, view in zip(own, twins, optimizer.param_groups[0]["params"], strict=True):
        torch.testing.assert_close(parameter, twin, rtol=1e-5, atol=1e-6)
        assert view.is_contiguous()
        assert view.data_ptr() == parameter.data_ptr()
        assert view.grad is None


def test_a_last_batch_of_one_goes_with_the_one_before(lessons):
    data = ViewpointDataset(lessons, "train", size=32, step=np.radians(20))
    network, chosen = ResNet("tiny"), config(batch=11)
    assert len(data) == 45  # 4 x 11 + 1, and one picture of 32 px has no statistics
    loss, _ = train_epoch(network, make_optimizer(network, chosen), data, np.arange(45), chosen, 0)
    assert math.isfinite(loss)


def test_evaluation_is_the_mean_over_all_samples_whatever_the_batches(lessons, straight, monkeypatch):
    data = ViewpointDataset(lessons, "validation", size=32, step=np.radians(20))
    whole = evaluate(straight.trained.network, data)
    monkeypatch.setattr(training, "_EVALUATION_BATCH", 7)
    assert evaluate(straight.trained.network, data) == pytest.approx(whole, rel=1e-5)
    none = ViewpointDataset(lessons, "validation", size=32, share=0.999)
    with pytest.raises(DatasetError, match="the split 'validation' of the set is empty; collect more, or choose"):
        evaluate(straight.trained.network, none)


# --- learning, and its end ------------------------------------------------------------------------------------------


FAST = {"optimizer": "adamw", "learning_rate": 0.01, "schedule": "one cycle", "shift": 0}


def test_actions_are_learned(lessons, tmp_path):
    done, asked = lesson(lessons, tmp_path, epochs=12, **FAST), config(epochs=12, **FAST)
    assert done.history[-1]["loss"] < 0.5 < math.log(5) < done.history[0]["loss"] + 0.5
    assert done.history[-1]["accuracy"] > 0.85
    assert [(line["epoch"], line["rate"]) for line in done.history] == [(k + 1, asked.rate(k, 0)) for k in range(12)]


def test_tilts_are_learned_with_their_uncertainty(lessons, tmp_path):
    done = lesson(lessons, tmp_path, target="tilt", epochs=20, **FAST)
    first, last = done.history[0], done.history[-1]
    assert last["error_deg"] < 0.6 * first["error_deg"]
    assert last["loss"] < first["loss"]
    assert last["validation_calibration"] > 0


def test_patience_stops_early_and_keeps_the_best(lessons, tmp_path, monkeypatch):
    losses(monkeypatch, 1.0, 0.5, 0.7, 0.6, 0.4)
    done = lesson(lessons, tmp_path, epochs=9, patience=2)
    assert len(done.history) == 4
    assert (done.trained.metadata["epoch"], done.trained.metadata["scores"]["validation_loss"]) == (2, 0.5)
    assert lesson(lessons, tmp_path, epochs=9, patience=2).epochs == 0


@pytest.mark.parametrize(("patience", "best"), [(None, 3), (5, 2)])
def test_a_loss_that_grows_is_an_error_and_the_last_good_weights_or_the_best_are_kept(
    patience, best, lessons, tmp_path, monkeypatch
):
    losses(monkeypatch, 1.0, 0.5, 0.7, math.inf, math.inf)
    message = rf"in epoch 4 .* the weights of epoch {best} are kept in {tmp_path}\."
    for _ in range(2):  # taken up it comes to the same
        with pytest.raises(TrainingDivergedError, match=message):
            lesson(lessons, tmp_path, epochs=9, patience=patience)
        assert load_trained(tmp_path / "weights.safetensors").metadata["epoch"] == best
        history = json.loads((tmp_path / "history.json").read_text())
        assert [line["validation_loss"] for line in history] == [1.0, 0.5, 0.7]


@pytest.mark.check
@pytest.mark.parametrize("target", OBJECTIVES)
def test_a_training_loss_up_to_six_times_that_of_knowing_nothing_passes_and_any_finite_validation_loss(target):
    objective = OBJECTIVES[target]
    bound = 6 * objective.ignorance
    check_loss({"epoch": 3, "loss": 0.99 * bound, "validation_loss": 1e6}, objective, 0.1, "nothing is kept")
    for loss, validation in ((1.01 * bound, 1.0), (math.nan, 1.0), (1.0, math.nan), (1.0, math.inf)):
        losses = f"the training loss is {loss:.3g} and the validation loss {validation:.3g}"
        message = rf"in epoch 3 {losses}; .*; nothing is kept\. .*than 0\.1 may do, say 0\.01"
        with pytest.raises(TrainingDivergedError, match=message):
            check_loss({"epoch": 3, "loss": loss, "validation_loss": validation}, objective, 0.1, "nothing is kept")


# --- what it begins with, and what it refuses -----------------------------------------------------------------------


def test_a_training_begins_with_a_file_s_weights_and_of_other_ones_is_another(lessons, straight, tmp_path):
    file, out = tmp_path / "weights.safetensors", tmp_path / "out"
    options = {"target": "tilt", "weights": str(file), "learning_rate": 1e-9, "epochs": 1}
    save_trained(file, straight.trained, "int8")
    trained = lesson(lessons, out, **options).trained
    torch.testing.assert_close(trained.network.conv1.weight, straight.trained.network.conv1.weight, atol=0.01, rtol=0)
    digest = trained.metadata["weights_sha256"]
    assert digest == hashlib.sha256(file.read_bytes()).hexdigest()
    save_trained(file, straight.trained, "float16")  # the same name and other content
    with pytest.raises(CheckpointError, match=rf"another training .weights_sha256 '{digest}' there, '\w+' here"):
        lesson(lessons, out, **options)


def test_a_folder_of_another_training_is_refused_with_what_differs(lessons, plain, straight):
    before = weights(straight.folder)
    with pytest.raises(CheckpointError, match=r"holds another training .seed 0 there, 1 here.; choose another folder"):
        lesson(lessons, straight.folder, seed=1)
    with pytest.raises(CheckpointError, match=r"holds another training .of other data"):
        lesson([lessons, plain], straight.folder)
    assert weights(straight.folder) == before


def test_an_unfinished_training_without_a_whole_state_is_refused(lessons, tmp_path):
    state = tmp_path / "state.pt"
    with pytest.raises(KeyboardInterrupt):
        train(
            lessons, tmp_path, config(epochs=3), device="cpu", progress=False,
            on_epoch=lambda line: line["epoch"] == 2 and stop_after_an_epoch(line),
        )  # fmt: skip
    whole = state.read_bytes()
    for damage in (lambda: state.write_bytes(whole[: len(whole) // 2]), state.unlink):
        damage()
        with pytest.raises(CheckpointError, match=r"cannot resume from .*state\.pt .* to begin anew"):
            lesson(lessons, tmp_path, epochs=3)


def test_what_is_finished_is_only_read_also_where_another_run_holds_the_folder(lessons, straight, tmp_path):
    shutil.copytree(straight.folder, tmp_path / "done")
    with held_by_another_run(tmp_path / "done" / ".lock"):
        assert lesson(lessons, tmp_path / "done").epochs == 0


def test_a_lost_history_is_taken_from_the_state_and_no_epoch_is_thrown_away(lessons, tmp_path, monkeypatch):
    losses = iter([1.0, 2.0, 3.0, 4.0])
    judged = training.evaluate
    monkeypatch.setattr(training, "evaluate", lambda *each: {**judged(*each), "loss": next(losses)})
    with pytest.raises(KeyboardInterrupt):
        train(
            lessons, tmp_path, config(epochs=4, patience=4), device="cpu", progress=False,
            on_epoch=lambda line: line["epoch"] == 2 and stop_after_an_epoch(line),
        )  # fmt: skip
    (tmp_path / "history.json").write_text("[torn")
    done = lesson(lessons, tmp_path, epochs=4, patience=4)
    assert (done.epochs, len(done.history), done.trained.metadata["epoch"]) == (2, 4, 1)  # the first was the best
    (tmp_path / "history.json").write_text(json.dumps(done.history[:2]))
    (tmp_path / "state.pt").unlink()
    with pytest.raises(CheckpointError, match=r"cannot resume from .*state\.pt"):
        lesson(lessons, tmp_path, epochs=4, patience=4)


def test_no_set_is_no_training(tmp_path):
    with pytest.raises(InvalidParameterError, match="needs one set of viewpoints or more; got none"):
        lesson([], tmp_path)


def test_a_folder_in_which_another_process_trains_is_refused_until_that_ends(lessons, straight, tmp_path, monkeypatch):
    with held_by_another_run(tmp_path / ".lock"), monkeypatch.context() as patch:
        patch.setattr(training, "ViewpointDataset", no_pictures)
        with pytest.raises(CheckpointError, match="is in use by another run; wait for it, or give another path"):
            lesson(lessons, tmp_path)
    assert lesson(lessons, tmp_path, epochs=1).epochs == 1


def test_a_folder_that_cannot_be_written_is_noticed_before_the_first_epoch(lessons, tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setattr(training, "train_epoch", lambda *_: pytest.fail("ran an epoch"))
    for folder in ("file", "file/below"):
        with pytest.raises(CheckpointError, match=r"cannot write .* make room, or give a path"):
            lesson(lessons, tmp_path / folder)


def test_sets_of_several_sizes_need_a_crop(lessons, tmp_path):
    wide = collect(tmp_path / "wide", small(crop=160)).folder
    with pytest.raises(InvalidParameterError, match=r"\[128, 160\] px.*crop=128"):
        lesson([lessons, wide], tmp_path / "out")
    done = lesson([lessons, wide], tmp_path / "out", crop=128, epochs=1)
    assert done.trained.metadata["crop"] == 128
    assert len(done.trained.metadata["data"]) == 2


class Samples:
    def __init__(self, *actions, target="action"):
        self.actions, self.target = np.array(actions), target

    def __len__(self):
        return len(self.actions)


@pytest.mark.check
def test_sets_teach_if_each_action_occurs_among_those_for_training():
    check_sets(Samples(0, 1, 2, 3, 4), Samples(0))
    check_sets(Samples(0, 1, target="tilt"), Samples(0))  # tilts have no classes
    with pytest.raises(DatasetError, match=r"4 samples for training lack NO_OP.* collect more.*a larger step has more"):
        check_sets(Samples(0, 1, 2, 3), Samples(4))
    for few, validation in (((0,), (0,)), ((0, 1, 2, 3, 4), ())):
        with pytest.raises(DatasetError, match=f"{len(few)} samples to train and {len(validation)} to validate"):
            check_sets(Samples(*few), Samples(*validation))

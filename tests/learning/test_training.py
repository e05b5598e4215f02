"""Training: the same weights by the same seed, whatever stopped it; that it learns, and stops; what it refuses."""

import hashlib
import json
import math
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
from gvp_lib.learning.dataset import ViewpointDataset
from gvp_lib.learning.resnet import ResNet
from gvp_lib.learning.shards import read_card
from gvp_lib.learning.training import evaluate, make_optimizer, train, train_epoch

pytestmark = pytest.mark.usefixtures("tiny")


@pytest.fixture(scope="module")
def straight(tiny, lessons, tmp_path_factory):
    """Two epochs at one go."""
    return lesson(lessons, tmp_path_factory.mktemp("straight"))


def test_paths_are_those_of_when_they_were_given_wherever_the_process_goes(lessons, straight, tmp_path, monkeypatch):
    (tmp_path / "first.safetensors").write_bytes(weights(straight.folder))
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    options, collected = config(weights="first.safetensors"), collect("set", small(n=4))
    monkeypatch.chdir("elsewhere")
    back = partial(monkeypatch.chdir, tmp_path)
    result = train(lessons, "run", options, device="cpu", progress=False, on_epoch=lambda _: back())
    assert result.folder == tmp_path / "elsewhere" / "run"
    assert len(json.loads((result.folder / "history.json").read_bytes())) == 2
    monkeypatch.chdir("elsewhere")
    assert read_card(collected.folder)["counts"]["samples"] == 4


def stopped(data, folder, after=1, **options):
    """Train until Ctrl-C after an epoch."""

    def stop(line):
        if line["epoch"] == after:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(data, folder, config(**options), device="cpu", progress=False, on_epoch=stop)


def no_pictures(*_, **__):
    pytest.fail("read the pictures")


def losses(monkeypatch, *losses):
    """Let these be the validation losses, epoch by epoch."""
    given = iter(losses)
    monkeypatch.setattr(training, "evaluate", lambda *_: {"loss": next(given), "accuracy": 0.5})


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
    whole = lesson(lessons, tmp_path / "whole", **options)
    stopped(lessons, tmp_path / "cut", **options)
    again = lesson(lessons, tmp_path / "cut", **options)
    assert (whole.epochs, again.epochs, len(again.history)) == (2, 1, 2)
    assert weights(again.folder) == weights(whole.folder)


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


def test_a_finished_training_is_only_read_and_its_files_say_what_they_are(lessons, straight, monkeypatch):
    monkeypatch.setattr(training, "ViewpointDataset", no_pictures)
    with held_by_another_run(straight.folder / ".lock"):
        again = lesson(lessons, straight.folder)
    assert again.epochs == 0
    assert again.history == straight.history == json.loads((straight.folder / "history.json").read_text())
    metadata = straight.trained.metadata
    expected = {"network": "tiny", "target": "action", "size": 32, "crop": 128, "outputs": 5}
    assert metadata.items() >= expected.items()
    assert metadata["config"] == config().to_dict()
    assert metadata["data"][0]["recipe"]["target"] == "cuboid_1x2"
    assert set(metadata["scores"]) == {"validation_loss", "validation_accuracy"}
    assert "weights_sha256" not in metadata  # it began at random
    assert str(straight.folder) not in json.dumps(metadata)


@pytest.mark.parametrize(
    ("name", "plain"),
    [("sgd", partial(torch.optim.SGD, momentum=0.9)), ("adamw", partial(torch.optim.AdamW, weight_decay=0.1))],
)
def test_a_step_is_the_optimizers_that_knows_nothing_of_memory(name, plain):
    chosen = config(optimizer=name, learning_rate=0.01, weight_decay=plain.keywords.get("weight_decay", 0.0))
    network, other = (ResNet("tiny").to(memory_format=torch.channels_last) for _ in range(2))
    other.load_state_dict(network.state_dict())
    pairs = list(zip(network.parameters(), other.parameters(), strict=True))
    optimizers = make_optimizer(network, chosen), plain(other.parameters(), lr=0.01, foreach=False, fused=False)
    for _ in range(3):
        for parameter, twin in pairs:
            parameter.grad = torch.randn_like(parameter)
            twin.grad = parameter.grad.clone()
        for optimizer in optimizers:
            optimizer.step()
    assert any(not parameter.is_contiguous() for parameter, _ in pairs)
    for parameter, twin in pairs:
        torch.testing.assert_close(parameter, twin, rtol=1e-5, atol=1e-6)


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


def test_a_trained_network_is_evaluated_as_its_network_is_and_on_another_target_refused(lessons, straight):
    data, trained = ViewpointDataset(lessons, "all", size=32), straight.trained
    assert evaluate(trained, data, torch.device("cpu")) == evaluate(trained.network, data)
    with pytest.raises(InvalidParameterError, match="target, 'tilt', a network has 3 outputs; this one has 5"):
        evaluate(trained, ViewpointDataset(lessons, "all", size=32, target="tilt"))


def test_what_is_of_no_use_to_a_training_is_refused_before_the_first_epoch(lessons, tmp_path):
    for given, message in (
        ({"metadata": {"me": object()}}, "metadata is JSON data"),
        ({"data": 7}, "a set of viewpoints is a folder, given by its path; got a int"),
        ({"folder": None}, "a training goes into a folder, given by its path; got a NoneType"),
        ({"progress": "yes"}, "progress is True or False; got a str"),
    ):
        with pytest.raises(InvalidParameterError, match=message):
            train(**{"data": lessons, "folder": tmp_path / "run", "progress": False, **given})
    assert not (tmp_path / "run").exists()


def test_tilts_are_learned_with_their_uncertainty(lessons, tmp_path):
    fast = {"optimizer": "adamw", "learning_rate": 0.01, "schedule": "one cycle", "shift": 0, "epochs": 20}
    history = lesson(lessons, tmp_path, target="tilt", **fast).history
    first, last = history[0], history[-1]
    assert [line["rate"] for line in history] == [config(**fast).rate(epoch, 0) for epoch in range(20)]
    assert last["error_deg"] < 0.6 * first["error_deg"]
    assert last["loss"] < first["loss"]
    assert last["validation_calibration"] > 0


def test_patience_stops_early_and_keeps_the_best(lessons, tmp_path, monkeypatch):
    losses(monkeypatch, 1e6, 0.5, 0.7, 0.6, 0.4)  # the first, before statistics settle, may be anything finite
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


def test_a_lost_history_is_taken_from_the_state_without_which_nothing_is_resumed(lessons, tmp_path, monkeypatch):
    losses, options = iter([1.0, 2.0, 3.0, 4.0]), {"epochs": 4, "patience": 4}
    judged, state, history = training.evaluate, tmp_path / "state.pt", tmp_path / "history.json"
    monkeypatch.setattr(training, "evaluate", lambda *each: {**judged(*each), "loss": next(losses)})
    stopped(lessons, tmp_path, after=2, **options)
    whole, kept = state.read_bytes(), history.read_bytes()
    history.write_text("[torn")
    done = lesson(lessons, tmp_path, **options)
    assert (done.epochs, len(done.history), done.trained.metadata["epoch"]) == (2, 4, 1)  # the first was the best
    history.write_bytes(kept)
    for damage in (lambda: state.write_bytes(whole[: len(whole) // 2]), state.unlink):
        damage()
        with pytest.raises(CheckpointError, match=r"cannot resume from .*state\.pt .* to begin anew"):
            lesson(lessons, tmp_path, **options)


def test_a_folder_in_use_or_that_cannot_be_written_is_noticed_before_the_first_epoch(lessons, tmp_path, monkeypatch):
    monkeypatch.setattr(training, "ViewpointDataset", no_pictures)
    with held_by_another_run(tmp_path / ".lock"):
        for folder, message in (
            (tmp_path, "is in use by another run; wait for it, or give another path"),
            (tmp_path / ".lock", r"cannot write .* make room, or give a path"),
            (tmp_path / ".lock" / "below", r"cannot write .* make room, or give a path"),
        ):
            with pytest.raises(CheckpointError, match=message):
                lesson(lessons, folder)


def test_a_training_is_of_one_set_or_several_and_those_of_several_sizes_need_a_crop(lessons, tmp_path):
    with pytest.raises(InvalidParameterError, match="needs one set of viewpoints or more; got none"):
        lesson([], tmp_path)
    wide = collect(tmp_path / "wide", small(crop=160)).folder
    with pytest.raises(InvalidParameterError, match=r"\[128, 160\] px.*crop=128"):
        lesson([lessons, wide], tmp_path / "out")
    metadata = lesson([lessons, wide], tmp_path / "out", crop=128, epochs=1).trained.metadata
    assert (metadata["crop"], len(metadata["data"])) == (128, 2)


def test_a_set_without_one_of_the_actions_or_with_nothing_to_train_on_is_refused(plain, tmp_path):
    with pytest.raises(DatasetError, match=r"11 samples for training lack .*NO_OP.* collect more.*a larger step has"):
        lesson(plain, tmp_path, step=0.01)
    with pytest.raises(DatasetError, match="0 samples to train and 16 to validate"):
        lesson(plain, tmp_path, share=0.001)

"""Weights as files: what comes back, how exactly, and what is refused; downloaded, whole, broken or evil."""

import hashlib
import io
import json
import socket
from inspect import isfunction
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from gvp_book.experiments.networks import NETWORKS, SETS
from gvp_lib.errors import CheckpointError, DownloadError, GvpError, InvalidParameterError, UnknownNameError
from gvp_lib.learning import checkpoints
from gvp_lib.learning.checkpoints import SHIPPED, TrainedNetwork, load_trained, load_weights, save_trained
from gvp_lib.learning.resnet import ResNet

pytestmark = pytest.mark.usefixtures("tiny")
METADATA = {"network": "tiny", "target": "action", "size": 32, "crop": 128, "outputs": 5, "scores": {}}


def network(outputs=5, seed=0, name="tiny"):
    torch.manual_seed(seed)
    network = ResNet(name, outputs)
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.running_mean.normal_()
            module.running_var.fill_(1e6)  # more than 16 bits hold
    return network.eval()


def trained(name="tiny", **metadata):
    return TrainedNetwork(network(name=name), {**METADATA, "network": name, **metadata})


def equal(first, second, head=True):
    first, second = first.state_dict(), second.state_dict()
    return all(torch.equal(first[name], second[name]) for name in first if head or not name.startswith("fc."))


@pytest.fixture
def file(tmp_path):
    return tmp_path / "w.safetensors"


def test_float32_comes_back_exactly_with_what_it_is_and_the_same_network_gives_the_same_bytes(file, tmp_path):
    for path in (file, tmp_path / "b.safetensors"):
        save_trained(path, trained(command="gvp train set"))
    back = load_trained(file)
    assert equal(back.network, network())
    assert not back.network.training
    assert back.metadata == {**METADATA, "command": "gvp train set", "precision": "float32"}
    assert file.read_bytes() == (tmp_path / "b.safetensors").read_bytes()


@pytest.mark.parametrize("begins", [b"\x80", b"PK"])
def test_a_file_whose_length_begins_as_a_pickle_or_an_archive_does_is_none(begins, file):
    save_trained(file, trained(command=""))
    length, step = int.from_bytes(file.read_bytes()[:8], "little"), 256 ** len(begins)
    save_trained(file, trained(command=" " * ((int.from_bytes(begins, "little") - length) % step)))
    assert file.read_bytes().startswith(begins)
    assert equal(load_trained(file).network, network())


def test_a_configuration_is_stored_under_the_names_of_version_0_1_and_read_under_today_s(file):
    save_trained(file, trained(config={"dihedral": True}))
    with safe_open(file, "pt") as stored:
        assert json.loads(stored.metadata()["gvp_lib"])["config"] == {"turns": True}
    assert load_trained(file).metadata["config"] == {"dihedral": True}


@pytest.mark.parametrize(("precision", "largest"), [("float16", 5.8), ("int8", 3.0)])  # MB; of float32 it would be 11.3
def test_fewer_bits_come_back_within_their_rounding_and_other_numbers_exactly_from_a_smaller_file(
    precision, largest, file
):
    before = trained("resnet18_half")
    with torch.no_grad():
        before.network.conv1.weight[0] = 0  # a channel of zeros stays one
    save_trained(file, before, precision)
    after = load_trained(file).network.state_dict()
    for name, old in before.network.state_dict().items():
        if old.dim() < 2:
            assert torch.equal(old, after[name]), name
        else:
            bound = old.flatten(1).abs().amax(dim=1) * (1.0001 / 254 if precision == "int8" else 2**-11)
            assert ((old - after[name]).flatten(1).abs().amax(dim=1) <= bound).all(), name
    assert file.stat().st_size < largest * 1e6


WHOLE = torch.zeros(8, 3, 7, 7, dtype=torch.int8)


@pytest.mark.parametrize(
    ("tensors", "metadata", "message"),
    [
        ({}, None, r"lacks network, target, size, crop, outputs, .*initialize a training: TrainConfig\(weights="),
        ({}, "{", "cannot be read as safetensors"),
        ({}, {"network": "resnet999"}, "the network of .* is 'resnet999'; this version .* knows resnet50"),
        ({}, {"target": "roll"}, "the target of .* is 'roll'; .* knows action, tilt"),
        ({}, {"network": "resnet18_half"}, "has another architecture than the network: .* It fits tiny"),
        ({}, {"outputs": 3}, "damaged: a network whose target is 'action' has 5 outputs"),
        ({}, {"target": "tilt", "outputs": 3}, "damaged: a network whose target is 'tilt' has 3 outputs"),
        ({}, {"size": None}, "damaged: size is a whole number from 1; got None"),
        ({"conv1.weight": WHOLE[:, 1:].float()}, {}, r"conv1\.weight, \(8, 2, 7, 7\) in the file .*\(8, 3, 7, 7\) in"),
        ({"conv1.weight": WHOLE}, {}, r"conv1\.weight, whole numbers \(8, 3, 7, 7\) in the file"),
        (
            {"extra": torch.zeros(1)},
            {},
            r"extra, \(1,\) in the file and missing .*\. It fits none of resnet50",
        ),
        ({"fc.bias": None}, {}, r"fc\.bias, missing in the file and \(5,\) in the network"),
        ({"fc.weight": None}, {}, r"fc\.weight, missing in the file and \(5, \d+\) in the network"),
        ({"bn1.num_batches_tracked": WHOLE[0]}, {}, r"bn1\.num_batches_tracked, whole .*\(3, 7, 7\)"),
        ({"bn1.running_var": torch.full((8,), np.inf)}, {}, "'bn1.running_var' holds numbers that are not finite"),
    ],
)
def test_a_file_that_does_not_hold_what_it_says_is_refused_by_name(tensors, metadata, message, file):
    header = metadata if isinstance(metadata, str) else json.dumps({**METADATA, **(metadata or {})})
    state = {**network().state_dict(), **tensors}
    state = {name: tensor.contiguous() for name, tensor in state.items() if tensor is not None}
    save_file(state, file, None if metadata is None else {"gvp_lib": header})
    with pytest.raises(CheckpointError, match=message):
        load_trained(file)


@pytest.mark.parametrize("share", [0.0, 0.999])
def test_a_file_that_ends_early_is_refused_and_leaves_a_network_as_it_was(share, file, tmp_path):
    own, other = network(seed=9), tmp_path / "w.pth"
    save_trained(file, trained())
    torch.save(network().state_dict(), other)
    for path, message in ((file, r"cannot be read as safetensors .* is it complete"), (other, "is damaged")):
        path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
        with pytest.raises(CheckpointError, match=message):
            load_weights(own, path)
    assert equal(own, network(seed=9))


def test_what_cannot_be_written_is_refused_and_what_was_there_is_kept(file, tmp_path):
    with pytest.raises(UnknownNameError, match="no precision named 'int4'"):
        save_trained(file, trained(), "int4")
    (tmp_path / "file").touch()
    with pytest.raises(CheckpointError, match="cannot write"):
        save_trained(tmp_path / "file" / "w.safetensors", trained())
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        *(
            (name, f"no weights at '{name}'; give a file .*'actions-1x2'.*'imagenet' or None")
            for name in ("no", "n.pth")
        ),
        (__file__, r"test_checkpoints\.py is damaged, or no file of weights: it begins neither .* with b'\"\"\"Weight"),
        (Path(__file__).parent, "'.*learning' is a folder; give a file"),
        (7, "or the name of a network that comes with the library; got a int: 7"),
    ],
)
def test_what_is_no_file_of_weights_is_refused_with_what_would_be(weights, message):
    for load in (load_trained, lambda weights: load_weights(network(), weights)):
        with pytest.raises(GvpError, match=message):
            load(weights)


MADE_AS = {"actions-1x2": "1x2-random-0", "tilt-1x2": "tilt-1x2", "tilt-all": "tilt-all"}


def test_together_they_are_under_10_mb():
    assert sum(file.stat().st_size for file in SHIPPED.glob("*.safetensors")) < 10e6
    assert {file.stem for file in SHIPPED.glob("*.safetensors")} == set(MADE_AS)


@pytest.mark.parametrize("name", MADE_AS)
def test_each_was_made_as_its_experiment_says(name):
    recipe, metadata = NETWORKS[MADE_AS[name]], load_trained(name).metadata
    assert metadata["config"] == {key: recipe.config.to_dict()[key] for key in metadata["config"]}
    assert [each["recipe"] for each in metadata["data"]] == [SETS[name].to_dict() for name in recipe.sets]
    assert metadata["command"].startswith("gvp train ")


def state(prefix="", **others):
    return {prefix + name: tensor for name, tensor in network().state_dict().items()} | others


@pytest.mark.filterwarnings("ignore:.*script_method")  # of torch.compile
@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("w.safetensors", lambda file: save_trained(file, trained(), "int8")),
        ("w.safetensors", lambda file: save_file(state(), file)),
        ("pytorch_model", lambda file: save_file(state(), file)),  # under whatever name
        ("model_best.pth.tar", lambda file: torch.save({"epoch": 3, "arch": "tiny", "state_dict": state()}, file)),
        ("pytorch_model.bin", lambda file: torch.save(state(), file)),
        ("w.pth", lambda file: torch.save(torch.nn.DataParallel(network()).state_dict(), file)),
        ("w.pth", lambda file: torch.save(torch.compile(network()).state_dict(), file)),
        ("ddp.safetensors", lambda file: save_file(state("module._orig_mod."), file)),
        ("swa.pt", lambda file: torch.save(torch.optim.swa_utils.AveragedModel(network()).state_dict(), file)),
        ("last.ckpt", lambda file: torch.save({"state_dict": state("model.", loss=WHOLE), "loops": {}}, file)),
    ],
)
def test_a_file_gives_its_weights_and_another_number_of_outputs_keeps_its_own(name, write, tmp_path):
    file, own, other = tmp_path / name, network(5, 2), network(2, 2)
    write(file)
    load_weights(own, file)
    for name, tensor in network().state_dict().items():
        torch.testing.assert_close(own.state_dict()[name], tensor, atol=0.01, rtol=0)
    load_weights(other, str(file))
    load_weights(other, None)
    assert equal(other, own, head=False)
    assert torch.equal(other.fc.weight, network(2, 2).fc.weight)


def test_a_body_without_its_final_layer_leaves_a_network_its_own_and_is_no_trained_network(file):
    body = {name: tensor for name, tensor in state().items() if not name.startswith("fc.")}
    save_file(body, file, {"gvp_lib": json.dumps(METADATA)})
    own = network(5, 2)
    load_weights(own, file)
    assert equal(own, network(), head=False)
    assert torch.equal(own.fc.weight, network(5, 2).fc.weight)
    with pytest.raises(CheckpointError, match=r"fc\.weight, missing in the file .* It fits tiny"):
        load_trained(file)


def test_an_old_file_of_parameters_and_halves_without_counters_of_batches_is_read(tmp_path):
    own, halves = ResNet("tiny", 5), ResNet("tiny", 5).half()
    state = {name: tensor for name, tensor in halves.state_dict().items() if not name.endswith("num_batches_tracked")}
    state["conv1.weight"] = halves.conv1.weight  # a parameter
    torch.save(state, tmp_path / "old.pth", _use_new_zipfile_serialization=False)
    load_weights(own, tmp_path / "old.pth")
    assert own.conv1.weight.dtype == torch.float32
    assert torch.equal(own.layer4[0].conv2.weight, halves.layer4[0].conv2.weight.float())


class Evil:
    """A pickle that writes a file when it is read as pickles are."""

    def __reduce__(self):
        return Path.touch, (Path("trace"),)


def test_code_in_a_file_does_not_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for archive in (True, False):
        torch.save({"x": Evil()}, "evil.pth", _use_new_zipfile_serialization=archive)
        torch.load("evil.pth", weights_only=False)
        Path("trace").unlink()  # it is evil indeed
        with pytest.raises(CheckpointError, match=r"a pickled \w+\. .* can run code, so it was not loaded"):
            load_weights(network(), "evil.pth")
    assert not Path("trace").exists()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (torch.nn.Linear(2, 2), r"a pickled torch\.nn\.modules\.linear\.Linear\. .*save\(saved\.state_dict\(\), new"),
        ({"epoch": 3, "state_dict": {}}, "holds no tensors by name: entries 'epoch', 'state_dict'. Save what"),
        ([WHOLE], "holds no tensors by name: list"),
        (lambda: {"model": state(), "model_ema": state()}, "holds several networks: entries 'model', 'model_ema'"),
        (
            lambda: state("online.") | state("target."),
            "several networks, .* begin with 'online.' and 'target.'",
        ),
        (
            {"resnet.embedder.embedder.convolution.weight": WHOLE, "classifier.1.bias": WHOLE},
            r"does not call its tensors as torchvision does: its first is 'resnet\.embedder.*'s is 'conv1\.weight'",
        ),
        ({"conv1.weight": WHOLE}, r"another architecture.*It fits none"),
    ],
    ids=["a whole network", "no tensors", "a list", "two entries", "two prefixes", "other names", "another network"],
)
def test_a_pickle_of_something_else_is_refused_by_what_it_is(content, message, tmp_path):
    torch.save(content() if isfunction(content) else content, tmp_path / "w.pth")
    own = network(seed=9)
    with pytest.raises(CheckpointError, match=message):
        load_weights(own, tmp_path / "w.pth")
    assert equal(own, network(seed=9))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda file: load_weights(torch.nn.DataParallel(network()), file), r"got a DataParallel.*network\.module"),
        (lambda file: save_trained(file, network()), r"writes TrainedNetwork\(network, metadata\), .*; got ResNet\("),
        (
            lambda file: save_trained(file, TrainedNetwork(network(), {"size": 32})),
            "without network, target, crop",
        ),
        (lambda file: save_trained(file, trained(command=print)), "metadata is JSON data.*; got <built-in function"),
    ],
)
def test_what_is_no_network_or_could_not_be_read_back_is_refused(call, message, file):
    with pytest.raises(InvalidParameterError, match=message):
        call(file)
    assert not file.exists()


def test_numbers_of_numpy_are_stored_as_numbers_and_a_home_is_found(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    save_trained("~/w.safetensors", trained(crop=np.int64(96), scores={"validation_accuracy": np.float32(0.5)}))
    assert load_trained("~/w.safetensors").metadata["crop"] == 96
    assert (tmp_path / "w.safetensors").is_file()


@pytest.fixture
def published(monkeypatch, tmp_path):
    """File from which the tiny network of seed 1 is downloaded."""
    buffer = io.BytesIO()
    torch.save(network(1000, 1).state_dict(), buffer)
    file = tmp_path / f"tiny-{hashlib.sha256(buffer.getvalue()).hexdigest()[:8]}.pth"
    file.write_bytes(buffer.getvalue())
    monkeypatch.setitem(checkpoints.PUBLISHED, "tiny", file.name)
    monkeypatch.setattr(checkpoints, "_BASE_URL", f"{tmp_path.as_uri()}/")
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "torch"))
    monkeypatch.setattr(torch.hub, "_hub_dir", None)
    return file


def test_published_weights_are_fetched_once_and_anew_where_the_cached_file_is_damaged(published, tmp_path):
    cached, own, again = tmp_path / "torch" / "hub" / "checkpoints" / published.name, network(5, 2), network(1000, 3)
    cached.parent.mkdir(parents=True)
    cached.write_bytes(b"half a file")
    load_weights(own, "imagenet")
    assert equal(own, network(1000, 1), head=False)
    assert list(cached.parent.iterdir()) == [cached]
    published.unlink()
    load_weights(again, "imagenet")
    assert equal(again, network(1000, 1))


@pytest.mark.parametrize(
    ("trouble", "message"),
    [("an early end", "invalid hash value"), ("a silent server", "timed out"), ("no room", "Not a directory|File exi")],
)
def test_what_cannot_be_downloaded_is_not_kept_and_the_text_says_what_would_work(
    trouble, message, published, monkeypatch, tmp_path
):
    with socket.create_server(("127.0.0.1", 0)) as silent:
        if trouble == "an early end":
            published.write_bytes(published.read_bytes()[:-100])
        elif trouble == "no room":
            (tmp_path / "torch").touch()
        else:
            monkeypatch.setenv("no_proxy", "*")
            monkeypatch.setattr(checkpoints, "_BASE_URL", f"http://127.0.0.1:{silent.getsockname()[1]}/models/")
            monkeypatch.setattr(checkpoints, "_TIMEOUT", 0.2)
        advice = r"by hand.*TORCH_HOME.*weights=None"
        with pytest.raises(DownloadError, match=rf"{published.name} cannot be downloaded to .*({message}).*{advice}"):
            load_weights(network(), "imagenet")
    assert socket.getdefaulttimeout() is None
    assert list((tmp_path / "torch").rglob("*.pth*")) == []


def test_a_network_that_nobody_trained_on_imagenet_has_no_such_weights():
    with pytest.raises(CheckpointError, match=r"no published weights.*'resnet50' and 'resnet18'.*None"):
        load_weights(network(), "imagenet")

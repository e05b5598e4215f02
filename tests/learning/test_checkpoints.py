"""Weights as files: what comes back, how exactly, how large, and what is refused."""

import json
import pickle

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from gvp_lib.errors import CheckpointError, UnknownNameError
from gvp_lib.learning.checkpoints import TrainedNetwork, load_trained, read_tensors, save_trained
from gvp_lib.learning.pretrained import load_weights
from gvp_lib.learning.resnet import NETWORKS, ResNet

pytestmark = pytest.mark.usefixtures("tiny")
ABOUT = {"network": "tiny", "target": "action", "size": 32, "crop": 128, "outputs": 5, "scores": {}}


def trained(seed=0, **about):
    about = {**ABOUT, **about}
    torch.manual_seed(seed)
    network = ResNet(about["network"], about["outputs"])
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.running_mean.normal_()
            module.running_var.fill_(1e6)  # more than 16 bits hold
    return TrainedNetwork(network.eval(), about)


def both(first, second):
    return zip(first.network.state_dict().items(), second.network.state_dict().values(), strict=True)


def test_float32_comes_back_exactly_and_the_same_tensors_give_the_same_bytes(tmp_path):
    for name in "ab":
        save_trained(tmp_path / f"{name}.safetensors", trained())
    back = load_trained(tmp_path / "a.safetensors")
    assert all(torch.equal(old, new) for (_, old), new in both(trained(), back))
    assert back.about == {**ABOUT, "precision": "float32"}
    assert not back.network.training
    assert (tmp_path / "a.safetensors").read_bytes() == (tmp_path / "b.safetensors").read_bytes()


@pytest.mark.parametrize("precision", ["float16", "int8"])
def test_fewer_bits_come_back_within_their_rounding_and_other_numbers_exactly(precision, tmp_path):
    save_trained(tmp_path / "w.safetensors", trained(), precision)
    for (name, old), new in both(trained(), load_trained(tmp_path / "w.safetensors")):
        if old.dim() < 2:
            assert torch.equal(old, new), name
            continue
        largest = old.flatten(1).abs().amax(dim=1)
        bound = largest / 254 * 1.0001 if precision == "int8" else largest * 2**-11
        assert ((old - new).flatten(1).abs().amax(dim=1) <= bound).all(), name
        assert not torch.equal(old, new)


def test_a_channel_of_zeros_comes_back_as_zeros(tmp_path):
    network = trained()
    with torch.no_grad():
        network.network.conv1.weight[0] = 0
    save_trained(tmp_path / "w.safetensors", network, "int8")
    assert not load_trained(tmp_path / "w.safetensors").network.conv1.weight[0].any()


def test_the_network_that_is_small_enough_to_ship_is(tmp_path):
    network = trained(network="resnet18_half")
    sizes = {}
    for precision in ("float32", "float16", "int8"):
        save_trained(tmp_path / "w.safetensors", network, precision)
        sizes[precision] = (tmp_path / "w.safetensors").stat().st_size / 1e6
    assert sizes["int8"] < 3.0
    assert sizes["float16"] < 5.8
    assert sizes["float32"] < 11.4


def test_a_file_of_any_precision_begins_another_training(tmp_path):
    for precision in ("float32", "float16", "int8"):
        save_trained(tmp_path / "w.safetensors", trained(), precision)
        same, other = ResNet("tiny", 5), ResNet("tiny", 3)
        fresh = other.fc.weight.clone()
        assert load_weights(same, tmp_path / "w.safetensors")
        assert not load_weights(other, tmp_path / "w.safetensors")
        assert torch.equal(other.fc.weight, fresh)
        expected = load_trained(tmp_path / "w.safetensors").network
        assert torch.equal(same.fc.weight, expected.fc.weight)
        assert torch.equal(other.conv1.weight, expected.conv1.weight)


def refused(path, match):
    with pytest.raises(CheckpointError, match=match):
        load_trained(path)


def test_what_is_not_there_is_refused_with_what_is(tmp_path):
    refused(tmp_path / "w.safetensors", "there are no weights at .* that `gvp train` wrote, or one of those")
    refused("nobody", "there are no weights at 'nobody'")


def test_a_pickle_is_refused_whatever_it_is_called_and_no_code_in_it_runs(tmp_path):
    class Evil:
        def __reduce__(self):
            return (open, (str(tmp_path / "ran"), "w"))

    for name in ("evil.safetensors", "evil.pth"):
        (tmp_path / name).write_bytes(pickle.dumps(Evil()))
        refused(tmp_path / name, "cannot be read as safetensors")
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("share", [0.0, 0.001, 0.5, 0.999])
def test_a_file_that_ends_early_is_refused(share, tmp_path):
    save_trained(tmp_path / "w.safetensors", trained())
    data = (tmp_path / "w.safetensors").read_bytes()
    (tmp_path / "w.safetensors").write_bytes(data[: int(share * len(data))])
    refused(tmp_path / "w.safetensors", "cannot be read as safetensors .* is it whole")


def test_foreign_tensors_are_refused_with_the_way_to_use_them(tmp_path):
    file = tmp_path / "w.safetensors"
    save_file(trained().network.state_dict(), file)
    refused(file, r"not what they are of.*begin a training: TrainConfig\(weights=")
    for about, match in (("{", "is no JSON"), ("[]", "not what they are of"), ("{}", "it lacks network, target, size")):
        save_file(trained().network.state_dict(), file, {"gvp_lib": about})
        refused(file, match)


@pytest.mark.parametrize(
    ("about", "match"),
    [
        ({"network": "resnet999"}, "the network of .* is 'resnet999'; this version .* knows resnet50"),
        ({"network": "resnet18_half"}, "is not of 'resnet18_half' with 5 outputs: .* tensors are missing"),
        ({"network": []}, r"the network of .* is \[\]; this version .* knows resnet50"),
        ({"target": {}}, r"the target of .* is \{\}; .* knows action, tilt"),
        ({"size": True}, "size is a whole number from 1; got True"),
        ({"target": "roll"}, "the target of .* is 'roll'; .* knows action, tilt"),
        ({"target": "tilt"}, "has 5 outputs; of target 'tilt' it has 3"),
        ({"size": "large"}, "size is a whole number from 1; got 'large'"),
        ({"outputs": None}, "outputs is a whole number from 1; got None"),
    ],
)
def test_a_file_that_says_what_it_is_not_is_refused(about, match, tmp_path):
    file = tmp_path / "w.safetensors"
    save_file(trained().network.state_dict(), file, {"gvp_lib": json.dumps({**ABOUT, **about})})
    refused(file, match)


@pytest.mark.parametrize(
    ("name", "change", "match"),
    [
        ("conv1.weight", lambda tensor: tensor.long(), r"'conv1.weight' is of torch.int64; expected torch.float32"),
        ("bn1.num_batches_tracked", lambda tensor: tensor.float(), r"is of torch.float32; expected torch.int64"),
        ("conv1.weight", lambda tensor: tensor * np.nan, "'conv1.weight' holds numbers that are not finite"),
        ("bn1.running_var", lambda tensor: tensor * np.inf, "'bn1.running_var' holds numbers that are not finite"),
    ],
)
def test_numbers_that_are_no_weights_are_refused(name, change, match, tmp_path):
    file = tmp_path / "w.safetensors"
    tensors = trained().network.state_dict()
    save_file({**tensors, name: change(tensors[name])}, file, {"gvp_lib": json.dumps(ABOUT)})
    refused(file, match)


def test_whole_numbers_without_scales_are_refused(tmp_path):
    file = tmp_path / "w.safetensors"
    save_trained(file, trained(), "int8")
    tensors = load_file(file)
    for name, tensor in (
        ("conv1.weight|scale", None),
        ("conv1.weight|scale", torch.ones(3)),
        ("bn1.bias|scale", torch.ones(4)),
    ):
        changed = {key: value for key, value in tensors.items() if key != name}
        save_file(changed if tensor is None else {**changed, name: tensor}, file, {"gvp_lib": json.dumps(ABOUT)})
        refused(file, "is not int8 with a scale for each output channel")


def test_what_cannot_be_written_is_refused_and_what_was_there_is_kept(tmp_path):
    with pytest.raises(UnknownNameError, match="no precision named 'int4'"):
        save_trained(tmp_path / "w.safetensors", trained(), "int4")
    with pytest.raises(CheckpointError, match=r"ends in \.safetensors; got .*w\.pth"):
        save_trained(tmp_path / "w.pth", trained())
    (tmp_path / "file").touch()
    with pytest.raises(CheckpointError, match="cannot be written"):
        save_trained(tmp_path / "file" / "w.safetensors", trained())
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_every_network_s_name_is_in_the_file(tmp_path):
    save_trained(tmp_path / "w.safetensors", trained(command="gvp train set"))
    tensors, about = read_tensors(tmp_path / "w.safetensors")
    assert about["command"] == "gvp train set"
    assert about["network"] in NETWORKS
    assert np.prod(tensors["conv1.weight"].shape) == 8 * 3 * 49

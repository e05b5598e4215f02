"""Weights as files: what comes back, how exactly, and what is refused; downloaded, whole, broken or evil."""

import hashlib
import io
import json
import pickle
import socket
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from gvp_lib.errors import CheckpointError, DownloadError, UnknownNameError
from gvp_lib.learning import checkpoints
from gvp_lib.learning.checkpoints import (
    PUBLISHED,
    TrainedNetwork,
    load_trained,
    load_weights,
    read_tensors,
    save_trained,
)
from gvp_lib.learning.resnet import NETWORKS, Architecture, BasicBlock, Bottleneck, ResNet

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
    for about, match in (
        ("{", "cannot be read"),
        ("[]", "not what they are of"),
        ("{}", "it lacks network, target"),
    ):
        save_file(trained().network.state_dict(), file, {"gvp_lib": about})
        refused(file, match)


@pytest.mark.parametrize(
    ("about", "match"),
    [
        ({"network": "resnet999"}, "the network of .* is 'resnet999'; this version .* knows resnet50"),
        ({"network": "resnet18_half"}, "is not of this network: .* As a whole it would fit 'tiny'"),
        ({"network": []}, r"the network of .* is \[\]; this version .* knows resnet50"),
        ({"target": {}}, r"the target of .* is \{\}; .* knows action, tilt"),
        ({"size": True}, "size is a whole number from 1; got True"),
        ({"target": "roll"}, "the target of .* is 'roll'; .* knows action, tilt"),
        ({"target": "tilt"}, "has 5 outputs; of target 'tilt' it has 3"),
        ({"size": "large"}, "size is a whole number from 1; got 'large'"),
        ({"outputs": None}, "has None outputs; of target 'action' it has 5"),
    ],
)
def test_a_file_that_says_what_it_is_not_is_refused(about, match, tmp_path):
    file = tmp_path / "w.safetensors"
    save_file(trained().network.state_dict(), file, {"gvp_lib": json.dumps({**ABOUT, **about})})
    refused(file, match)


@pytest.mark.parametrize(
    ("name", "change", "match"),
    [
        (
            "conv1.weight",
            lambda tensor: tensor.long(),
            "conv1.weight is of torch.int64, where .* torch.float32",
        ),
        (
            "bn1.num_batches_tracked",
            lambda tensor: tensor.float(),
            "is of torch.float32, where .* torch.int64",
        ),
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


# --- weights to begin with ------------------------------------------------------------------------------------------


def network(outputs=5, seed=0, name="tiny"):
    torch.manual_seed(seed)
    network = ResNet(name, outputs)
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.running_mean.normal_()
            module.num_batches_tracked += 3
    return network


def saved(state):
    file = io.BytesIO()
    torch.save(state, file)
    return file.getvalue()


def is_the_same(first, second, head=True):
    first, second = first.state_dict(), second.state_dict()
    return all(torch.equal(first[name], second[name]) for name in first if head or not name.startswith("fc."))


def not_loaded(match, path, into=None):
    """A file is refused with these words, and the network is as it was."""
    into = network(seed=9) if into is None else into
    before = {name: tensor.clone() for name, tensor in into.state_dict().items()}
    with pytest.raises(CheckpointError, match=match):
        load_weights(into, path)
    assert all(torch.equal(before[name], tensor) for name, tensor in into.state_dict().items())


@pytest.fixture
def publisher(monkeypatch, tmp_path):
    """A server of files, and an empty cache; ``publisher.files`` maps paths to bytes, ``publisher.asked`` is a log."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            server.asked.append(self.path)
            if self.path not in server.files:
                self.send_error(404)
                return
            data = server.files[self.path]
            self.send_response(200)
            self.send_header("Content-Length", str(len(data) + server.withheld))
            self.end_headers()
            self.wfile.write(data)

        def log_message(self, *args):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.files, server.asked, server.withheld, server.cache = {}, [], 0, tmp_path / "torch" / "hub" / "checkpoints"
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "torch"))
    monkeypatch.setenv("no_proxy", "*")
    monkeypatch.setattr(torch.hub, "_hub_dir", None)
    monkeypatch.setattr(checkpoints, "_PUBLISHER", f"http://127.0.0.1:{server.server_port}/models/")
    yield server
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.fixture
def publish(publisher, monkeypatch):
    def publish(data, name=None, path="tiny"):
        name = name or f"{path}-{hashlib.sha256(data).hexdigest()[:8]}.pth"
        monkeypatch.setitem(checkpoints.PUBLISHED, path, name)
        publisher.files[f"/models/{name}"] = data
        return publisher.cache / name

    return publish


def test_none_leaves_a_network_as_it_is():
    before, after = network(), network()
    assert load_weights(after, None) is False
    assert is_the_same(before, after)


def test_published_files_carry_the_start_of_their_checksum():
    assert PUBLISHED == {"resnet50": "resnet50-0676ba61.pth", "resnet18": "resnet18-f37072fd.pth"}
    assert checkpoints._PUBLISHER == "https://download.pytorch.org/models/"


def test_published_weights_are_fetched_once_and_kept_where_torchvision_keeps_them(publisher, publish):
    trained, own = network(1000, 1), network(5, 2)
    file, head = publish(saved(trained.state_dict())), own.fc.weight.clone()
    assert load_weights(own, "imagenet") is False
    assert is_the_same(trained, own, head=False)
    assert torch.equal(own.fc.weight, head)
    assert [path.name for path in publisher.cache.iterdir()] == [file.name]
    whole = network(1000, 3)
    assert load_weights(whole, "imagenet") is True
    assert is_the_same(trained, whole)
    assert len(publisher.asked) == 1


def test_the_shapes_of_an_architecture_cost_no_random_number(publisher, publish):
    publish(saved(network(1000).state_dict()))
    own = network()
    before = torch.get_rng_state()
    load_weights(own, "imagenet")
    assert torch.equal(before, torch.get_rng_state())


def test_a_file_of_another_checksum_is_refused_and_not_kept(publisher, publish):
    publish(saved(network(1000).state_dict()), name="tiny-00000000.pth")
    with pytest.raises(DownloadError, match=r"models/tiny-00000000.pth cannot be downloaded.*invalid hash value"):
        load_weights(network(), "imagenet")
    assert list(publisher.cache.parent.rglob("*.pth*")) == []


def test_a_download_that_ends_early_is_refused_and_not_kept(publisher, publish):
    publish(saved(network(1000).state_dict()))
    publisher.withheld = 100
    data = next(iter(publisher.files.values()))
    publisher.files = dict.fromkeys(publisher.files, data[:-100])
    with pytest.raises(DownloadError, match="tiny-"):
        load_weights(network(), "imagenet")
    assert list(publisher.cache.parent.rglob("*.pth*")) == []


def test_code_in_a_file_of_the_wrong_checksum_is_not_even_read(publisher, publish, tmp_path, monkeypatch):
    publish(b"anything", name="tiny-00000000.pth")
    monkeypatch.setattr(torch, "load", lambda *args, **kwargs: pytest.fail("opened"))
    with pytest.raises(DownloadError):
        load_weights(network(), "imagenet")


def test_a_damaged_file_in_the_cache_is_fetched_anew(publisher, publish):
    trained, own = network(1000, 1), network(5, 2)
    file = publish(saved(trained.state_dict()))
    file.parent.mkdir(parents=True)
    file.write_bytes(b"half a file")
    load_weights(own, "imagenet")
    assert is_the_same(trained, own, head=False)
    assert file.read_bytes() == publisher.files[f"/models/{file.name}"]


def test_without_a_network_the_text_says_what_was_tried_and_what_would_work(publisher, publish):
    trained, own = network(1000, 1), network(5, 2)
    data = saved(trained.state_dict())
    file = publish(data)
    publisher.files.clear()
    with pytest.raises(DownloadError) as caught:
        load_weights(own, "imagenet")
    for words in (
        f"{checkpoints._PUBLISHER}{file.name} cannot be downloaded to {file}",
        "Put the file there by hand",
        "weights=None",
    ):
        assert words in str(caught.value)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(data)
    load_weights(own, "imagenet")
    assert is_the_same(trained, own, head=False)


def test_a_server_that_cannot_be_reached_is_a_download_error(publisher, publish, monkeypatch):
    publish(b"anything")
    monkeypatch.setattr(checkpoints, "_PUBLISHER", "http://127.0.0.1:1/models/")
    with pytest.raises(DownloadError, match=r"cannot be downloaded.*refused"):
        load_weights(network(), "imagenet")


def test_a_server_that_says_nothing_is_given_up(publisher, publish, monkeypatch):
    publish(b"anything")
    monkeypatch.setattr(checkpoints, "_PATIENCE", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        monkeypatch.setattr(checkpoints, "_PUBLISHER", f"http://127.0.0.1:{silent.getsockname()[1]}/models/")
        with pytest.raises(DownloadError, match=r"cannot be downloaded.*timed out"):
            load_weights(network(), "imagenet")
    assert socket.getdefaulttimeout() is None


def test_a_cache_that_cannot_be_written_says_how_to_name_another(publisher, publish, tmp_path):
    publish(saved(network(1000).state_dict()))
    (tmp_path / "torch").write_text("a file where the folder should be")
    with pytest.raises(DownloadError, match=r"cannot be downloaded.*Not a directory.*TORCH_HOME"):
        load_weights(network(), "imagenet")


@pytest.mark.parametrize("name", ["resnet18_half", "tiny"])
def test_a_network_that_nobody_trained_on_imagenet_has_no_such_weights(name):
    with pytest.raises(CheckpointError, match=f"no published weights.*'{name}'.*'resnet50' and 'resnet18'.*None"):
        load_weights(ResNet(name), "imagenet")


def test_nor_has_an_architecture_of_one_s_own():
    with pytest.raises(CheckpointError, match="for this architecture"):
        load_weights(ResNet(Architecture(BasicBlock, (1, 1, 1, 2), width=8)), "imagenet")


@pytest.mark.parametrize("suffix", [".safetensors", ".pth", ".pt"])
def test_a_file_gives_its_weights(tmp_path, suffix):
    trained, own = network(5, 1), network(5, 2)
    file = tmp_path / f"trained{suffix}"
    (save_file if suffix == ".safetensors" else torch.save)(trained.state_dict(), file)
    assert load_weights(own, file) is True
    assert is_the_same(trained, own)


def test_another_number_of_outputs_keeps_the_network_s_own_final_layer(tmp_path):
    trained, own, untouched = network(5, 1), network(2, 2), network(2, 2)
    save_file(trained.state_dict(), tmp_path / "actions.safetensors")
    assert load_weights(own, str(tmp_path / "actions.safetensors")) is False
    assert is_the_same(trained, own, head=False)
    assert torch.equal(own.fc.weight, untouched.fc.weight)
    assert torch.equal(own.fc.bias, untouched.fc.bias)


def test_an_old_file_without_counters_of_batches_is_read(tmp_path):
    trained, own = network(5, 1), ResNet("tiny", 5)
    state = {name: t for name, t in trained.state_dict().items() if not name.endswith("num_batches_tracked")}
    torch.save(state, tmp_path / "old.pth", _use_new_zipfile_serialization=False)
    assert load_weights(own, tmp_path / "old.pth") is True
    assert torch.equal(own.layer4[0].bn2.running_mean, trained.layer4[0].bn2.running_mean)
    assert own.bn1.num_batches_tracked == 0


def test_a_file_of_parameters_and_halves_is_read(tmp_path):
    """As older files hold parameters, and smaller ones half precision."""
    trained, own = network(5, 1).half(), network(5, 2)
    torch.save({n: torch.nn.Parameter(t, t.is_floating_point()) for n, t in trained.named_parameters()}
               | dict(trained.named_buffers()), tmp_path / "half.pth")  # fmt: skip
    assert load_weights(own, tmp_path / "half.pth") is True
    assert own.conv1.weight.dtype == torch.float32
    assert torch.equal(own.conv1.weight, trained.conv1.weight.float())


def test_a_file_of_another_architecture_is_refused_with_what_differs_and_what_would_fit(tmp_path, monkeypatch):
    monkeypatch.setitem(NETWORKS, "tiny_bottleneck", Architecture(Bottleneck, (1, 1, 1, 1), width=8))
    torch.save(network(7, name="tiny_bottleneck").state_dict(), tmp_path / "other.pth")
    not_loaded(
        r"other\.pth is not of this network: .+; .+; .+; and \d+ differences more\. As a whole it would fit "
        "'tiny_bottleneck'",
        tmp_path / "other.pth",
    )


def test_a_file_that_lacks_holds_more_or_holds_another_shape_says_so_by_name(tmp_path):
    state = network().state_dict()
    del state["layer1.0.conv2.weight"]
    state["conv1.weight"], state["extra"] = torch.zeros(8, 1, 7, 7), torch.zeros(1)
    torch.save(state, tmp_path / "odd.pt")
    not_loaded(
        r"lacks layer1\.0\.conv2\.weight; its conv1\.weight is \(8, 1, 7, 7\), where the network's is \(8, 3, 7, 7\); "
        r"it has extra, which the network lacks\. .*it fits none of resnet50",
        tmp_path / "odd.pt",
    )


def test_whole_numbers_and_a_final_layer_of_another_width_are_refused(tmp_path):
    state = network().state_dict()
    torch.save(state | {"conv1.weight": state["conv1.weight"].to(torch.int8)}, tmp_path / "whole.pt")
    not_loaded(r"its conv1\.weight is of torch\.int8, where the network's is of torch\.float32", tmp_path / "whole.pt")
    torch.save(state | {"fc.weight": torch.zeros(9, 8), "fc.bias": torch.zeros(9)}, tmp_path / "head.pt")
    not_loaded(r"its fc\.weight is \(9, 8\), where", tmp_path / "head.pt")
    torch.save({name: t for name, t in state.items() if name != "fc.bias"}, tmp_path / "bias.pt")
    not_loaded(r"it lacks fc\.bias", tmp_path / "bias.pt")


class Evil:
    """A pickle that writes a file when it is read as pickles are."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.write_text, (self.path, "I ran")


@pytest.mark.parametrize("archive", [True, False])
def test_code_in_a_file_does_not_run(tmp_path, archive):
    trace, file = tmp_path / "trace", tmp_path / "evil.pth"
    torch.save(network().state_dict() | {"x": Evil(trace)}, file, _use_new_zipfile_serialization=archive)
    torch.load(file, weights_only=False)
    assert trace.exists()  # it is evil indeed
    trace.unlink()
    not_loaded("holds other objects than tensors; those can run code, so they were not loaded", file)
    file.write_bytes(pickle.dumps(Evil(trace), protocol=2))
    not_loaded("not loaded", file)
    assert not trace.exists()


def test_nor_does_code_in_a_published_file(publisher, publish, tmp_path):
    publish(saved({"x": Evil(tmp_path / "trace")}))
    not_loaded("not loaded", "imagenet")
    assert not (tmp_path / "trace").exists()


def test_a_whole_training_is_no_state_dict(tmp_path):
    torch.save({"epoch": 3, "state_dict": network().state_dict()}, tmp_path / "training.pt")
    not_loaded("no tensors by name, but 'epoch', 'state_dict'; save what torch.save", tmp_path / "training.pt")
    torch.save([torch.zeros(2)], tmp_path / "list.pt")
    not_loaded("no tensors by name, but list", tmp_path / "list.pt")


@pytest.mark.parametrize("share", [0, 0.01, 0.5, 0.999])
def test_a_pickle_that_ends_early_is_damaged(tmp_path, share):
    file = tmp_path / "cut.pth"
    torch.save(network().state_dict(), file)
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    not_loaded("is damaged", file)


@pytest.mark.parametrize("weights", ["ImageNet", "none.pth", "notes.txt", "."])
def test_what_is_no_file_of_weights_is_refused_with_what_would_be(tmp_path, monkeypatch, weights):
    monkeypatch.chdir(tmp_path)
    Path("notes.txt").write_text("x")
    not_loaded(r"no weights at '.*'; give 'imagenet', None.*\.safetensors, \.pth, \.pt", weights)

"""Weights to begin with: fetched from a server on this machine, or read from files that are whole, broken or evil."""

import hashlib
import io
import pickle
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

from gvp_lib.errors import CheckpointError, DownloadError
from gvp_lib.learning import pretrained
from gvp_lib.learning.pretrained import PUBLISHED, load_weights
from gvp_lib.learning.resnet import NETWORKS, Architecture, BasicBlock, Bottleneck, ResNet


@pytest.fixture(autouse=True)
def tiny(monkeypatch):
    """Two architectures so small that a file of them is some 100 kB."""
    monkeypatch.setitem(NETWORKS, "tiny", Architecture(BasicBlock, (1, 1, 1, 1), width=8))
    monkeypatch.setitem(NETWORKS, "tiny_bottleneck", Architecture(Bottleneck, (1, 1, 1, 1), width=8))


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


def refused(match, path, into=None):
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
    monkeypatch.setattr(pretrained, "_PUBLISHER", f"http://127.0.0.1:{server.server_port}/models/")
    yield server
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.fixture
def publish(publisher, monkeypatch):
    def publish(data, name=None, path="tiny"):
        name = name or f"{path}-{hashlib.sha256(data).hexdigest()[:8]}.pth"
        monkeypatch.setitem(pretrained.PUBLISHED, path, name)
        publisher.files[f"/models/{name}"] = data
        return publisher.cache / name

    return publish


def test_none_leaves_a_network_as_it_is():
    before, after = network(), network()
    assert load_weights(after, None) is False
    assert is_the_same(before, after)


def test_published_files_carry_the_start_of_their_checksum():
    assert PUBLISHED == {"resnet50": "resnet50-0676ba61.pth", "resnet18": "resnet18-f37072fd.pth"}
    assert pretrained._PUBLISHER == "https://download.pytorch.org/models/"


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
    with pytest.raises(DownloadError, match=r"models/tiny-00000000.pth.*SHA-256 does not begin.*Nothing was kept"):
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
        f"{pretrained._PUBLISHER}{file.name} cannot be fetched",
        f"put the file at {file} by hand",
        "weights=None",
    ):
        assert words in str(caught.value)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(data)
    load_weights(own, "imagenet")
    assert is_the_same(trained, own, head=False)


def test_a_server_that_cannot_be_reached_is_a_download_error(publisher, publish, monkeypatch):
    publish(b"anything")
    monkeypatch.setattr(pretrained, "_PUBLISHER", "http://127.0.0.1:1/models/")
    with pytest.raises(DownloadError, match=r"cannot be fetched \(.*refused"):
        load_weights(network(), "imagenet")


def test_a_cache_that_cannot_be_written_says_how_to_name_another(publisher, publish, tmp_path):
    publish(saved(network(1000).state_dict()))
    (tmp_path / "torch").write_text("a file where the folder should be")
    with pytest.raises(DownloadError, match=r"cannot be written.*TORCH_HOME"):
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


def test_a_file_of_another_architecture_is_refused_with_what_differs_and_what_would_fit(tmp_path):
    torch.save(network(7, name="tiny_bottleneck").state_dict(), tmp_path / "other.pth")
    refused(
        r"other\.pth is not of this network: .+; .+; .+; and \d+ differences more\. As a whole it would fit "
        "'tiny_bottleneck'",
        tmp_path / "other.pth",
    )


def test_a_file_that_lacks_holds_more_or_holds_another_shape_says_so_by_name(tmp_path):
    state = network().state_dict()
    del state["layer1.0.conv2.weight"]
    state["conv1.weight"], state["extra"] = torch.zeros(8, 1, 7, 7), torch.zeros(1)
    torch.save(state, tmp_path / "odd.pt")
    refused(
        r"lacks layer1\.0\.conv2\.weight; its conv1\.weight is \(8, 1, 7, 7\), where the network's is \(8, 3, 7, 7\); "
        r"it has extra, which the network lacks\. .*it fits none of resnet50",
        tmp_path / "odd.pt",
    )


def test_whole_numbers_and_a_final_layer_of_another_width_are_refused(tmp_path):
    state = network().state_dict()
    torch.save(state | {"conv1.weight": state["conv1.weight"].to(torch.int8)}, tmp_path / "whole.pt")
    refused(r"its conv1\.weight is of torch\.int8, where the network's is of torch\.float32", tmp_path / "whole.pt")
    torch.save(state | {"fc.weight": torch.zeros(9, 8), "fc.bias": torch.zeros(9)}, tmp_path / "head.pt")
    refused(r"its fc\.weight is \(9, 8\), where", tmp_path / "head.pt")
    torch.save({name: t for name, t in state.items() if name != "fc.bias"}, tmp_path / "bias.pt")
    refused(r"it lacks fc\.bias", tmp_path / "bias.pt")


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
    refused("holds other objects than tensors; those can run code, so they were not loaded", file)
    file.write_bytes(pickle.dumps(Evil(trace), protocol=2))
    refused("not loaded", file)
    assert not trace.exists()


def test_nor_does_code_in_a_published_file(publisher, publish, tmp_path):
    publish(saved({"x": Evil(tmp_path / "trace")}))
    refused("not loaded", "imagenet")
    assert not (tmp_path / "trace").exists()


def test_a_whole_training_is_no_state_dict(tmp_path):
    torch.save({"epoch": 3, "state_dict": network().state_dict()}, tmp_path / "training.pt")
    refused("no tensors by name, but 'epoch', 'state_dict'; save what torch.save", tmp_path / "training.pt")
    torch.save([torch.zeros(2)], tmp_path / "list.pt")
    refused("no tensors by name, but list", tmp_path / "list.pt")


@pytest.mark.parametrize("suffix", [".safetensors", ".pth"])
@pytest.mark.parametrize("share", [0, 0.01, 0.5, 0.999])
def test_a_file_that_ends_early_is_damaged(tmp_path, suffix, share):
    file = tmp_path / f"cut{suffix}"
    (save_file if suffix == ".safetensors" else torch.save)(network().state_dict(), file)
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    refused("is it whole" if suffix == ".safetensors" else "is damaged", file)


@pytest.mark.parametrize("weights", ["ImageNet", "none.pth", "notes.txt", "."])
def test_what_is_no_file_of_weights_is_refused_with_what_would_be(tmp_path, monkeypatch, weights):
    monkeypatch.chdir(tmp_path)
    Path("notes.txt").write_text("x")
    refused(r"no weights at '.*'; give 'imagenet', None.*\.safetensors, \.pth, \.pt", weights)

"""Residual networks against the published table of layers and a second, functional implementation."""

import numpy as np
import pytest
import torch
from torch.nn import functional as F

from gvp_lib.errors import InvalidImageError, InvalidParameterError, UnknownNameError
from gvp_lib.learning.resnet import NETWORKS, Architecture, BasicBlock, ResNet, normalized

# He et al. 2016, Table 1: of each stage, its blocks and the (kernel, channels) of a block's convolutions.
TABLE = {
    "resnet50": (
        (3, ((1, 64), (3, 64), (1, 256))),
        (4, ((1, 128), (3, 128), (1, 512))),
        (6, ((1, 256), (3, 256), (1, 1024))),
        (3, ((1, 512), (3, 512), (1, 2048))),
    ),
    "resnet18": tuple((2, ((3, channels), (3, channels))) for channels in (64, 128, 256, 512)),
}


def expected_shapes(name, outputs):
    """Torchvision's names and shapes, from the table."""
    shapes = {}

    def unit(convolution, norm, kernel, before, after):
        shapes[f"{convolution}.weight"] = (after, before, kernel, kernel)
        shapes.update({f"{norm}.{entry}": (after,) for entry in ("weight", "bias", "running_mean", "running_var")})
        shapes[f"{norm}.num_batches_tracked"] = ()

    unit("conv1", "bn1", 7, 3, 64)
    channels = 64
    for stage, (count, convolutions) in enumerate(TABLE[name], start=1):
        for block in range(count):
            stem, before = f"layer{stage}.{block}", channels
            for number, (kernel, after) in enumerate(convolutions, start=1):
                unit(f"{stem}.conv{number}", f"{stem}.bn{number}", kernel, before, after)
                before = after
            if block == 0 and (stage > 1 or channels != after):
                unit(f"{stem}.downsample.0", f"{stem}.downsample.1", 1, channels, after)
            channels = after
    return shapes | {"fc.weight": (outputs, channels), "fc.bias": (outputs,)}


def forward(state, x, training=False):
    """What the names of a state dict say, read by an outsider: no module, no class, no table."""

    def unit(x, convolution, norm, stride=1):
        weight = state[f"{convolution}.weight"]
        x = F.conv2d(x, weight, stride=stride, padding=weight.shape[-1] // 2)
        if training:
            mean, variance = x.mean(dim=(0, 2, 3)), x.var(dim=(0, 2, 3), correction=0)
        else:
            mean, variance = state[f"{norm}.running_mean"], state[f"{norm}.running_var"]
        scale = state[f"{norm}.weight"] / (variance + 1e-5).sqrt()
        return x * scale[:, None, None] + (state[f"{norm}.bias"] - mean * scale)[:, None, None]

    x = F.max_pool2d(unit(x, "conv1", "bn1", 2).relu(), 3, 2, padding=1)
    blocks = sorted({tuple(name.split(".")[:2]) for name in state if name.startswith("layer")})
    for stage, block in blocks:
        stem = f"{stage}.{block}"
        numbers = [n for n in (1, 2, 3) if f"{stem}.conv{n}.weight" in state]
        shrinks = 2 if block == "0" and stage != "layer1" else 1
        strided = next(n for n in numbers if state[f"{stem}.conv{n}.weight"].shape[-1] == 3)  # the first 3x3
        y = x
        for n in numbers:
            y = unit(y, f"{stem}.conv{n}", f"{stem}.bn{n}", shrinks if n == strided else 1)
            y = y.relu() if n < numbers[-1] else y
        if f"{stem}.downsample.0.weight" in state:
            x = unit(x, f"{stem}.downsample.0", f"{stem}.downsample.1", shrinks)
        x = (x + y).relu()
    return x.mean(dim=(2, 3)) @ state["fc.weight"].T + state["fc.bias"]


def random_state(name, seed=0):
    """Weights that keep a signal's size, and statistics that are not batch normalization's defaults."""
    rng, state = np.random.default_rng(seed), {}
    for key, shape in expected_shapes(name, 5).items():
        if key.endswith("num_batches_tracked"):
            state[key] = torch.tensor(7)
            continue
        if len(shape) > 1:
            values = rng.normal(0, np.sqrt(2 / np.prod(shape[1:])), shape)
        elif key.endswith("running_var"):
            values = rng.uniform(0.5, 1.5, shape)
        elif key.endswith("weight"):  # of a norm
            values = rng.uniform(0.3, 0.9, shape)
        else:
            values = rng.normal(0, 0.3, shape)
        state[key] = torch.from_numpy(values.astype(np.float32))
    return state


@pytest.fixture(scope="module", params=["resnet50", "resnet18"])
def loaded(request):
    state = random_state(request.param)
    network = ResNet(request.param, 5)
    network.load_state_dict(state)
    return network.eval(), state


def test_resnet50_has_161_parameters_and_320_entries_of_the_published_shapes():
    network = ResNet("resnet50", 1000)
    state = {name: tuple(tensor.shape) for name, tensor in network.state_dict().items()}
    assert state == expected_shapes("resnet50", 1000)
    assert (len(list(network.parameters())), len(state)) == (161, 320)
    assert sum(parameter.numel() for parameter in network.parameters()) == 25_557_032  # torchvision's documentation


def test_resnet18_has_the_published_shapes():
    network = ResNet("resnet18", 1000)
    assert {name: tuple(tensor.shape) for name, tensor in network.state_dict().items()} == expected_shapes(
        "resnet18", 1000
    )
    assert sum(parameter.numel() for parameter in network.parameters()) == 11_689_512


@pytest.mark.parametrize("size", [64, 96])
def test_outputs_are_those_of_a_second_implementation(loaded, size):
    network, state = loaded
    x = torch.randn(3, 3, size, size, generator=torch.Generator().manual_seed(size))
    with torch.no_grad():
        got, expected = network(x), forward(state, x)
    assert 0.1 < expected.abs().max() < 10
    assert (expected[0] - expected[1]).abs().max() > 0.01  # they depend on the picture
    torch.testing.assert_close(got, expected, atol=1e-5, rtol=0)


def test_in_training_a_batch_is_normalized_by_its_own_statistics():
    state = random_state("resnet18")
    network = ResNet("resnet18", 5)
    network.load_state_dict(state)
    x = torch.randn(8, 3, 64, 64, generator=torch.Generator().manual_seed(1))
    with torch.no_grad():
        got, expected = network.train()(x), forward(state, x, training=True)
    assert (got - expected).abs().max() < 1e-4 * expected.abs().max()
    assert network.bn1.num_batches_tracked == 8


def test_channels_last_changes_no_output(loaded):
    network, state = loaded
    x = torch.randn(2, 3, 64, 64, generator=torch.Generator().manual_seed(2))
    try:
        with torch.no_grad():
            got = network.to(memory_format=torch.channels_last)(x.to(memory_format=torch.channels_last))
            torch.testing.assert_close(got, forward(state, x), atol=1e-5, rtol=0)
    finally:
        network.to(memory_format=torch.contiguous_format)


def test_it_begins_as_torchvision_s_does():
    torch.manual_seed(0)
    network = ResNet("resnet18", 5)
    for name, parameter in network.named_parameters():
        if parameter.dim() == 4:  # Kaiming's normal distribution, by the outputs
            std = np.sqrt(2 / (parameter.shape[0] * parameter.shape[2] * parameter.shape[3]))
            assert abs(parameter.std().item() / std - 1) < 6 / np.sqrt(2 * parameter.numel()), name
        elif "bn" in name or "downsample" in name:
            assert (parameter == (1 if name.endswith("weight") else 0)).all(), name
    bound = 1 / np.sqrt(512)
    assert 0.98 * bound < network.fc.weight.abs().max() <= bound
    assert network.fc.bias.abs().max() <= bound


def test_pictures_are_normalized_by_channel():
    images = torch.rand(2, 3, 4, 5)
    expected = (images.numpy() - np.reshape([0.485, 0.456, 0.406], (3, 1, 1))) / np.reshape(
        [0.229, 0.224, 0.225], (3, 1, 1)
    )
    kept = images.clone()
    np.testing.assert_allclose(normalized(images).numpy(), expected, atol=1e-6)
    assert torch.equal(images, kept)
    last = normalized(images.to(memory_format=torch.channels_last))
    assert last.is_contiguous(memory_format=torch.channels_last)


def test_pictures_normalized_first_in_inference_can_be_in_training_later():
    with torch.inference_mode():
        normalized(torch.rand(1, 3, 2, 2, dtype=torch.float64))
    images = torch.rand(1, 3, 2, 2, dtype=torch.float64, requires_grad=True)
    normalized(images).sum().backward()
    np.testing.assert_allclose(images.grad[0, :, 0, 0], 1 / np.array([0.229, 0.224, 0.225]))


def test_bytes_are_no_pictures_for_a_network():
    with pytest.raises(InvalidImageError, match=r"in \[0, 1\]; got torch.uint8"):
        normalized(torch.zeros(1, 3, 4, 4, dtype=torch.uint8))


def test_an_unknown_network_is_named_with_those_that_are_known():
    with pytest.raises(UnknownNameError, match=r"Did you mean 'resnet50'.*resnet18_half"):
        ResNet("resnet51")
    assert set(NETWORKS) == {"resnet50", "resnet18", "resnet18_half"}


def test_a_network_without_outputs_or_blocks_is_refused():
    with pytest.raises(InvalidParameterError, match="one output or more; got 0"):
        ResNet("resnet18", 0)
    for blocks, width in (((1, 1, 0, 1), 8), ((1, 1, 1), 8), ((1, 1, 1, 1), 0)):
        with pytest.raises(InvalidParameterError, match="four stages of one block or more"):
            Architecture(BasicBlock, blocks, width)

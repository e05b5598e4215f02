"""Residual networks against their published sizes and a second, functional implementation by torchvision's names."""

import numpy as np
import pytest
import torch
from torch.nn import functional as F

from gvp_lib.errors import InvalidImageError, InvalidParameterError, UnknownNameError
from gvp_lib.learning.resnet import Architecture, BasicBlock, ResNet, normalized


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


def unsettled(name):
    """A network that keeps a signal's size, with statistics that are not batch normalization's defaults."""
    torch.manual_seed(0)
    network = ResNet(name, 5)
    for module in network.modules():
        if isinstance(module, torch.nn.Conv2d):
            torch.nn.init.kaiming_normal_(module.weight)
        if isinstance(module, torch.nn.BatchNorm2d):
            for tensor, low, high in (
                (module.weight, 0.3, 0.9), (module.bias, -0.5, 0.5),
                (module.running_mean, -0.5, 0.5), (module.running_var, 0.5, 1.5),
            ):  # fmt: skip
                torch.nn.init.uniform_(tensor, low, high)
    return network


# He et al. 2016, Table 1, and torchvision's documentation: blocks of each stage, channels of the last, and parameters.
@pytest.mark.parametrize(
    ("name", "blocks", "channels", "tensors", "entries", "parameters"),
    [
        ("resnet50", (3, 4, 6, 3), 2048, 161, 320, 25_557_032),
        ("resnet18", (2, 2, 2, 2), 512, 62, 122, 11_689_512),
    ],
)
def test_networks_have_the_published_size_and_forward_is_a_second_implementation_s(
    name, blocks, channels, tensors, entries, parameters
):
    published = ResNet(name, 1000)
    assert tuple(map(len, (published.layer1, published.layer2, published.layer3, published.layer4))) == blocks
    assert published.fc.weight.shape == (1000, channels)
    assert (len(list(published.parameters())), len(published.state_dict())) == (tensors, entries)
    assert sum(parameter.numel() for parameter in published.parameters()) == parameters
    network = unsettled(name).eval()
    for size in (64, 96):
        x = torch.randn(3, 3, size, size, generator=torch.Generator().manual_seed(size))
        with torch.no_grad():
            got, expected = network(x), forward(network.state_dict(), x)
        assert (expected[0] - expected[1]).abs().max() > 0.01  # they depend on the picture
        torch.testing.assert_close(got, expected, atol=1e-5, rtol=0)
        with torch.no_grad():
            last = network.to(memory_format=torch.channels_last)(x.to(memory_format=torch.channels_last))
        torch.testing.assert_close(last, got, atol=1e-5, rtol=0)


def test_in_training_a_batch_is_normalized_by_its_own_statistics():
    network = unsettled("resnet18").train()
    state = {name: tensor.clone() for name, tensor in network.state_dict().items()}
    x = torch.randn(8, 3, 64, 64, generator=torch.Generator().manual_seed(1))
    with torch.no_grad():
        got, expected = network(x), forward(state, x, training=True)
    assert (got - expected).abs().max() < 1e-4 * expected.abs().max()
    assert network.bn1.num_batches_tracked == 1


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


def test_pictures_are_normalized_by_channel_in_inference_and_in_training_after_it():
    with torch.inference_mode():
        normalized(torch.rand(1, 3, 2, 2, dtype=torch.float64))
    images = torch.rand(2, 3, 4, 5, dtype=torch.float64, requires_grad=True)
    mean, std = (np.reshape(each, (3, 1, 1)) for each in ([0.485, 0.456, 0.406], [0.229, 0.224, 0.225]))
    found = normalized(images)
    np.testing.assert_allclose(found.detach(), (images.detach().numpy() - mean) / std, atol=1e-6)
    found.sum().backward()
    np.testing.assert_allclose(images.grad[0, :, 0, 0], 1 / std.ravel())
    last = normalized(images.to(memory_format=torch.channels_last))
    assert last.is_contiguous(memory_format=torch.channels_last)


@pytest.mark.parametrize(
    ("make", "error", "said"),
    [
        (lambda: ResNet("resnet51"), UnknownNameError, r"Did you mean 'resnet50'.*resnet18_half"),
        (lambda: ResNet("resnet18", 0), InvalidParameterError, "one output or more; got 0"),
        (lambda: Architecture(BasicBlock, (1, 1, 0, 1), 8), InvalidParameterError, "four stages of one block or more"),
        (lambda: Architecture(BasicBlock, (1, 1, 1), 8), InvalidParameterError, "four stages of one block or more"),
        (lambda: Architecture(BasicBlock, (1, 1, 1, 1), 4), InvalidParameterError, "8 channels or more; got .* 4"),
        (lambda: normalized(torch.zeros(1, 3, 4, 4, dtype=torch.uint8)), InvalidImageError, "got torch.uint8"),
    ],
)  # fmt: skip
def test_misuse_is_refused_with_what_would_do(make, error, said):
    with pytest.raises(error, match=said):
        make()

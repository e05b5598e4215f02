"""Residual networks against their published sizes and a second, functional implementation by torchvision's names."""

import numpy as np
import pytest
import torch
from torch.nn import functional as F

from gvp_lib.errors import GvpError
from gvp_lib.learning.resnet import Architecture, BasicBlock, ResNet, normalized


def forward(state, x):
    """What the names of a state dict say, read by an outsider: no module, no class, no table."""

    def unit(x, convolution, norm, stride=1):
        weight = state[f"{convolution}.weight"]
        x = F.conv2d(x, weight, stride=stride, padding=weight.shape[-1] // 2)
        scale = state[f"{norm}.weight"] / (state[f"{norm}.running_var"] + 1e-5).sqrt()
        offset = state[f"{norm}.bias"] - state[f"{norm}.running_mean"] * scale
        return x * scale[:, None, None] + offset[:, None, None]

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


# He et al. 2016, Table 1, and torchvision's documentation: parameters, their tensors, and entries of the state.
@pytest.mark.parametrize(
    ("name", "parameters", "tensors", "entries"),
    [("resnet50", 25_557_032, 161, 320), ("resnet18", 11_689_512, 62, 122)],
)
def test_networks_have_the_published_size_and_forward_is_a_second_implementation_s(name, parameters, tensors, entries):
    torch.manual_seed(0)
    network = ResNet(name, 1000).eval()
    sizes = [parameter.numel() for parameter in network.parameters()]
    assert (sum(sizes), len(sizes), len(network.state_dict())) == (parameters, tensors, entries)
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):  # statistics that are not the default
            for tensor, low, high in (
                (module.weight, 0.5, 1.5), (module.bias, -0.5, 0.5),
                (module.running_mean, -0.5, 0.5), (module.running_var, 0.2, 1.0),
            ):  # fmt: skip
                torch.nn.init.uniform_(tensor, low, high)
    x = torch.randn(3, 3, 96, 96)
    with torch.no_grad():
        got, expected = network(x), forward(network.state_dict(), x)
    assert (expected[0] - expected[1]).abs().max() > 0.01  # they depend on the picture
    torch.testing.assert_close(got, expected, atol=1e-5 * float(expected.abs().max()), rtol=0)


def test_convolutions_begin_as_torchvision_s_do():
    torch.manual_seed(0)
    for name, parameter in ResNet("resnet18", 5).named_parameters():
        if parameter.dim() == 4:  # Kaiming's normal distribution, by the outputs
            std = np.sqrt(2 / (parameter.shape[0] * parameter.shape[2] * parameter.shape[3]))
            assert abs(parameter.std().item() / std - 1) < 6 / np.sqrt(2 * parameter.numel()), name


def test_pictures_are_normalized_by_channel_in_inference_and_in_training_after_it():
    with torch.inference_mode():
        normalized(torch.rand(1, 3, 2, 2, dtype=torch.float64))
    images = torch.rand(2, 3, 4, 5, dtype=torch.float64, requires_grad=True)
    mean, std = (np.reshape(each, (3, 1, 1)) for each in ([0.485, 0.456, 0.406], [0.229, 0.224, 0.225]))
    found = normalized(images)
    np.testing.assert_allclose(found.detach(), (images.detach().numpy() - mean) / std, atol=1e-6)
    found.sum().backward()
    np.testing.assert_allclose(images.grad[0, :, 0, 0], 1 / std.ravel())


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ResNet("resnet51"), r"Did you mean 'resnet50'.*resnet18_half"),
        (lambda: ResNet("resnet18", 0), "one output or more; got 0"),
        (lambda: Architecture(BasicBlock, (1, 1, 0, 1), 8), "four stages of one block or more"),
        (lambda: Architecture(BasicBlock, (1, 1, 1, 1), 4), "8 channels or more; got .* 4"),
        (lambda: normalized(torch.zeros(1, 3, 4, 4, dtype=torch.uint8)), "got a Tensor of torch.uint8"),
        (lambda: normalized(np.zeros((1, 3, 4, 4), np.float32)), "are a tensor of .*; got a ndarray of float32"),
        (lambda: normalized(torch.zeros(3, 4, 4)), r"the shape \(n, 3, h, w\); got \(3, 4, 4\)"),
    ],
)
def test_misuse_is_refused_with_what_would_do(make, message):
    with pytest.raises(GvpError, match=message):
        make()

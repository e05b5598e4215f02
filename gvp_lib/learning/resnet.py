"""Residual networks with torchvision's parameter names, so that its weights load. Thesis 2.4.1.

Written here because torchvision cannot be installed beside every torch. The bottleneck is torchvision's, with its
stride at the 3x3 convolution. He et al., "Deep Residual Learning for Image Recognition", 2016.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidImageError, InvalidParameterError, UnknownNameError
from gvp_lib.picture import count

__all__ = ["ARCHITECTURES", "Architecture", "BasicBlock", "Bottleneck", "ResNet", "normalized", "scaled"]

# With 4 channels, oneDNN writes past the end of a gradient on processors with AVX2 but no AVX-512 (seen in torch 2.13).
_MIN_WIDTH = 8

MEAN, STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # ImageNet's, by channel, of images in [0, 1]


class BasicBlock(nn.Module):
    """Two 3x3 convolutions and a shortcut.

    Parameters
    ----------
    channels
        Channels of the input.
    width
        Channels of the output.
    stride
        Stride of the first convolution and of the shortcut.

    Attributes
    ----------
    expansion
        Output channels per channel of ``width``.

    Examples
    --------
    >>> BasicBlock(8, 16, stride=2)
    BasicBlock(8 to 16 channels, stride 2)
    """

    expansion = 1

    def __init__(self, channels: int, width: int, stride: int) -> None:
        super().__init__()
        self.conv1 = _convolution(channels, width, 3, stride)
        self.bn1 = nn.BatchNorm2d(width)
        self.relu = nn.ReLU(inplace=True)
        self.conv2 = _convolution(width, width, 3)
        self.bn2 = nn.BatchNorm2d(width)
        self.downsample = _downsample(channels, width * self.expansion, stride)

    def __repr__(self) -> str:
        return _block_text(self)

    def forward(self, x: Tensor) -> Tensor:
        """Feature maps, (n, width, h / stride, w / stride).

        Parameters
        ----------
        x
            Feature maps, (n, channels, h, w).
        """
        y = self.relu(self.bn1(self.conv1(x)))
        y = self.bn2(self.conv2(y))
        return self.relu(y + (x if self.downsample is None else self.downsample(x)))


class Bottleneck(nn.Module):
    """A 1x1 convolution that narrows, a 3x3, a 1x1 that widens, and a shortcut.

    Parameters
    ----------
    channels
        Channels of the input.
    width
        Channels of the 3x3 convolution; the output has four times as many.
    stride
        Stride of the 3x3 convolution and of the shortcut.

    Attributes
    ----------
    expansion
        Output channels per channel of ``width``.

    Examples
    --------
    >>> Bottleneck(64, 64, stride=1)
    Bottleneck(64 to 256 channels, stride 1)
    """

    expansion = 4

    def __init__(self, channels: int, width: int, stride: int) -> None:
        super().__init__()
        self.conv1 = _convolution(channels, width, 1)
        self.bn1 = nn.BatchNorm2d(width)
        self.conv2 = _convolution(width, width, 3, stride)
        self.bn2 = nn.BatchNorm2d(width)
        self.conv3 = _convolution(width, width * self.expansion, 1)
        self.bn3 = nn.BatchNorm2d(width * self.expansion)
        self.relu = nn.ReLU(inplace=True)
        self.downsample = _downsample(channels, width * self.expansion, stride)

    def __repr__(self) -> str:
        return _block_text(self)

    def forward(self, x: Tensor) -> Tensor:
        """Feature maps, (n, 4 width, h / stride, w / stride).

        Parameters
        ----------
        x
            Feature maps, (n, channels, h, w).
        """
        y = self.relu(self.bn1(self.conv1(x)))
        y = self.relu(self.bn2(self.conv2(y)))
        y = self.bn3(self.conv3(y))
        return self.relu(y + (x if self.downsample is None else self.downsample(x)))


@dataclass(frozen=True)
class Architecture:
    """Building plan of a residual network.

    Attributes
    ----------
    block
        Kind of block, :class:`BasicBlock` or :class:`Bottleneck`.
    blocks
        Number of blocks in each of the four stages.
    width
        Channels of the first stage, 8 or more; each stage doubles those of the one before.
    """

    block: type[BasicBlock] | type[Bottleneck]
    blocks: tuple[int, int, int, int]
    width: int = 64

    def __post_init__(self) -> None:
        object.__setattr__(self, "blocks", tuple(self.blocks))
        if len(self.blocks) != 4 or min(self.blocks) < 1 or self.width < _MIN_WIDTH:
            raise InvalidParameterError(
                f"an architecture has four stages of one block or more, and {_MIN_WIDTH} channels or more; got "
                f"{self.blocks} and {self.width}"
            )

    def __repr__(self) -> str:
        return f"Architecture({self.block.__name__}, {self.blocks}, width={self.width})"


ARCHITECTURES: Mapping[str, Architecture] = {
    "resnet50": Architecture(Bottleneck, (3, 4, 6, 3)),
    "resnet18": Architecture(BasicBlock, (2, 2, 2, 2)),
    "resnet18_half": Architecture(BasicBlock, (2, 2, 2, 2), width=32),
}
"""Architectures by name: the thesis's; one for small machines; and one of half the width, small enough to ship."""


@checked
class ResNet(nn.Module):
    """Residual network from images to a vector of outputs each.

    Parameters
    ----------
    architecture
        Name in :data:`ARCHITECTURES`, or an :class:`Architecture` of your own.
    outputs
        Number of outputs per image: logits of the five actions, or a tilt and its uncertainty.

    Attributes
    ----------
    architecture
        The :class:`Architecture`.

    Examples
    --------
    >>> network = ResNet("resnet18_half", outputs=5).eval()
    >>> tuple(network(torch.zeros(2, 3, 64, 64)).shape), sum(p.numel() for p in network.parameters())
    ((2, 5), 2800165)
    """

    def __init__(self, architecture: str | Architecture = "resnet50", outputs: int = 5) -> None:
        super().__init__()
        if isinstance(architecture, str):
            if architecture not in ARCHITECTURES:
                raise UnknownNameError("network", architecture, ARCHITECTURES)
            architecture = ARCHITECTURES[architecture]
        if outputs < 1:
            raise InvalidParameterError(f"a network has one output or more; got {outputs}")
        self.architecture = architecture
        block, channels = architecture.block, architecture.width
        self.conv1 = _convolution(3, channels, 7, 2)
        self.bn1 = nn.BatchNorm2d(channels)
        self.relu = nn.ReLU(inplace=True)
        self.maxpool = nn.MaxPool2d(3, 2, 1)
        stages: list[nn.Sequential] = []
        for stage, depth in enumerate(architecture.blocks):
            width, blocks = architecture.width * 2**stage, nn.Sequential()
            for number in range(depth):
                blocks.append(block(channels, width, stride=2 if stage and not number else 1))
                channels = width * block.expansion
            stages.append(blocks)
        self.layer1, self.layer2, self.layer3, self.layer4 = stages
        self.avgpool = nn.AdaptiveAvgPool2d(1)
        self.fc = nn.Linear(channels, outputs)
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")

    def __repr__(self) -> str:
        name = next((name for name, known in ARCHITECTURES.items() if known == self.architecture), self.architecture)
        parameters = sum(parameter.numel() for parameter in self.parameters())
        return f"ResNet({name}, {count(self.fc.out_features, 'output')}, {parameters:,} parameters)"

    def forward(self, x: Tensor) -> Tensor:
        """Outputs for a batch of images, (n, outputs).

        Parameters
        ----------
        x
            :func:`normalized` images, float32 (n, 3, h, w).
        """
        x = self.maxpool(self.relu(self.bn1(self.conv1(x))))
        x = self.layer4(self.layer3(self.layer2(self.layer1(x))))
        return self.fc(torch.flatten(self.avgpool(x), 1))


def scaled(pictures: NDArray[np.uint8]) -> Tensor:
    """Pictures, uint8 (n, h, w, 3), as float32 (n, 3, h, w) in [0, 1], channels last in memory."""
    return torch.from_numpy(np.ascontiguousarray(pictures)).permute(0, 3, 1, 2).float().div_(255)


@checked(own=True)
def normalized(images: Tensor) -> Tensor:
    """Images standardized by the mean and standard deviation of each channel over ImageNet.

    The thesis does not say whether it does this; weights from ImageNet expect it (errata 20).

    Parameters
    ----------
    images
        RGB images in [0, 1], floating point (n, 3, h, w).

    Raises
    ------
    InvalidImageError
        The images are whole numbers, or of another shape.

    Examples
    --------
    >>> gray = normalized(torch.full((1, 3, 1, 1), 0.5))
    >>> [round(float(channel), 3) for channel in gray[0]]
    [0.066, 0.196, 0.418]
    """
    if not isinstance(images, Tensor) or not images.is_floating_point():
        raise InvalidImageError(
            "a network's images are a tensor of floating-point numbers in [0, 1]; got a "
            f"{type(images).__name__} of {getattr(images, 'dtype', 'no type')}"
        )
    if images.dim() != 4 or images.shape[1] != 3:
        raise InvalidImageError(f"a network's images have the shape (n, 3, h, w); got {tuple(images.shape)}")
    mean, std = _statistics(images.device, images.dtype)
    return (images - mean).div_(std)


@lru_cache
def _statistics(device: torch.device, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
    """Mean and standard deviation on a device: copying them there for each batch would stall a GPU."""
    with torch.inference_mode(False):  # those first made in inference mode could not be used in training
        mean, std = (torch.tensor(values, device=device, dtype=dtype).view(3, 1, 1) for values in (MEAN, STD))
    return mean, std


def _block_text(block: BasicBlock | Bottleneck) -> str:
    stride = max(block.conv1.stride[0], block.conv2.stride[0])
    outputs = block.conv1.out_channels * block.expansion
    return f"{type(block).__name__}({block.conv1.in_channels} to {outputs} channels, stride {stride})"


def _convolution(channels: int, width: int, size: int, stride: int = 1) -> nn.Conv2d:
    return nn.Conv2d(channels, width, size, stride, padding=size // 2, bias=False)


def _downsample(channels: int, width: int, stride: int) -> nn.Sequential | None:
    """Projection shortcut where shapes differ; None where the input itself will do."""
    if stride == 1 and channels == width:
        return None
    return nn.Sequential(_convolution(channels, width, 1, stride), nn.BatchNorm2d(width))

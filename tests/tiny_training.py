"""Trainings so small that a test may run several."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gvp_lib.learning.config import TrainConfig
from gvp_lib.learning.resnet import Architecture, BasicBlock
from gvp_lib.learning.training import Training, train

TINY = Architecture(BasicBlock, (1, 1, 1, 1), width=8)


def config(**options: Any) -> TrainConfig:
    """Two epochs of six steps, by steps of 20 deg, so that there are samples of NO_OP among few."""
    return TrainConfig(
        **{"network": "tiny", "size": 32, "shift": 2, "step": np.radians(20), "batch": 8, "epochs": 2, **options}
    )


def lesson(data: Path | list[Path], folder: Path, **options: Any) -> Training:
    return train(data, folder, config(**options), device="cpu", progress=False)


def weights(folder: Path) -> bytes:
    return (folder / "weights.safetensors").read_bytes()

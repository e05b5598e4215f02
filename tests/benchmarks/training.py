"""What a training step costs against the bare forward and backward pass, and how long the thesis's training takes.

Run as ``python tests/benchmarks/training.py``, on a GPU where there is one; some minutes. Aim: a step takes at most
1.05 times as long as the bare pass of the same network on a batch that is already in memory. The bare pass is forward,
loss and backward; a step has also the batch's preparation (chosen, shifted, scaled, normalized), the optimizer, and the
sums of loss and score. The optimizer is timed with the pass as well, so that its share can be told from the rest.
Sides of pictures, px, may follow: 64 by default.
"""

from __future__ import annotations

import os
import sys
from tempfile import TemporaryDirectory

import numpy as np
import torch
from harness import interleave, verdict

from gvp_lib.learning.collect import collect_dataset
from gvp_lib.learning.config import OBJECTIVES, TrainConfig
from gvp_lib.learning.dataset import ViewpointDataset
from gvp_lib.learning.policy import device_name, find_device
from gvp_lib.learning.recipe import CollectionRecipe
from gvp_lib.learning.resnet import ResNet, normalized
from gvp_lib.learning.training import make_optimizer, train_epoch

RATIO_AIM = 1.05
SAMPLES, EPOCHS = 2867, 20  # the thesis's: 70 % of 4096
ROUNDS = {"resnet18_half": 40, "resnet18": 20, "resnet50": 10}


def steps(name: str, data: ViewpointDataset, rounds: int, device: str) -> None:
    config = TrainConfig(network=name)
    network = ResNet(name).to(device, memory_format=torch.channels_last).train()
    optimizer = make_optimizer(network, config)
    order = np.random.default_rng(0).permutation(len(data))[: config.batch]
    images, actions = (part.to(device) for part in data.batch(order))
    images, objective = normalized(images).contiguous(memory_format=torch.channels_last), OBJECTIVES["action"]

    def bare() -> None:
        network.zero_grad(set_to_none=True)
        objective.loss(network(images), actions).backward()
        if device != "cpu":
            torch.cuda.synchronize()

    def with_optimizer() -> None:
        bare()
        optimizer.step()
        if device != "cpu":
            torch.cuda.synchronize()

    def step() -> None:
        train_epoch(network, optimizer, data, order, config, epoch=0, device=device)

    print(f"{name}, {config.batch} pictures of {data.size} px")
    found = interleave({"bare pass": bare, "with optimizer": with_optimizer, "training step": step}, rounds, calls=1)
    (_, optimizing), (seconds, ratio) = found["with optimizer"], found["training step"]
    rate = config.batch / seconds
    verdict("a step, in bare passes", ratio, RATIO_AIM)
    print(
        f"the optimizer is {optimizing - 1:.3f} of one, all else {ratio - optimizing:.3f}. {rate:.0f} pictures/s; "
        f"{EPOCHS} epochs of {SAMPLES}: {EPOCHS * SAMPLES / rate / 60:.0f} min\n"
    )


def main() -> None:
    """Print the tables."""
    device = find_device("auto")
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}; {torch.get_num_threads()} threads")
    print(f"on {device_name(device)}\n")
    with TemporaryDirectory() as scratch:
        collect_dataset(scratch, CollectionRecipe(arm="floating", n=64, seed=0), progress=False)
        for size in [int(size) for size in sys.argv[1:]] or [64]:
            samples = ViewpointDataset(scratch, "train", size=size, shift=size // 8)
            for network, rounds in ROUNDS.items():
                steps(network, samples, rounds, device)


if __name__ == "__main__":
    main()

"""Labeled viewpoints as a torch data set, with the thesis's preprocessing. Thesis 2.4.3, 2.4.4; errata 19."""

from __future__ import annotations

from collections.abc import Sequence
from operator import index as whole
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch.utils.data import Dataset

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError, UnknownNameError
from gvp_lib.learning.labels import TURNED_ACTIONS, TURNS, best_actions, turned
from gvp_lib.learning.resnet import scaled
from gvp_lib.learning.shards import as_folders, decoded, read_card, read_columns
from gvp_lib.perception.images import crop_and_resize
from gvp_lib.picture import Pictured, count

__all__ = ["ViewpointDataset"]

_SPLIT, _SHIFT = 6, 7  # streams of random numbers; `recipe` and `collect` have the others
_CONCENTRATION = np.full(3, 0.4)  # of a Dirichlet distribution: each mixed channel is mostly one of the three


@checked(own=True)
class ViewpointDataset(Pictured, Dataset[tuple[torch.Tensor, torch.Tensor]]):
    """Torch data set of pictures and labels, resized once and kept in memory: 12 kB per sample of 64 px.

    Each picture is cropped to its middle, resized, and, for training, shifted by whole pixels in u and v, anew for each
    epoch; the border is repeated to fill the gap (errata 19). All augmentation depends on seed, epoch and sample alone,
    so that a resumed training sees the same pictures.

    Parameters
    ----------
    folder
        Folder of a data set from :func:`collect_dataset`, or several folders to concatenate.
    split
        Part of the samples: ``"train"``, ``"validation"``, or ``"all"``.
    share
        Fraction of the samples for training; 0.7 in the thesis.
    seed
        Seed of split and augmentation.
    target
        ``"action"``: best of the five, int64; ``"tilt"``: tilt of the normal along u and v, float32 (2,), rad.
    size
        Side of the resized pictures, px.
    shift
        Largest shift to each side, px of ``size``; by default 8 for ``"train"`` and 0 otherwise.
    crop
        Side of the square taken from the middle of each stored picture, px; by default all of it.
    dihedral
        Whether to rotate each picture and its target by random quarter turns and mirror them at random, anew for each
        epoch: a rolled camera sees a symmetric object as an upright one does. The thesis does not.
    colors
        Whether to mix the channels of each picture at random, anew for each epoch, so that a network learns an object's
        shape and not its color; gray stays gray. The thesis does not.
    step
        Angle of an action, rad; by default the one that the data set was labeled for.
    verify
        Whether to compare every shard with its checksum first.

    Attributes
    ----------
    images
        Pictures before augmentation, RGB uint8 (n, size, size, 3).
    actions, tilts
        Both targets before augmentation, int64 (n,) and float32 (n, 2), rad.

    Raises
    ------
    DatasetError
        A data set is unfinished or damaged.

    Examples
    --------
    >>> import tempfile
    >>> from gvp_lib import collect_dataset
    >>> from gvp_lib.learning import CollectionRecipe
    >>> folder = Path(tempfile.mkdtemp()) / "bricks"
    >>> _ = collect_dataset(folder, CollectionRecipe(arm="floating", n=32, seed=1), progress=False)
    >>> train = ViewpointDataset(folder)
    >>> train
    ViewpointDataset(train: 22 samples, cuboid_1x2, floating, crop 128 px, bricks)
    >>> image, action = train[0]
    >>> tuple(image.shape), action.dtype
    ((3, 64, 64), torch.int64)
    """

    _figure = "plot_dataset"

    def __init__(
        self,
        folder: Path | str | Sequence[Path | str],
        split: Literal["train", "validation", "all"] = "train",
        *,
        share: float = 0.7,
        seed: int = 0,
        target: Literal["action", "tilt"] = "action",
        size: int = 64,
        shift: int | None = None,
        crop: int | None = None,
        dihedral: bool = False,
        colors: bool = False,
        step: float | None = None,
        verify: bool = True,
    ) -> None:
        for kind, name, known in (
            ("split", split, ("train", "validation", "all")),
            ("target", target, ("action", "tilt")),
        ):
            if name not in known:
                raise UnknownNameError(kind, name, known)
        shift = (8 if split == "train" else 0) if shift is None else shift
        if not (0 < share <= 1 and size >= 8 and 0 <= shift < size):
            raise InvalidParameterError(
                f"a share is in (0, 1], a size 8 px or more and a shift less than that; got {share}, {size}, {shift}"
            )
        folders = as_folders(folder)
        if not folders:
            raise InvalidParameterError("a data set is of one folder or more; got none")
        self.split, self.target, self.size, self.shift, self.seed = split, target, size, shift, seed
        self.dihedral, self.colors = dihedral, colors
        images, actions, tilts = [], [], []
        self._sources: list[dict[str, str]] = []  # of each folder, for the repr
        for number, each in enumerate(folders):
            table = read_columns(each, ["image", "action", "direction", "angle"], verify=verify)
            recipe = read_card(each)["recipe"]
            self._sources.append(
                {
                    "objects": recipe["target"],
                    "arms": recipe["arm"],
                    "crops": f"crop {crop or recipe['crop']} px",
                    "folders": each.resolve().name,
                }
            )
            chosen = _split_indices(len(table), split, share, [seed, _SPLIT, number])
            column = table["image"].combine_chunks().field("bytes")
            images += [crop_and_resize(decoded(column[int(k)].as_py()), crop, size) for k in chosen]
            direction, angle = (table[name].to_numpy()[chosen] for name in ("direction", "angle"))
            actions.append(table["action"].to_numpy()[chosen] if step is None else best_actions(direction, angle, step))
            tilts.append(angle[:, None] * np.stack([np.cos(direction), np.sin(direction)], axis=1))
        self.images: NDArray[np.uint8] = np.array(images, np.uint8).reshape(-1, size, size, 3)
        self.actions: NDArray[np.int64] = np.concatenate(actions).astype(np.int64)
        self.tilts: NDArray[np.float32] = np.concatenate(tilts).astype(np.float32)
        self.epoch = 0

    def __repr__(self) -> str:
        parts = []
        for kind in ("objects", "arms", "crops", "folders"):
            unique = list(dict.fromkeys(source[kind] for source in self._sources))
            parts.append(" + ".join(unique) if len(unique) < 3 else f"{len(unique)} {kind}")
        return f"ViewpointDataset({self.split}: {count(len(self), 'sample')}, {', '.join(parts)})"

    @property
    def epoch(self) -> int:
        """Number of the epoch, which decides the augmentation; set it before each one."""
        return self._epoch

    @epoch.setter
    def epoch(self, epoch: int) -> None:
        n, rng = len(self), np.random.default_rng([self.seed, _SHIFT, epoch])
        self._epoch = epoch
        self._shifts = rng.integers(-self.shift, self.shift + 1, (n, 2))
        self._symmetries = rng.integers(0, len(TURNS), n)
        mixes = rng.dirichlet(_CONCENTRATION, (n, 3)) if self.colors else np.empty((0, 3, 3))
        self._mixes = mixes.astype(np.float32)

    def __len__(self) -> int:
        return len(self.images)

    def __getitem__(self, index: int) -> tuple[torch.Tensor, torch.Tensor]:
        """One picture, float32 (3, size, size) in [0, 1], and its target."""
        try:
            number = whole(index)
        except TypeError as error:
            raise InvalidParameterError(f"one sample has a whole number, several are a batch; got {index!r}") from error
        if not -len(self) <= number < len(self):
            raise IndexError(f"{number} of {len(self)} samples")
        images, targets = self.batch([number])
        return images[0], targets[0]

    def batch(self, indices: Sequence[int] | NDArray[np.int64]) -> tuple[torch.Tensor, torch.Tensor]:
        """Pictures, float32 (n, 3, size, size) in [0, 1], and their targets.

        Parameters
        ----------
        indices
            Indices of the samples, shape (n,); negative ones count from the end.
        """
        given, n = np.asarray(indices), len(self)
        if given.ndim != 1 or given.dtype.kind not in "iu" or not ((given >= -n) & (given < n)).all():
            raise InvalidParameterError(
                f"a batch is of whole numbers from {-n} to {n - 1}, shape (k,); got {indices!r}"
            )
        chosen = given.astype(np.int64) % n
        pictures, labels = self.images[chosen], (self.actions if self.target == "action" else self.tilts)[chosen]
        if self.shift:
            pictures = _shifted(pictures, self._shifts[chosen])
        if self.dihedral:
            pictures, labels = _rotated_or_mirrored(pictures, labels, self._symmetries[chosen])
        if self.colors:
            mixes = self._mixes[chosen]
            pictures = np.stack([cv2.transform(picture, mix) for picture, mix in zip(pictures, mixes, strict=True)])
        return scaled(pictures), torch.from_numpy(labels)


def _split_indices(n: int, split: str, share: float, seed: list[int]) -> NDArray[np.int64]:
    """Indices of the samples of a split, ascending."""
    if split == "all":
        return np.arange(n)
    order = np.random.default_rng(seed).permutation(n)
    cut = round(share * n)
    return np.sort(order[:cut] if split == "train" else order[cut:])


def _rotated_or_mirrored(
    pictures: NDArray[np.uint8], labels: NDArray[Any], symmetries: NDArray[np.int64]
) -> tuple[NDArray[np.uint8], NDArray[Any]]:
    """Pictures and labels, each under its own symmetry: an index into `TURNS`."""
    pictures, labels = pictures.copy(), labels.copy()
    for number, matrix in enumerate(TURNS):
        which = symmetries == number
        pictures[which] = turned(pictures[which], matrix)
        labels[which] = TURNED_ACTIONS[number][labels[which]] if labels.ndim == 1 else labels[which] @ matrix.T
    return pictures, labels


def _shifted(pictures: NDArray[np.uint8], shifts: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Pictures, each shifted by its (u, v), with the border repeated."""
    size, margin = pictures.shape[1], int(np.abs(shifts).max())
    shifted = np.empty_like(pictures)
    for k, (u, v) in enumerate((margin - shifts).tolist()):
        padded = cv2.copyMakeBorder(pictures[k], margin, margin, margin, margin, cv2.BORDER_REPLICATE)
        shifted[k] = padded[v : v + size, u : u + size]
    return shifted

"""A trained network as the policy of :class:`gvp_lib.CnnPlanner`, and where networks compute. Thesis 2.4, 2.4.3."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from copy import deepcopy
from numbers import Integral
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from gvp_lib.checks import checked
from gvp_lib.errors import InvalidParameterError
from gvp_lib.learning.checkpoints import TrainedNetwork, load_trained
from gvp_lib.learning.config import TiltObjective
from gvp_lib.learning.labels import TURNED_ACTIONS, TURNS, turned
from gvp_lib.learning.resnet import normalized, scaled
from gvp_lib.perception.images import crop_and_resize
from gvp_lib.planning.plan import Action, Tilt

__all__ = ["NetworkPolicy", "device_name", "find_device", "on_threads"]


@checked(own=True)
class NetworkPolicy:
    """Policy of a trained network: an action or a tilt for the central crop of an image.

    The crop is resized as in training. A network knows pixels, not angles: the camera needs roughly the field of view
    of the training set, and roughly its radius.

    Parameters
    ----------
    trained
        Trained network, the path of its file, or the name of a network that comes with the library.
    tta
        Number of views of each image for test-time augmentation: 1, the image alone; 4, all its quarter turns; 8,
        their mirror images too. The outputs are mapped back and averaged.
    device
        Device that computes: ``"cpu"``, ``"cuda"``, ..., or a ``torch.device``; ``"auto"`` for a GPU where there is
        one. A network elsewhere is copied there.

    Attributes
    ----------
    trained
        Trained network and its metadata.
    target
        What a call returns: ``"action"`` for an Action, ``"tilt"`` for a Tilt.

    Examples
    --------
    >>> policy = NetworkPolicy("actions-1x2", tta=8)
    >>> policy
    NetworkPolicy(TrainedNetwork(resnet18_half, action, 64 px, epoch 20, validation accuracy 0.906), tta 8, cpu)
    >>> policy(np.zeros((480, 640, 3), np.uint8)) in Action
    True
    """

    def __init__(
        self, trained: TrainedNetwork | Path | str, *, tta: int = 1, device: str | torch.device = "cpu"
    ) -> None:
        if tta not in (1, 4, 8):
            raise InvalidParameterError(f"test-time augmentation shows an image in 1, 4 or 8 ways; got tta={tta!r}")
        self.trained = trained if isinstance(trained, TrainedNetwork) else load_trained(trained)
        self.target: str = self.trained.metadata["target"]
        self._tta, self._device = tta, find_device(device)
        network = self.trained.network
        if next(network.parameters()).device != torch.device(self._device):
            network = deepcopy(network)  # the given one may be another policy's, too
        self._network = network.to(self._device).eval()

    def __repr__(self) -> str:
        return f"NetworkPolicy({self.trained}, tta {self._tta}, {self._device})"

    def __call__(self, rgb: NDArray[np.uint8]) -> Action | Tilt:
        """Choose an action, or estimate the tilt, for an image.

        Parameters
        ----------
        rgb
            Image, uint8 (H, W, 3), at least as large as the crop.

        Returns
        -------
        Action or Tilt
            By ``target``. A tilt is at most pi; its standard deviation is calibrated on the validation set.
        """
        if self.target == "action":
            return Action(int(self.probabilities(rgb).argmax()))
        outputs = TiltObjective().tilt(self._outputs(rgb)).cpu().numpy().astype(float)  # (tta, 3)
        # A turn takes a tilt t to T t; a row times T is what takes it back, since T is orthogonal.
        u, v = np.mean([row[:2] @ turn for row, turn in zip(outputs, TURNS, strict=False)], axis=0)
        if (angle := np.hypot(u, v)) > np.pi:  # nothing is so far off, but a network may predict it
            u, v = u / angle * np.pi, v / angle * np.pi
        calibration = self.trained.metadata.get("scores", {}).get("validation_calibration", 1.0)
        return Tilt(float(u), float(v), float(outputs[:, 2].mean()) * calibration)

    def probabilities(self, rgb: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Probabilities of the five actions, shape (5,).

        Parameters
        ----------
        rgb
            Image, uint8 (H, W, 3), at least as large as the crop.

        Raises
        ------
        InvalidParameterError
            The network's target is a tilt.
        """
        if self.target != "action":
            raise InvalidParameterError("this network estimates a tilt, not which of five actions is best; call it")
        outputs = torch.softmax(self._outputs(rgb), dim=1).cpu().numpy().astype(float)  # (tta, 5)
        return np.mean([row[became] for row, became in zip(outputs, TURNED_ACTIONS, strict=False)], axis=0)

    def _outputs(self, rgb: NDArray[np.uint8]) -> torch.Tensor:
        image = crop_and_resize(rgb, self.trained.metadata["crop"], self.trained.metadata["size"])
        images = np.stack([turned(image, turn) for turn in TURNS[: self._tta]])
        with torch.inference_mode():
            return self._network(normalized(scaled(images).to(self._device)))


def find_device(name: str | torch.device) -> str:
    """Device by name, if torch can use it here; ``"auto"``: a GPU where there is one, else the processor.

    Raises
    ------
    InvalidParameterError
        There is no such device here.
    """
    if name == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    try:
        found = str(torch.device(name))
        torch.zeros(1, device=found).item()
    except (RuntimeError, AssertionError, TypeError, ValueError) as error:
        raise InvalidParameterError(
            f"device {name!r} is not available here ({str(error).splitlines()[0]}); 'cpu' is, and 'auto' picks one"
        ) from error
    return found


def device_name(device: str) -> str:
    """Model of a GPU, to record where a network was trained; of any other device, its name."""
    return torch.cuda.get_device_name(device) if device.startswith("cuda") else device


@contextmanager
def on_threads(count: int | None) -> Iterator[None]:
    """Context in which torch computes on so many threads, 1 or more; None: on as many as before.

    The number decides the order in which sums are taken, and so the last bits of a result; and processes that work
    beside each other are faster on one each.
    """
    if count is not None and (isinstance(count, bool) or not isinstance(count, Integral) or count < 1):
        raise InvalidParameterError(
            f"threads is a whole number from 1, or None for as many as torch is set to; got {count!r}"
        )
    before = torch.get_num_threads()
    torch.set_num_threads(before if count is None else count)
    try:
        yield
    finally:
        torch.set_num_threads(before)

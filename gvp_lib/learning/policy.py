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

from gvp_lib.errors import InvalidParameterError
from gvp_lib.learning.checkpoints import TrainedNetwork, load_trained
from gvp_lib.learning.config import TiltObjective
from gvp_lib.learning.labels import TURNED_ACTIONS, TURNS, turned
from gvp_lib.learning.resnet import normalized, scaled
from gvp_lib.perception.images import check_rgb, crop_and_resize
from gvp_lib.planning.plan import Action, Tilt

__all__ = ["NetworkPolicy", "device_name", "find_device", "on_threads"]


class NetworkPolicy:
    """Policy of a trained network: the middle of a picture, resized as in training, to an action or a tilt.

    A network knows pixels, not angles: the camera must have about the field of view of the set that the network learned
    from, and stand at about its radius.

    Parameters
    ----------
    trained
        A network; the path of its file; or the name of one that comes with the library.
    turns
        Number of ways to show the picture, 1, 4 or 8: as it is; also rotated by quarter turns; also mirrored. The
        outputs are turned back and averaged.
    device
        ``"cpu"``, ``"cuda"``, ... ; ``"auto"``: a GPU where there is one. A network elsewhere is copied there.

    Attributes
    ----------
    trained
        The network, and what is known about it.
    target
        ``"action"`` or ``"tilt"``: whether a call returns an Action or a Tilt.
    """

    def __init__(self, trained: TrainedNetwork | Path | str, *, turns: int = 1, device: str = "cpu") -> None:
        if turns not in (1, 4, 8):
            raise InvalidParameterError(f"a picture is shown in 1, 4 or 8 ways; got turns={turns!r}")
        self.trained = trained if isinstance(trained, TrainedNetwork) else load_trained(trained)
        self.target: str = self.trained.about["target"]
        self._turns, self._device = turns, find_device(device)
        network = self.trained.network
        if next(network.parameters()).device != torch.device(self._device):
            network = deepcopy(network)  # the given one may be another policy's, too
        self._network = network.to(self._device).eval()

    def __call__(self, rgb: NDArray[np.uint8]) -> Action | Tilt:
        """Action or tilt for a picture, uint8 (H, W, 3), at least as large as the crop; a tilt of at most pi."""
        if self.target == "action":
            return Action(int(self.probabilities(rgb).argmax()))
        outputs = TiltObjective().tilt(self._outputs(rgb)).cpu().numpy().astype(float)  # (turns, 3)
        # A turn takes a tilt t to T t; a row times T is what takes it back, since T is orthogonal.
        u, v = np.mean([row[:2] @ turn for row, turn in zip(outputs, TURNS, strict=False)], axis=0)
        if (angle := np.hypot(u, v)) > np.pi:  # nothing is so far off, but a network may say it
            u, v = u / angle * np.pi, v / angle * np.pi
        calibration = self.trained.about.get("scores", {}).get("validation_calibration", 1.0)
        return Tilt(float(u), float(v), float(outputs[:, 2].mean()) * calibration)

    def probabilities(self, rgb: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Probabilities of the five actions, shape (5,)."""
        if self.target != "action":
            raise InvalidParameterError("this network says a tilt, not which of five actions is best; call it instead")
        shown = torch.softmax(self._outputs(rgb), dim=1).cpu().numpy().astype(float)  # (turns, 5)
        return np.mean([row[became] for row, became in zip(shown, TURNED_ACTIONS, strict=False)], axis=0)

    def _outputs(self, rgb: NDArray[np.uint8]) -> torch.Tensor:
        check_rgb(rgb)
        picture = crop_and_resize(rgb, self.trained.about["crop"], self.trained.about["size"])
        shown = np.stack([turned(picture, turn) for turn in TURNS[: self._turns]])
        with torch.inference_mode():
            return self._network(normalized(scaled(shown).to(self._device)))


def find_device(name: str) -> str:
    """Device by name, if torch can use it here; ``"auto"``: a GPU where there is one, else the processor.

    Raises
    ------
    InvalidParameterError
        There is no such device here.
    """
    if name == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    try:
        torch.zeros(1, device=name).item()
    except (RuntimeError, AssertionError, TypeError) as error:
        raise InvalidParameterError(
            f"device {name!r} is not at hand here ({str(error).splitlines()[0]}); 'cpu' is, and 'auto' takes what is"
        ) from error
    return name


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

"""A trained network as the policy of :class:`gvp_lib.CnnPlanner`. Thesis 2.4, 2.4.3."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from gvp_lib.errors import InvalidParameterError
from gvp_lib.learning.checkpoints import TrainedNetwork, load_trained
from gvp_lib.learning.devices import device_named
from gvp_lib.learning.objectives import TiltObjective
from gvp_lib.learning.pictures import shrunk
from gvp_lib.learning.resnet import normalized, scaled
from gvp_lib.learning.turns import TURNED_ACTIONS, TURNS, turned
from gvp_lib.perception.images import check_rgb
from gvp_lib.planning.learned import Action, Tilt

__all__ = ["NetworkPolicy"]


class NetworkPolicy:
    """Shows a network the middle of a picture, shrunk as it was in training, and says what it says.

    A network knows pixels, not angles: the camera must have about the field of view of the set that it learned from,
    and stand at about its radius.

    Parameters
    ----------
    trained
        A network; the path of its file; or the name of one that comes with the library.
    turns
        In how many ways the picture is shown, 1, 4 or 8: as it is; also by quarter turns; also mirrored. What the
        network says of them is turned back and averaged.
    device
        ``"cpu"``, ``"cuda"``, ... ; ``"auto"``: a GPU where there is one. A network that is elsewhere is copied there.

    Attributes
    ----------
    trained
        The network, and what is known of it.
    target
        ``"action"`` or ``"tilt"``, which is what a call returns: an Action or a Tilt.
    """

    def __init__(self, trained: TrainedNetwork | Path | str, *, turns: int = 1, device: str = "cpu") -> None:
        if turns not in (1, 4, 8):
            raise InvalidParameterError(f"a picture is shown in 1, 4 or 8 ways; got turns={turns!r}")
        self.trained = trained if isinstance(trained, TrainedNetwork) else load_trained(trained)
        self.target: str = self.trained.about["target"]
        self._turns, self._device = turns, device_named(device)
        network = self.trained.network
        if next(network.parameters()).device != torch.device(self._device):
            network = deepcopy(network)  # the given one may be another policy's, too
        self._network = network.to(self._device).eval()

    def __call__(self, rgb: NDArray[np.uint8]) -> Action | Tilt:
        """What to do about a picture, uint8 (H, W, 3), at least as large as the crop; a tilt of at most pi."""
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
        """Of the five actions, shape (5,)."""
        if self.target != "action":
            raise InvalidParameterError("this network says a tilt, not which of five actions is best; call it instead")
        shown = torch.softmax(self._outputs(rgb), dim=1).cpu().numpy().astype(float)  # (turns, 5)
        return np.mean([row[became] for row, became in zip(shown, TURNED_ACTIONS, strict=False)], axis=0)

    def _outputs(self, rgb: NDArray[np.uint8]) -> torch.Tensor:
        check_rgb(rgb)
        picture = shrunk(rgb, self.trained.about["crop"], self.trained.about["size"])
        shown = np.stack([turned(picture, turn) for turn in TURNS[: self._turns]])
        with torch.inference_mode():
            return self._network(normalized(scaled(shown).to(self._device)))

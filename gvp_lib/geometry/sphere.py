"""Poses of a camera on a virtual sphere about an object. Thesis A.3, Figs. 2.5 and 2.6; errata 21."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.errors import InvalidParameterError
from gvp_lib.picture import Pictured

__all__ = ["VirtualSphere", "look_at"]

_GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))  # rad


def look_at(eye: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> RigidTransform:
    """The pose of a camera at ``eye`` that looks at ``target``, ``world_from_camera``.

    Parameters
    ----------
    eye, target
        Points, shape (3,), meters, world frame; they must differ.
    up
        Direction that appears upward (-v) in the image, shape (3,). The camera's x axis comes out perpendicular to it
        (thesis A.3). Where it lies along the line of sight, the world axis most perpendicular to that line takes its
        place.
    """
    eye, target, up = (np.asarray(a, float) for a in (eye, target, up))
    z = target - eye
    distance = np.linalg.norm(z)
    if not distance > 0:
        raise InvalidParameterError(f"eye and target are the same point, {eye.tolist()}: there is no direction to look")
    z = z / distance
    x = np.cross(z, up)
    if np.linalg.norm(x) < 1e-9 * max(1.0, float(np.linalg.norm(up))):
        x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x = x / np.linalg.norm(x)
    rotation = Rotation.from_matrix(np.column_stack([x, np.cross(z, x), z]))
    return RigidTransform.from_components(eye, rotation)


@dataclass(frozen=True)
class VirtualSphere(Pictured):
    """A sphere about an object's center, on which the camera moves and always faces the center.

    A viewpoint is named by its tilt from the pole, its azimuth about the pole and its roll about the optical axis. For
    the default pole +z, azimuth 0 is towards +x; for any other pole, +x is carried along by the smallest rotation that
    takes +z into the pole.

    Attributes
    ----------
    center, radius
        Shape (3,), world frame; both in meters.
    pole
        Unit vector, shape (3,): the object's normal, from which tilts are measured.
    """

    _figure = "plot_sphere"

    center: NDArray[np.float64]
    radius: float
    pole: NDArray[np.float64] = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))

    def __post_init__(self) -> None:
        center, pole = np.array(self.center, float), np.array(self.pole, float)
        norm = np.linalg.norm(pole)
        if center.shape != (3,) or pole.shape != (3,) or not norm > 0 or not self.radius > 0:
            raise InvalidParameterError(
                "a sphere has a center and a pole of shape (3,), the pole not zero, and a positive radius in meters; "
                f"got {center!r}, {pole!r} and {self.radius}"
            )
        pole /= norm
        for array in (center, pole):
            array.flags.writeable = False
        object.__setattr__(self, "center", center)
        object.__setattr__(self, "pole", pole)

    def viewpoint(self, tilt: ArrayLike, azimuth: ArrayLike, roll: ArrayLike = 0.0) -> RigidTransform:
        """The camera's pose ``world_from_camera`` at one viewpoint, or at many.

        With zero roll the camera's x axis is perpendicular to the pole (parallel to the table for the default pole:
        thesis A.3) and the pole points up in the image. At the pole itself the azimuth alone fixes the roll, so the
        pose is continuous along every meridian.

        Parameters
        ----------
        tilt
            Angle from the pole, rad; 0 looks straight at the object's normal.
        azimuth, roll
            rad; a positive roll turns the camera from its x towards its y axis, clockwise as the camera sees it. The
            three broadcast together.
        """
        tilt, azimuth, roll = np.broadcast_arrays(*(np.asarray(a, float) for a in (tilt, azimuth, roll)))
        if not (np.abs(tilt) <= np.pi).all():
            raise InvalidParameterError(
                f"a tilt is in radians, within half a turn; got {tilt}. If degrees were meant: np.radians(tilt)"
            )
        # In the pole's frame: z' looks from the sphere to its center, x' along the parallel.
        s, c = np.sin(tilt), np.cos(tilt)
        sa, ca = np.sin(azimuth), np.cos(azimuth)
        outward = np.stack([s * ca, s * sa, c], axis=-1)  # (..., 3)
        x = np.stack([-sa, ca, np.zeros_like(s)], axis=-1)
        y = np.cross(-outward, x)
        rotation = Rotation.from_matrix(np.stack([x, y, -outward], axis=-1))
        world_from_pole = self._world_from_pole()
        rotation = world_from_pole * rotation * Rotation.from_rotvec(roll[..., None] * (0.0, 0.0, 1.0))
        direction = world_from_pole.apply(outward.reshape(-1, 3)).reshape(outward.shape)
        return RigidTransform.from_components(self.center + self.radius * direction, rotation)

    def uniform(self, n: int, max_tilt: float = np.radians(30), rolls: int = 1) -> RigidTransform:
        """``n`` viewpoints evenly spaced in area over a cap, as a spiral from the pole outward.

        ``max_tilt`` is half the cap's angle, rad. At each of ``n / rolls`` points stand ``rolls`` evenly spaced rolls
        (thesis Fig. 2.5).
        """
        if n < 1 or rolls < 1 or n % rolls:
            raise InvalidParameterError(f"n must be a positive multiple of rolls; got n={n}, rolls={rolls}")
        k = np.arange(n // rolls) + 0.5
        # Equal areas are equal steps of cos(tilt).
        tilt = np.arccos(1 - (1 - np.cos(max_tilt)) * k / (n // rolls))
        azimuth = k * _GOLDEN_ANGLE
        roll = np.arange(rolls) * (2 * np.pi / rolls)
        return self.viewpoint(np.repeat(tilt, rolls), np.repeat(azimuth, rolls), np.tile(roll, n // rolls))

    def random(
        self,
        n: int,
        rng: np.random.Generator | int,
        max_tilt: float = np.radians(30),
        sigma: float | None = np.radians(15),
    ) -> RigidTransform:
        """``n`` random viewpoints within a cap, with uniform roll (thesis A.3, Fig. 2.6; errata 21).

        Parameters
        ----------
        rng
            A generator, or a seed.
        max_tilt
            Half the cap's angle, rad.
        sigma
            Standard deviation, rad, of each of the two components of the tilt, which is normal about the pole and
            drawn again where it falls outside the cap. None: uniform in area over the cap.
        """
        if n < 0 or not 0 < max_tilt <= np.pi or (sigma is not None and not sigma > 0):
            raise InvalidParameterError(
                f"need n >= 0, 0 < max_tilt <= pi and sigma > 0 or None; got n={n}, max_tilt={max_tilt}, sigma={sigma}"
            )
        rng = np.random.default_rng(rng)
        if sigma is None:
            tilt = np.arccos(rng.uniform(np.cos(max_tilt), 1, n))
        else:
            # A normal tilt in the plane has a Rayleigh length; its truncated inverse never rejects.
            below = -np.expm1(-0.5 * (max_tilt / sigma) ** 2)
            tilt = sigma * np.sqrt(-2 * np.log1p(-below * rng.uniform(0, 1, n)))
        return self.viewpoint(tilt, rng.uniform(0, 2 * np.pi, n), rng.uniform(0, 2 * np.pi, n))

    def _world_from_pole(self) -> Rotation:
        """The smallest rotation that takes +z into the pole."""
        z = np.array([0.0, 0.0, 1.0])
        axis = np.cross(z, self.pole)
        norm = np.linalg.norm(axis)
        if norm < 1e-12:
            return Rotation.identity() if self.pole[2] > 0 else Rotation.from_euler("x", np.pi)
        return Rotation.from_rotvec(axis / norm * np.arctan2(norm, self.pole[2]))

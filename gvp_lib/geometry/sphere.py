"""Camera poses on a virtual sphere about an object. Thesis A.3, Figs. 2.5 and 2.6; errata 21."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from gvp_lib.checks import checked, finite
from gvp_lib.errors import InvalidParameterError
from gvp_lib.picture import Pictured

__all__ = ["VirtualSphere", "look_at"]

_GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))  # rad


@checked
def look_at(eye: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0)) -> RigidTransform:
    """Pose of a camera that looks from one point at another, ``world_from_camera``.

    Parameters
    ----------
    eye, target
        Position of the camera and point to look at, world frame, m, shape (3,); they must differ.
    up
        World direction that points up (-v) in the image, shape (3,). The camera's x axis is perpendicular to it
        (thesis A.3). If it is parallel to the line of sight, the world axis most perpendicular to that line
        replaces it.

    Examples
    --------
    >>> world_from_camera = look_at(eye=(0.5, 0, 0.3), target=(0.5, 0, 0))
    >>> world_from_camera.apply((0, 0, 0.3)).round(6).tolist()  # 0.3 m ahead of the lens
    [0.5, 0.0, 0.0]
    """
    finite((3,), eye=eye, target=target, up=up)
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


@checked
@dataclass(frozen=True)
class VirtualSphere(Pictured):
    """Sphere about an object, on which the camera moves facing the center.

    A viewpoint is given by its tilt from the pole, its azimuth about the pole and its roll about the optical axis.
    Azimuth 0 is towards +x for the default pole +z; for another pole, the smallest rotation from +z to the pole carries
    +x along.

    Parameters
    ----------
    center
        Center of the object, world frame, m, shape (3,).
    radius
        Distance from the camera to the center, m.
    pole
        Normal of the object, world frame, shape (3,), normalized here. Tilts are measured from it.

    Examples
    --------
    >>> sphere = VirtualSphere(center=(0.5, 0, 0), radius=0.25)
    >>> sphere
    VirtualSphere(center=(0.5, 0, 0), radius=0.25, pole=(0, 0, 1))
    >>> sphere.viewpoint(tilt=np.pi / 2, azimuth=0).translation.round(6).tolist()
    [0.75, 0.0, 0.0]
    """

    _figure = "plot_sphere"

    center: NDArray[np.float64]
    radius: float
    pole: NDArray[np.float64] = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))

    def __post_init__(self) -> None:
        center, pole = np.array(self.center, float), np.array(self.pole, float)
        finite((3,), center=center, pole=pole)
        norm = np.linalg.norm(pole)
        if not norm > 0 or not 0 < self.radius < np.inf:
            raise InvalidParameterError(
                f"a sphere has the pole not zero, and a positive radius in meters; got {pole!r} and {self.radius}"
            )
        pole /= norm
        for array in (center, pole):
            array.flags.writeable = False
        object.__setattr__(self, "center", center)
        object.__setattr__(self, "pole", pole)

    def __repr__(self) -> str:
        center, pole = (", ".join(f"{x:.4g}" for x in vector) for vector in (self.center, self.pole))
        return f"VirtualSphere(center=({center}), radius={self.radius:.4g}, pole=({pole}))"

    def viewpoint(self, tilt: ArrayLike, azimuth: ArrayLike, roll: ArrayLike = 0.0) -> RigidTransform:
        """Camera pose ``world_from_camera`` at one viewpoint, or at many: the three angles broadcast.

        Parameters
        ----------
        tilt
            Angle from the pole, rad, in [-pi, pi]; at 0 the camera looks along the object's normal.
        azimuth
            Angle about the pole, rad.
        roll
            Rotation of the camera about its optical axis, rad, positive from its x towards its y axis: clockwise as the
            camera sees it.

        Notes
        -----
        At roll 0 the camera's x axis is perpendicular to the pole (parallel to the table for the default pole; thesis
        A.3), and the pole points up in the image. At the pole itself the azimuth alone determines the roll, so that the
        pose is continuous along every meridian.
        """
        angles = [np.asarray(a, float) for a in (tilt, azimuth, roll)]
        try:
            tilt, azimuth, roll = np.broadcast_arrays(*angles)
        except ValueError as error:
            shapes = ", ".join(str(angle.shape) for angle in angles)
            raise InvalidParameterError(
                f"tilt, azimuth and roll are numbers, or as many of each; got shapes {shapes}"
            ) from error
        finite(azimuth=azimuth, roll=roll)
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
        """Camera poses spread evenly by area over a cap, in a spiral from the pole outward (thesis Fig. 2.5).

        Parameters
        ----------
        n
            Number of poses, a multiple of ``rolls``.
        max_tilt
            Half-angle of the cap, rad.
        rolls
            Number of evenly spaced rolls at each of the ``n / rolls`` points.
        """
        if n < 1 or rolls < 1 or n % rolls:
            raise InvalidParameterError(f"n must be a positive multiple of rolls; got n={n}, rolls={rolls}")
        if not 0 <= max_tilt <= np.pi:
            raise InvalidParameterError(
                f"max_tilt is in radians, from 0 to pi; got {max_tilt}. For degrees: np.radians(…)"
            )
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
        """Random camera poses within a cap, with uniform roll (thesis A.3, Fig. 2.6; errata 21).

        Parameters
        ----------
        n
            Number of poses.
        rng
            Random generator, or a seed.
        max_tilt
            Half-angle of the cap, rad.
        sigma
            Standard deviation of each of the two components of the tilt, rad: normal about the pole, truncated to the
            cap. None: uniform in area over the cap.
        """
        if n < 0 or not 0 < max_tilt <= np.pi or (sigma is not None and not 0 < sigma < np.inf):
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
        """Smallest rotation from +z to the pole."""
        z = np.array([0.0, 0.0, 1.0])
        axis = np.cross(z, self.pole)
        norm = np.linalg.norm(axis)
        if norm < 1e-12:
            return Rotation.identity() if self.pole[2] > 0 else Rotation.from_euler("x", np.pi)
        return Rotation.from_rotvec(axis / norm * np.arctan2(norm, self.pole[2]))

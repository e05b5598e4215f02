"""What a real arm saw, through the same door: pictures, the poses that its controller reported, and its calibration.

A recording is a folder: pictures; ``poses.csv`` (or ``.yaml``, ``.json``) with a row for each; ``lens.json`` (or
``.yaml``, as ROS writes it); and ``hand_eye.json``, where the poses are the hand's. Or it is a bag of ROS 1 or 2.
"""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation, Slerp

from gvp_lib.checks import checked
from gvp_lib.errors import GvpError, InvalidImageError, InvalidParameterError, MissingExtraError
from gvp_lib.geometry.calibration import Calibration, HandEye
from gvp_lib.geometry.camera import CameraIntrinsics
from gvp_lib.perception.images import check_mask, check_rgb
from gvp_lib.perception.segmentation import Segmenter
from gvp_lib.photographs.desk import Photographs, view_of
from gvp_lib.picture import count

__all__ = ["RecordedArm"]

_QUATERNION = ("x", "y", "z", "qx", "qy", "qz", "qw")
_VECTOR = ("x", "y", "z", "rx", "ry", "rz")
_MATRIX = tuple(f"m{row}{column}" for row in range(3) for column in range(4))
_FORMS = {"a quaternion, scalar last": _QUATERNION, "a rotation vector, rad": _VECTOR, "a matrix, row by row": _MATRIX}
_GAP = 0.5  # s between two poses of a bag, beyond which nothing is known of the arm in between
_CODES = {
    "rgb8": None,
    "bgr8": cv2.COLOR_BGR2RGB,
    "rgba8": cv2.COLOR_RGBA2RGB,
    "bgra8": cv2.COLOR_BGRA2RGB,
    "mono8": cv2.COLOR_GRAY2RGB,
    "8UC1": cv2.COLOR_GRAY2RGB,
    "8UC3": cv2.COLOR_BGR2RGB,
    "bayer_rggb8": cv2.COLOR_BayerRGGB2RGB,
    "bayer_bggr8": cv2.COLOR_BayerBGGR2RGB,
    "bayer_gbrg8": cv2.COLOR_BayerGBRG2RGB,
    "bayer_grbg8": cv2.COLOR_BayerGRBG2RGB,
}


@checked
@dataclass(frozen=True, eq=False)
class RecordedArm:
    """Pictures by the camera in an arm's hand, and the poses that the arm reported.

    Parameters
    ----------
    pictures
        Pictures, files or RGB uint8 (H, W, 3), n of them.
    poses
        Pose of the hand at each, ``base_from_hand``, as the controller reports it; or of the camera,
        ``base_from_camera``, where ``hand_from_camera`` is None. Shape (n,).
    lens
        Camera's lens: a :class:`gvp_lib.geometry.Calibration`, by which pictures are straightened, or of pictures
        without distortion the :class:`gvp_lib.CameraIntrinsics`.
    hand_from_camera
        Result of :func:`gvp_lib.geometry.calibrate_hand_eye`, or its pose; None: the poses are the camera's.
    names
        Names of the pictures, for what is said of them; by default their files' or numbers.

    Examples
    --------
    >>> recording = RecordedArm.read("monday")  # doctest: +SKIP
    >>> seen = recording.views(Whole(red))  # doctest: +SKIP
    >>> ContourFit().estimate([seen.arc], seen.intrinsics)  # doctest: +SKIP
    """

    pictures: Sequence[str | os.PathLike[str] | NDArray[np.uint8]]
    poses: RigidTransform | Sequence[RigidTransform]
    lens: Calibration | CameraIntrinsics
    hand_from_camera: RigidTransform | HandEye | None = None
    names: Sequence[str] = field(default=())

    def __post_init__(self) -> None:
        n = len(self.pictures)
        many = self.poses if isinstance(self.poses, RigidTransform) else RigidTransform.concatenate(list(self.poses))
        if many.single or len(many) != n or n == 0:
            raise InvalidParameterError(
                f"a recording has a pose for each of its pictures, one or more; got {count(n, 'picture')} and "
                f"{'a single pose' if many.single else count(len(many), 'pose')}"
            )
        names = [
            Path(each).name if isinstance(each, str | os.PathLike) else f"{k:03d}.png"
            for k, each in enumerate(self.pictures)
        ]
        object.__setattr__(self, "poses", many)
        object.__setattr__(self, "names", tuple(self.names) or tuple(names))
        if len(self.names) != n:
            raise InvalidParameterError(f"names are as many as pictures, {n}; got {len(self.names)}")
        if isinstance(self.hand_from_camera, HandEye):
            object.__setattr__(self, "hand_from_camera", self.hand_from_camera.hand_from_camera)

    def __repr__(self) -> str:
        whose = "the camera's" if self.hand_from_camera is None else "the hand's"
        lens = self.intrinsics
        return f"RecordedArm({count(len(self), 'picture')}, {lens.width} x {lens.height} px, poses of {whose})"

    def __len__(self) -> int:
        return len(self.pictures)

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """Pinhole of the pictures, once they are straightened."""
        return self.lens.intrinsics if isinstance(self.lens, Calibration) else self.lens

    @property
    def cameras(self) -> RigidTransform:
        """Where the camera was at each picture, ``base_from_camera``, shape (n,)."""
        assert isinstance(self.poses, RigidTransform)
        if self.hand_from_camera is None:
            return self.poses
        assert isinstance(self.hand_from_camera, RigidTransform)
        return self.poses * self.hand_from_camera

    def picture(self, k: int) -> NDArray[np.uint8]:
        """Picture number k, straightened, uint8 (H, W, 3).

        Parameters
        ----------
        k
            Number of the picture, from 0.

        Raises
        ------
        InvalidImageError
            There is no such picture, or it is of another size than the lens.
        """
        if not -len(self) <= k < len(self):
            raise InvalidImageError(f"the recording has pictures 0 to {len(self) - 1}; got {k}")
        given, lens = self.pictures[k], self.intrinsics
        if isinstance(given, str | os.PathLike):
            read = cv2.imread(str(given), cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION)
            if read is None:
                raise InvalidImageError(f"{given} is no picture that OpenCV reads")
            given = np.asarray(read, np.uint8)
        rgb = check_rgb(given)
        if rgb.shape[:2] != (lens.height, lens.width):
            height, width = rgb.shape[:2]
            raise InvalidImageError(
                f"{self.names[k]} is {width} x {height} px; the lens is that of pictures of {lens.width} x "
                f"{lens.height}"
            )
        return self.lens.undistort(rgb) if isinstance(self.lens, Calibration) else rgb

    def views(self, segmenter: Segmenter) -> Photographs:
        """What the arm saw of an object, for every estimator: ``planner.estimate([seen.arc], seen.intrinsics)``.

        Parameters
        ----------
        segmenter
            RGB uint8 (H, W, 3) to mask bool (H, W), of whose mask the largest region counts.

        Raises
        ------
        InvalidImageError
            No picture shows the object; the text has a line for each.
        """
        views, files, skipped = [], [], {}
        for k, (name, camera) in enumerate(zip(self.names, self.cameras, strict=True)):
            rgb = self.picture(k)
            view = view_of(camera, rgb, check_mask(segmenter(rgb), rgb.shape[:2]))
            if isinstance(view, str):
                skipped[name] = view
            else:
                views.append(view)
                files.append(name)
        if not views:
            lines = "".join(f"\n  {name} {reason}" for name, reason in skipped.items())
            raise InvalidImageError(f"no picture of the recording shows the object whole{lines}")
        return Photographs(tuple(views), self.intrinsics, _calibrated(self.lens), tuple(files), skipped)

    # --- files ----------------------------------------------------------------------------------------------------

    @classmethod
    def read(
        cls,
        folder: str | os.PathLike[str],
        lens: Calibration | CameraIntrinsics | None = None,
        hand_from_camera: RigidTransform | HandEye | None = None,
    ) -> RecordedArm:
        """Read a folder.

        ``poses.csv`` has a header, and in each row the picture's file, ``picture``, and the pose: ``x, y, z``, m, with
        ``qx, qy, qz, qw`` or the rotation vector ``rx, ry, rz``, rad; or the matrix, ``m00`` to ``m23``. In
        ``poses.yaml`` and ``.json`` it is a list of the same, or of ``picture`` and ``matrix``.

        Parameters
        ----------
        folder
            Folder with the pictures.
        lens
            Lens; None: the folder's ``lens.json`` or ``.yaml``, as :meth:`write` or ROS's calibration writes it.
        hand_from_camera
            As of :class:`RecordedArm`; None: that of the folder's ``hand_eye.json``, if it has one.

        Raises
        ------
        InvalidParameterError
            A file is missing, or is not understood; the text says which, and what it should have.
        """
        folder = Path(folder)
        rows = _rows(folder)
        pictures, poses = [], []
        for k, row in enumerate(rows, start=1):
            name = str(row.get("picture", "")).strip()
            if not name or not (folder / name).is_file():
                raise InvalidParameterError(f"row {k} of {folder}'s poses names a picture in it; got {name!r}")
            pictures.append(folder / name)
            poses.append(_pose(row, f"row {k} of {folder}'s poses"))
        if hand_from_camera is None and (found := _find(folder, "hand_eye")) is not None:
            data = _load(found)
            row = data.get("hand_from_camera", data) if isinstance(data, Mapping) else {"matrix": data}
            hand_from_camera = _pose(row if isinstance(row, Mapping) else {"matrix": row}, str(found))
        return cls(pictures, poses, _lens_of(folder) if lens is None else lens, hand_from_camera)

    def write(self, folder: str | os.PathLike[str]) -> Path:
        """Write a folder that :meth:`read` reads: pictures as PNG, straightened, poses, lens and hand-eye result.

        Parameters
        ----------
        folder
            Folder, new or empty.

        Returns
        -------
        Path
            The folder.
        """
        folder = Path(folder)
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise InvalidParameterError(f"a recording is written into a new or empty folder; {folder} is not")
        folder.mkdir(parents=True, exist_ok=True)
        names = [f"{k:03d}.png" for k in range(len(self))]
        for k, name in enumerate(names):
            cv2.imwrite(str(folder / name), cv2.cvtColor(self.picture(k), cv2.COLOR_RGB2BGR))
        with (folder / "poses.csv").open("w", newline="", encoding="utf-8") as file:
            table = csv.writer(file)
            table.writerow(["picture", *_QUATERNION])
            for name, pose in zip(names, self.poses, strict=True):
                table.writerow([name, *map(float, pose.translation), *map(float, pose.rotation.as_quat())])
        lens = {key: getattr(self.intrinsics, key) for key in ("width", "height", "fx", "fy", "cx", "cy")}
        (folder / "lens.json").write_text(json.dumps(lens, indent=1) + "\n", "utf-8")
        if isinstance(self.hand_from_camera, RigidTransform):
            hand = {"hand_from_camera": self.hand_from_camera.as_matrix().tolist()}
            (folder / "hand_eye.json").write_text(json.dumps(hand, indent=1) + "\n", "utf-8")
        return folder

    @classmethod
    def from_bag(
        cls,
        bag: str | os.PathLike[str],
        image: str,
        *,
        pose: str | None = None,
        joints: str | None = None,
        forward: Callable[[NDArray[np.float64]], RigidTransform] | None = None,
        lens: Calibration | CameraIntrinsics | str | None = None,
        hand_from_camera: RigidTransform | HandEye | None = None,
        most: int = 40,
    ) -> RecordedArm:
        """Read a bag of ROS 1 (a file) or ROS 2 (a folder), with the extra ``recordings``; no ROS is needed.

        Parameters
        ----------
        bag
            File or folder.
        image
            Topic of the pictures, ``sensor_msgs`` Image or CompressedImage.
        pose
            Topic of the poses: any message of ``geometry_msgs`` or ``nav_msgs`` that has one.
        joints
            Instead of ``pose``, topic of the joints, ``sensor_msgs`` JointState.
        forward
            For ``joints``: joint angles in the order of their message, shape (n,), rad, to the pose that
            ``hand_from_camera`` starts from; or to that of the camera, as of an arm of ours
            :meth:`gvp_lib.simulation.InverseKinematics.forward`.
        lens
            Lens; or the topic of a ``sensor_msgs`` CameraInfo. None: ``camera_info`` beside the image's topic.
        hand_from_camera
            As of :class:`RecordedArm`.
        most
            Number of pictures to take, evenly over the time.

        Raises
        ------
        InvalidParameterError
            The bag has no such topic, or its messages are none of these; the text says which it has.
        """
        if (pose is None) == (joints is None) or (joints is not None and forward is None) or most < 1:
            raise InvalidParameterError(
                "a bag is read with a topic of poses, pose=..., or with one of joints and what makes a pose of them, "
                f"joints=..., forward=..., and most >= 1; got pose={pose!r}, joints={joints!r}, forward={forward!r} "
                f"and most={most}"
            )
        info = lens if isinstance(lens, str) else f"{image.rsplit('/', 1)[0]}/camera_info"
        with _opened(Path(bag)) as reader:
            known = {connection.topic for connection in reader.connections}
            arm = str(pose if pose is not None else joints)
            wanted = [image, arm] + ([info] if lens is None or isinstance(lens, str) else [])
            if absent := [topic for topic in wanted if topic not in known]:
                raise InvalidParameterError(
                    f"{bag} has no topic {', '.join(absent)}; it has {', '.join(sorted(known))}"
                )
            make = _pose_of_message if pose is not None else lambda each: _forward(forward, each)
            moments, track = zip(*((at, make(each)) for at, each in _messages(reader, arm)), strict=True)
            if lens is None or isinstance(lens, str):
                lens = _lens_of_message(next(each for _, each in _messages(reader, info)))
            came, known_from = _arrivals(reader, image), _arrivals(reader, arm)
            inside = [k for k, at in enumerate(came) if known_from[0] <= at <= known_from[-1]]
            evenly = np.linspace(0, len(inside) - 1, min(most, len(inside))).round().astype(int)
            chosen = {inside[k] for k in evenly}
            pictures, poses, names = [], [], []
            for at, each in _messages(reader, image, chosen):
                if (there := _between(np.array(moments), track, at)) is not None:
                    pictures.append(_picture_of(each))
                    poses.append(there)
                    names.append(f"{(at - moments[0]) / 1e9:.3f} s")
        if not pictures:
            raise InvalidParameterError(f"no picture of {image} has poses of {arm} shortly before and after it")
        return cls(pictures, poses, lens, hand_from_camera, names)


def _calibrated(lens: Calibration | CameraIntrinsics) -> Calibration:
    return lens if isinstance(lens, Calibration) else Calibration(lens, np.zeros(5), np.nan, np.full(2, np.nan), ())


# --- a folder's files -----------------------------------------------------------------------------------------------


def _find(folder: Path, stem: str) -> Path | None:
    return next((path for end in (".csv", ".json", ".yaml", ".yml") if (path := folder / (stem + end)).is_file()), None)


def _load(path: Path) -> Any:
    """Content of a JSON or YAML file."""
    text = path.read_text("utf-8-sig")
    try:
        if path.suffix == ".json":
            return json.loads(text)
        try:
            from ruamel.yaml import YAML
            from ruamel.yaml.error import YAMLError
        except ImportError as error:
            raise MissingExtraError("a YAML file", error.name or "ruamel.yaml", "recordings") from error
        try:
            return YAML(typ="safe").load(text)
        except YAMLError as error:
            raise ValueError(str(error)) from None
    except ValueError as error:
        raise InvalidParameterError(f"{path} is no {path.suffix[1:].upper()} file: {error}") from None


def _rows(folder: Path) -> list[Mapping[str, Any]]:
    path = _find(folder, "poses") if folder.is_dir() else None
    if path is None:
        raise InvalidParameterError(f"a recording is a folder with poses.csv, .yaml or .json in it; got {folder}")
    if path.suffix == ".csv":
        with path.open(newline="", encoding="utf-8-sig") as file:
            return [{key.strip(): value for key, value in row.items() if key} for row in csv.DictReader(file)]
    rows = _load(path)
    if not isinstance(rows, list) or not all(isinstance(row, Mapping) for row in rows):
        raise InvalidParameterError(f"{path} holds a list of poses, each with its picture; got {type(rows).__name__}")
    return rows


def _pose(row: Mapping[str, Any], where: str) -> RigidTransform:
    """Pose of a row, in any of its forms."""
    try:
        if "matrix" in row:
            matrix = np.array(row["matrix"], float).reshape(-1, 4)
            return RigidTransform.from_matrix(np.vstack([matrix[:3], (0, 0, 0, 1)]))
        for names in _FORMS.values():
            if all(name in row for name in names):
                numbers = np.array([row[name] for name in names], float)
                if not np.isfinite(numbers).all():
                    raise ValueError("a number is not finite")
                if names is _MATRIX:
                    return RigidTransform.from_matrix(np.vstack([numbers.reshape(3, 4), (0, 0, 0, 1)]))
                quaternion = names is _QUATERNION
                turn = Rotation.from_quat(numbers[3:]) if quaternion else Rotation.from_rotvec(numbers[3:])
                return RigidTransform.from_components(numbers[:3], turn)
    except (TypeError, ValueError) as error:
        raise InvalidParameterError(f"{where} has no pose: {error}") from None
    forms = "; ".join(f"{', '.join(names)} ({what})" for what, names in _FORMS.items())
    raise InvalidParameterError(f"{where} has a pose as {forms}; or matrix; got {', '.join(map(str, row))}")


def _lens_of(folder: Path) -> Calibration | CameraIntrinsics:
    path = _find(folder, "lens")
    if path is None:
        raise InvalidParameterError(
            f"{folder} holds no lens.json or lens.yaml; give the lens: RecordedArm.read(folder, lens)"
        )
    data = _load(path)
    try:
        if "camera_matrix" in data:  # ROS's
            size, matrix = (data["image_width"], data["image_height"]), data["camera_matrix"]["data"]
            return _lens(size, matrix, data.get("distortion_coefficients", {}).get("data", ()))
        lens = CameraIntrinsics(**{key: data[key] for key in ("width", "height", "fx", "fy", "cx", "cy")})
        return _with(lens, data.get("distortion", ()))
    except (GvpError, KeyError, TypeError, ValueError) as error:
        raise InvalidParameterError(
            f"{path} holds width, height, fx, fy, cx, cy, and distortion if there is any; or image_width, "
            f"image_height, camera_matrix and distortion_coefficients, as ROS writes them: {error!r}"
        ) from None


def _lens(size: tuple[int, int], matrix: ArrayLike, distortion: ArrayLike) -> Calibration | CameraIntrinsics:
    k = np.array(matrix, float).reshape(3, 3)
    fx, fy, cx, cy = (float(each) for each in (k[0, 0], k[1, 1], k[0, 2], k[1, 2]))
    return _with(CameraIntrinsics(int(size[0]), int(size[1]), fx, fy, cx, cy), distortion)


def _with(lens: CameraIntrinsics, distortion: ArrayLike) -> Calibration | CameraIntrinsics:
    bent = np.array(distortion, float).ravel()
    if not bent.any():
        return lens
    return Calibration(lens, np.pad(bent, (0, max(0, 5 - len(bent)))), np.nan, np.full(2, np.nan), ())


# --- bags -----------------------------------------------------------------------------------------------------------


def _opened(bag: Path) -> closing[Any]:
    """Reader of a bag, open."""
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise MissingExtraError("a bag", error.name or "rosbags", "recordings") from error
    try:
        reader = AnyReader([bag], default_typestore=get_typestore(Stores.LATEST))
        reader.open()
    except (AnyReaderError, OSError) as error:
        raise InvalidParameterError(f"a bag is a .bag file of ROS 1 or a folder of ROS 2; got {bag}: {error}") from None
    return closing(reader)


def _raw(reader: Any, topic: str) -> Iterator[tuple[Any, int, bytes]]:
    found: Iterator[tuple[Any, int, bytes]] = reader.messages([c for c in reader.connections if c.topic == topic])
    return found


def _arrivals(reader: Any, topic: str) -> list[int]:
    """When the messages of a topic were recorded, ns; none of them is unpacked."""
    return [arrived for _, arrived, _ in _raw(reader, topic)]


def _messages(reader: Any, topic: str, chosen: set[int] | None = None) -> Iterator[tuple[int, Any]]:
    """Moments, ns, and messages of a topic, by number or all; the moment that a message itself names, if it does."""
    for k, (connection, arrived, raw) in enumerate(_raw(reader, topic)):
        if chosen is None or k in chosen:
            message = reader.deserialize(raw, connection.msgtype)
            stamp = getattr(getattr(message, "header", None), "stamp", None)
            yield arrived if stamp is None or not stamp.sec else int(stamp.sec) * 10**9 + int(stamp.nanosec), message


def _pose_of_message(message: Any) -> RigidTransform:
    """Pose of a message that has one, however deep: PoseStamped, TransformStamped, Odometry and their like."""
    while not hasattr(message, "orientation") and not hasattr(message, "rotation"):
        message = getattr(message, "pose", None) or getattr(message, "transform", None)
        if message is None:
            raise InvalidParameterError("a topic of poses has messages with a pose or a transform")
    at = message.position if hasattr(message, "position") else message.translation
    turn = message.orientation if hasattr(message, "orientation") else message.rotation
    return RigidTransform.from_components([at.x, at.y, at.z], Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]))


def _forward(forward: Any, message: Any) -> RigidTransform:
    return forward(np.array(message.position, float))


def _lens_of_message(message: Any) -> Calibration | CameraIntrinsics:
    k, d = (message.k, message.d) if hasattr(message, "k") else (message.K, message.D)  # ROS 2, or 1
    return _lens((message.width, message.height), k, d)


def _picture_of(message: Any) -> NDArray[np.uint8]:
    data = np.asarray(message.data, np.uint8)
    if hasattr(message, "format"):  # CompressedImage
        decoded = cv2.imdecode(data, cv2.IMREAD_COLOR_RGB)
        if decoded is None:
            raise InvalidParameterError(f"a compressed picture is one that OpenCV reads; got {message.format!r}")
        return np.asarray(decoded, np.uint8)
    if message.encoding not in _CODES:
        raise InvalidParameterError(f"pictures are {', '.join(_CODES)}; got {message.encoding!r}")
    rows = data.reshape(message.height, message.step)
    channels = {"rgb8": 3, "bgr8": 3, "8UC3": 3, "rgba8": 4, "bgra8": 4}.get(message.encoding, 1)
    picture = rows[:, : channels * message.width].reshape(message.height, message.width, channels)
    code = _CODES[message.encoding]
    return np.ascontiguousarray(picture if code is None else np.asarray(cv2.cvtColor(picture, code), np.uint8))


def _between(moments: NDArray[np.int64], track: Sequence[RigidTransform], at: int) -> RigidTransform | None:
    """Pose at a moment between two that are known; None where these are too far apart."""
    k = int(np.clip(np.searchsorted(moments, at), 1, len(moments) - 1)) if len(moments) > 1 else 0
    if k == 0:
        return track[0] if abs(int(moments[0]) - at) <= _GAP * 1e9 else None
    low, high = int(moments[k - 1]), int(moments[k])
    if high - low > _GAP * 1e9:
        return None
    share = 0.0 if high == low else (at - low) / (high - low)
    a, b = track[k - 1], track[k]
    turn = Slerp([0.0, 1.0], Rotation.concatenate([a.rotation, b.rotation]))(share)
    return RigidTransform.from_components((1 - share) * a.translation + share * b.translation, turn)

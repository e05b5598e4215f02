"""Bags of ROS 1 and 2, written without ROS."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import RigidTransform

from gvp_lib.geometry import CameraIntrinsics


def bag_of(
    bag: Path,
    pictures: Sequence[NDArray[np.uint8]],
    poses: Sequence[RigidTransform],
    lens: CameraIntrinsics,
    *,
    ros: int = 2,
    encoding: str = "rgb8",
) -> Path:
    """A bag with pictures ten times a second, poses and joints fifty times, and the lens."""
    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    types = store.types
    header_more = {"seq": 0} if ros == 1 else {}

    def header(at: float) -> Any:
        stamp = types["builtin_interfaces/msg/Time"](sec=100 + int(at), nanosec=round(at % 1 * 1e9))
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id="", **header_more)

    names = ("d", "k", "r", "p") if ros == 2 else ("D", "K", "R", "P")
    k = np.array([lens.fx, 0, lens.cx, 0, lens.fy, lens.cy, 0, 0, 1.0])
    region = types["sensor_msgs/msg/RegionOfInterest"](x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    writer = Writer1(bag) if ros == 1 else Writer2(bag, version=9)
    with writer:

        def send(topic: str, kind: str, at: float, **fields: Any) -> None:
            kind = f"{kind.replace('.', '/msg/')}"
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            message = types[kind](header=header(at), **fields)
            raw = store.serialize_ros1(message, kind) if ros == 1 else store.serialize_cdr(message, kind)
            writer.write(connections[topic], round((100 + at) * 1e9), raw)

        connections: dict[str, Any] = {}
        for n, (rgb, pose) in enumerate(zip(pictures, poses, strict=True)):
            data = rgb if encoding == "rgb8" else rgb[..., ::-1]
            send(
                "/image", "sensor_msgs.Image", 0.1 * n + 0.1, height=lens.height, width=lens.width,
                encoding=encoding, is_bigendian=0, step=3 * lens.width, data=np.ascontiguousarray(data).ravel(),
            )  # fmt: skip
            send(
                "/camera_info", "sensor_msgs.CameraInfo", 0.1 * n + 0.1, height=lens.height, width=lens.width,
                distortion_model="plumb_bob", binning_x=0, binning_y=0, roi=region,
                **dict(zip(names, (np.zeros(5), k, np.eye(3).ravel(), np.zeros(12)), strict=True)),
            )  # fmt: skip
            for step in range(5):  # the hand rests about each picture
                x, y, z, w = pose.rotation.as_quat()
                at = types["geometry_msgs/msg/Point"](*map(float, pose.translation))
                turn = types["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w)
                when = 0.1 * n + 0.1 + 0.02 * (step - 2)
                send("/pose", "geometry_msgs.PoseStamped", when, pose=types["geometry_msgs/msg/Pose"](at, turn))
                send(
                    "/joints", "sensor_msgs.JointState", when, name=[f"j{i}" for i in range(6)],
                    position=np.full(6, 0.1 * n), velocity=np.zeros(6), effort=np.zeros(6),
                )  # fmt: skip
    return bag

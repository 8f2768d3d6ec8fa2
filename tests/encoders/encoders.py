"""Writes random ROS 2 messages in CDR, as two independent encoders write them.

Each record of the file is: length of the type's name (1 byte), name, encoder (1 byte: 0 rosbags,
1 pycdr2), length of the message (4 bytes, little-endian), message.
"""

import dataclasses
import struct
import sys
from typing import Any

import numpy as np
from pycdr2 import IdlStruct
from pycdr2.types import array, float32, float64, int32, sequence, uint8, uint32
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ACKERMANN = "ackermann_msgs/msg/AckermannDriveStamped"
TYPES = [
    ACKERMANN,
    "sensor_msgs/msg/JointState",
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/TwistStamped",
    "geometry_msgs/msg/PoseStamped",
    "sensor_msgs/msg/LaserScan",
    "sensor_msgs/msg/PointCloud2",
]


def typestore():
    store = get_typestore(Stores.ROS2_JAZZY)
    drive = "float32 steering_angle\nfloat32 steering_angle_velocity\nfloat32 speed\n"
    drive += "float32 acceleration\nfloat32 jerk\n"
    stamped = "std_msgs/Header header\nackermann_msgs/AckermannDrive drive\n"
    types = get_types_from_msg(drive, "ackermann_msgs/msg/AckermannDrive")
    types.update(get_types_from_msg(stamped, ACKERMANN))
    store.register(types)
    return store


# The same messages for pycdr2, which reads no .msg files.
@dataclasses.dataclass
class Time(IdlStruct):
    sec: int32
    nanosec: uint32


@dataclasses.dataclass
class Header(IdlStruct):
    stamp: Time
    frame_id: str


@dataclasses.dataclass
class Vector3(IdlStruct):
    x: float64
    y: float64
    z: float64


@dataclasses.dataclass
class Quaternion(IdlStruct):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclasses.dataclass
class Pose(IdlStruct):
    position: Vector3
    orientation: Quaternion


@dataclasses.dataclass
class PoseWithCovariance(IdlStruct):
    pose: Pose
    covariance: array[float64, 36]


@dataclasses.dataclass
class Twist(IdlStruct):
    linear: Vector3
    angular: Vector3


@dataclasses.dataclass
class TwistWithCovariance(IdlStruct):
    twist: Twist
    covariance: array[float64, 36]


@dataclasses.dataclass
class AckermannDrive(IdlStruct):
    steering_angle: float32
    steering_angle_velocity: float32
    speed: float32
    acceleration: float32
    jerk: float32


@dataclasses.dataclass
class AckermannDriveStamped(IdlStruct):
    header: Header
    drive: AckermannDrive


@dataclasses.dataclass
class JointState(IdlStruct):
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


@dataclasses.dataclass
class Odometry(IdlStruct):
    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance


@dataclasses.dataclass
class TwistStamped(IdlStruct):
    header: Header
    twist: Twist


@dataclasses.dataclass
class PoseStamped(IdlStruct):
    header: Header
    pose: Pose


@dataclasses.dataclass
class LaserScan(IdlStruct):
    header: Header
    angle_min: float32
    angle_max: float32
    angle_increment: float32
    time_increment: float32
    scan_time: float32
    range_min: float32
    range_max: float32
    ranges: sequence[float32]
    intensities: sequence[float32]


@dataclasses.dataclass
class PointField(IdlStruct):
    name: str
    offset: uint32
    datatype: uint8
    count: uint32


@dataclasses.dataclass
class PointCloud2(IdlStruct):
    header: Header
    height: uint32
    width: uint32
    fields: sequence[PointField]
    is_bigendian: bool
    point_step: uint32
    row_step: uint32
    data: sequence[uint8]
    is_dense: bool


class Random:
    """Random fields, the awkward ones among them."""

    def __init__(self, seed: int):
        self.generator = np.random.default_rng(seed)

    def whole(self, low: int, high: int) -> int:
        return int(self.generator.integers(low, high))

    def text(self, longest: int = 24) -> str:
        letters = "abcxyz_/0189 .-äß漢🤖"
        return "".join(letters[self.whole(0, len(letters))] for _ in range(self.whole(0, longest)))

    def wide(self) -> float:
        strange = [0.0, -0.0, float("nan"), float("inf"), float("-inf"), 5e-324, 1e308]
        if self.whole(0, 20) == 0:
            return strange[self.whole(0, len(strange))]
        return float(self.generator.normal(scale=10.0))

    def narrow(self) -> float:
        return float(np.float32(min(max(self.wide(), -1e30), 1e30)))

    def narrows(self, longest: int) -> np.ndarray:
        values = self.generator.normal(5.0, 3.0, self.whole(0, longest)).astype(np.float32)
        values[values > 9.0] = np.inf
        values[values < 0.0] = np.nan
        return values

    def wides(self, count: int) -> np.ndarray:
        return np.array([self.wide() for _ in range(count)], dtype=np.float64)

    def header(self) -> dict[str, Any]:
        stamp = {"sec": self.whole(0, 2**31), "nanosec": self.whole(0, 10**9)}
        return {"stamp": stamp, "frame_id": self.text()}

    def vector(self) -> dict[str, Any]:
        return {name: self.wide() for name in "xyz"}

    def pose(self) -> dict[str, Any]:
        turn = {name: self.wide() for name in "xyzw"}
        return {"position": self.vector(), "orientation": turn}

    def twist(self) -> dict[str, Any]:
        return {"linear": self.vector(), "angular": self.vector()}

    def message(self, of: str) -> dict[str, Any]:
        fields: dict[str, Any] = {"header": self.header()}
        if of == ACKERMANN:
            names = [field.name for field in dataclasses.fields(AckermannDrive)]
            fields["drive"] = {name: self.narrow() for name in names}
        elif of.endswith("JointState"):
            joints = self.whole(0, 8)
            fields["name"] = [self.text() for _ in range(joints)]
            for name in ("position", "velocity", "effort"):
                fields[name] = self.wides(joints if self.whole(0, 3) else 0)
        elif of.endswith("Odometry"):
            fields["child_frame_id"] = self.text()
            fields["pose"] = {"pose": self.pose(), "covariance": self.wides(36)}
            fields["twist"] = {"twist": self.twist(), "covariance": self.wides(36)}
        elif of.endswith("TwistStamped"):
            fields["twist"] = self.twist()
        elif of.endswith("PoseStamped"):
            fields["pose"] = self.pose()
        elif of.endswith("LaserScan"):
            names = ["angle_min", "angle_max", "angle_increment", "time_increment"]
            for name in [*names, "scan_time", "range_min", "range_max"]:
                fields[name] = self.narrow()
            fields["ranges"] = self.narrows(400)
            fields["intensities"] = self.narrows(100)
        else:
            self.cloud(fields)
        return fields

    def cloud(self, fields: dict[str, Any]) -> None:
        def field() -> dict[str, Any]:
            place = {"offset": self.whole(0, 64), "datatype": self.whole(1, 9)}
            return {"name": self.text(12), **place, "count": self.whole(1, 4)}

        width, step = self.whole(0, 40), self.whole(1, 33)
        data = self.generator.integers(0, 256, width * step, dtype=np.uint8)
        fields.update(height=1, width=width, fields=[field() for _ in range(self.whole(0, 6))])
        fields.update(is_bigendian=bool(self.whole(0, 2)), point_step=step, row_step=width * step)
        fields.update(data=data, is_dense=bool(self.whole(0, 2)))


def of_rosbags(store, of: str, fields: dict[str, Any]):
    """The message as rosbags has it: nested types by name."""
    cls = store.types[of]
    values = {}
    for name, (kind, what) in store.get_msgdef(of).fields:
        value = fields[name]
        if kind == Nodetype.NAME:
            value = of_rosbags(store, what, value)
        elif kind == Nodetype.SEQUENCE and what[0][0] == Nodetype.NAME:
            value = [of_rosbags(store, what[0][1], one) for one in value]
        values[name] = value
    return cls(**values)


def of_pycdr2(cls, fields: dict[str, Any]):
    """The message as pycdr2 has it."""
    values = {}
    for field in dataclasses.fields(cls):
        value = fields[field.name]
        if isinstance(value, dict):
            value = of_pycdr2(field.type, value)
        elif isinstance(value, np.ndarray):
            value = value.tolist()
        elif field.name == "fields":
            value = [of_pycdr2(PointField, one) for one in value]
        values[field.name] = value
    return cls(**values)


def main() -> None:
    out, count = sys.argv[1], int(sys.argv[2])
    store, random = typestore(), Random(7)
    with open(out, "wb") as file:
        for of in TYPES:
            cls = globals()[of.rsplit("/", 1)[1]]
            name = of.encode()
            for _ in range(count):
                fields = random.message(of)
                written = [
                    bytes(store.serialize_cdr(of_rosbags(store, of, fields), of)),
                    bytes(of_pycdr2(cls, fields).serialize()),
                ]
                for encoder, message in enumerate(written):
                    head = bytes([len(name)]) + name + bytes([encoder])
                    file.write(head + struct.pack("<I", len(message)) + message)


main()

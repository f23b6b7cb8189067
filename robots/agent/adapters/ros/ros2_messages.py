"""The messages of ROS 2 that an adapter needs, as DDS types, and to and from JSON objects.

A type of ROS is called `package::msg::dds_::Name_` on the wire, a topic `rt/…`; fields are laid out
in the order of the .msg files of common_interfaces, here from Humble on. Numbers that JSON lacks
become None.
"""
# mypy: disable-error-code="type-arg,valid-type,assignment,misc,arg-type"
# (IDL says its types by values, which no type checker knows.)

import base64
import dataclasses
import math
from dataclasses import dataclass, field
from typing import Any

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float32, float64, int8, int32, sequence, uint8, uint32

Json = dict[str, Any]


def _made(kind: type[Any]) -> Any:
    return field(default_factory=kind)


def _zeros(count: int) -> Any:
    return field(default_factory=lambda: [0.0] * count)


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time = _made(Time)
    frame_id: str = ""


@dataclass
class Bool(IdlStruct, typename="std_msgs::msg::dds_::Bool_"):
    data: bool = False


@dataclass
class Float64(IdlStruct, typename="std_msgs::msg::dds_::Float64_"):
    data: float64 = 0.0


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0
    w: float64 = 1.0


@dataclass
class Pose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Point = _made(Point)
    orientation: Quaternion = _made(Quaternion)


@dataclass
class PoseStamped(IdlStruct, typename="geometry_msgs::msg::dds_::PoseStamped_"):
    header: Header = _made(Header)
    pose: Pose = _made(Pose)


@dataclass
class PoseWithCovariance(IdlStruct, typename="geometry_msgs::msg::dds_::PoseWithCovariance_"):
    pose: Pose = _made(Pose)
    covariance: array[float64, 36] = _zeros(36)


@dataclass
class PoseWithCovarianceStamped(
    IdlStruct, typename="geometry_msgs::msg::dds_::PoseWithCovarianceStamped_"
):
    header: Header = _made(Header)
    pose: PoseWithCovariance = _made(PoseWithCovariance)


@dataclass
class Twist(IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
    linear: Vector3 = _made(Vector3)
    angular: Vector3 = _made(Vector3)


@dataclass
class TwistStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TwistStamped_"):
    header: Header = _made(Header)
    twist: Twist = _made(Twist)


@dataclass
class TwistWithCovariance(IdlStruct, typename="geometry_msgs::msg::dds_::TwistWithCovariance_"):
    twist: Twist = _made(Twist)
    covariance: array[float64, 36] = _zeros(36)


@dataclass
class Odometry(IdlStruct, typename="nav_msgs::msg::dds_::Odometry_"):
    header: Header = _made(Header)
    child_frame_id: str = ""
    pose: PoseWithCovariance = _made(PoseWithCovariance)
    twist: TwistWithCovariance = _made(TwistWithCovariance)


@dataclass
class LaserScan(IdlStruct, typename="sensor_msgs::msg::dds_::LaserScan_"):
    header: Header = _made(Header)
    angle_min: float32 = 0.0
    angle_max: float32 = 0.0
    angle_increment: float32 = 0.0
    time_increment: float32 = 0.0
    scan_time: float32 = 0.0
    range_min: float32 = 0.0
    range_max: float32 = 0.0
    ranges: sequence[float32] = _made(list)
    intensities: sequence[float32] = _made(list)


@dataclass
class BatteryState(IdlStruct, typename="sensor_msgs::msg::dds_::BatteryState_"):
    header: Header = _made(Header)
    voltage: float32 = math.nan
    temperature: float32 = math.nan
    current: float32 = math.nan
    charge: float32 = math.nan
    capacity: float32 = math.nan
    design_capacity: float32 = math.nan
    percentage: float32 = math.nan
    power_supply_status: uint8 = 0
    power_supply_health: uint8 = 0
    power_supply_technology: uint8 = 0
    present: bool = True
    cell_voltage: sequence[float32] = _made(list)
    cell_temperature: sequence[float32] = _made(list)
    location: str = ""
    serial_number: str = ""


@dataclass
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    header: Header = _made(Header)
    name: sequence[str] = _made(list)
    position: sequence[float64] = _made(list)
    velocity: sequence[float64] = _made(list)
    effort: sequence[float64] = _made(list)


@dataclass
class Transform(IdlStruct, typename="geometry_msgs::msg::dds_::Transform_"):
    translation: Vector3 = _made(Vector3)
    rotation: Quaternion = _made(Quaternion)


@dataclass
class TransformStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TransformStamped_"):
    header: Header = _made(Header)
    child_frame_id: str = ""
    transform: Transform = _made(Transform)


@dataclass
class TFMessage(IdlStruct, typename="tf2_msgs::msg::dds_::TFMessage_"):
    transforms: sequence[TransformStamped] = field(
        default_factory=list, metadata={"of": TransformStamped}
    )


@dataclass
class UUID(IdlStruct, typename="unique_identifier_msgs::msg::dds_::UUID_"):
    uuid: array[uint8, 16] = field(default_factory=lambda: [0] * 16)


@dataclass
class GoalInfo(IdlStruct, typename="action_msgs::msg::dds_::GoalInfo_"):
    goal_id: UUID = _made(UUID)
    stamp: Time = _made(Time)


@dataclass
class GoalStatus(IdlStruct, typename="action_msgs::msg::dds_::GoalStatus_"):
    goal_info: GoalInfo = _made(GoalInfo)
    status: int8 = 0


@dataclass
class GoalStatusArray(IdlStruct, typename="action_msgs::msg::dds_::GoalStatusArray_"):
    status_list: sequence[GoalStatus] = field(default_factory=list, metadata={"of": GoalStatus})


@dataclass
class CompressedImage(IdlStruct, typename="sensor_msgs::msg::dds_::CompressedImage_"):
    header: Header = _made(Header)
    format: str = ""
    data: sequence[uint8] = _made(list)


TYPES: dict[str, type[IdlStruct]] = {
    "std_msgs/Bool": Bool,
    "std_msgs/Float64": Float64,
    "geometry_msgs/Twist": Twist,
    "geometry_msgs/TwistStamped": TwistStamped,
    "geometry_msgs/PoseStamped": PoseStamped,
    "geometry_msgs/PoseWithCovarianceStamped": PoseWithCovarianceStamped,
    "nav_msgs/Odometry": Odometry,
    "sensor_msgs/LaserScan": LaserScan,
    "sensor_msgs/BatteryState": BatteryState,
    "sensor_msgs/JointState": JointState,
    "tf2_msgs/TFMessage": TFMessage,
    "action_msgs/GoalStatusArray": GoalStatusArray,
    "sensor_msgs/CompressedImage": CompressedImage,
}


def plain(value: Any) -> Any:
    """Return a message as JSON has it."""
    if dataclasses.is_dataclass(value):
        return {each.name: plain(getattr(value, each.name)) for each in dataclasses.fields(value)}
    if isinstance(value, list | tuple) and value and type(value[0]) is int:
        return list(value)  # a picture has too many for a look at each
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if isinstance(value, bytes | bytearray):
        return list(value)
    return None if isinstance(value, float) and not math.isfinite(value) else value


def filled(kind: type[IdlStruct], content: Json) -> Any:
    """Return a message with the fields that an object names."""
    message: Any = kind()
    for name, value in content.items():
        now = getattr(message, name)
        of = message.__dataclass_fields__[name].metadata.get("of")
        if dataclasses.is_dataclass(now):
            setattr(message, name, filled(type(now), value))
        elif isinstance(value, str) and not isinstance(now, str):
            setattr(message, name, list(base64.b64decode(value)))
        else:
            setattr(message, name, [filled(of, each) for each in value] if of else value)
    return message

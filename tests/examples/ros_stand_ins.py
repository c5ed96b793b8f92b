"""Stand-ins for rclpy and the message packages of ROS 2 that the example node imports.

Message types have the fields of ROS 2's own definitions, which rosbags knows; as rclpy's, they
start with defaults, take fields by keyword and refuse numbers of other types.
"""

import sys
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

from rosbags.typesys import Stores, get_typestore

DEFINITIONS = get_typestore(Stores.ROS2_HUMBLE).fielddefs
BASE, NAME = 1, 2  # kinds of fields: a number or text, a message; others are sequences or arrays
NUMBERS = {"float32": float, "float64": float, "string": str}  # other types are whole numbers


class Message:
    """A message, whose type its subclass states."""

    TYPE = ""

    def __init__(self, **values: Any) -> None:
        for name, (kind, content) in DEFINITIONS[self.TYPE][1]:
            object.__setattr__(self, name, default(kind, content))
        for name, value in values.items():
            setattr(self, name, value)

    def __setattr__(self, name: str, value: Any) -> None:
        fields = dict(DEFINITIONS[self.TYPE][1])
        assert name in fields, f"{self.TYPE} has no {name}"
        kind, content = fields[name]
        if kind.value == BASE:
            assert isinstance(value, NUMBERS.get(content[0], int)), (
                f"{name} of {self.TYPE}: {value!r}"
            )
        elif kind.value == NAME:
            assert content == value.TYPE, f"{name} of {self.TYPE} is a {value.TYPE}"
        elif not isinstance(value, bytes):
            inner = content[0]
            expected = NUMBERS.get(inner[1][0], int) if inner[0].value == BASE else Message
            assert all(isinstance(each, expected) for each in value), f"{name} of {self.TYPE}"
        object.__setattr__(self, name, value)


def default(kind: Any, content: Any) -> Any:
    """The value of a field before it is set."""
    if kind.value == BASE:
        return NUMBERS.get(content[0], int)()
    return message_type(content)() if kind.value == NAME else []


def message_type(name: str) -> type[Message]:
    """The type called `package/msg/Name`."""
    return type(name.rsplit("/", 1)[-1], (Message,), {"TYPE": name})


@dataclass
class Publisher:
    """Keeps what is published."""

    kind: type
    topic: str
    published: list = field(default_factory=list)

    def publish(self, message: Message) -> None:
        assert message.TYPE == self.kind.TYPE
        self.published.append(message)


@dataclass
class Node:
    """A node with its publishers, parameters and logged warnings."""

    parameters: dict = field(default_factory=dict)
    publishers: dict = field(default_factory=dict)
    warnings: list = field(default_factory=list)

    def create_publisher(self, kind: type, topic: str, depth: int) -> Publisher:
        assert depth > 0
        return self.publishers.setdefault(topic, Publisher(kind, topic))

    def declare_parameter(self, name: str, value: Any) -> Any:
        @dataclass(frozen=True)
        class Parameter:
            value: Any

        return Parameter(self.parameters.get(name, value))

    def get_logger(self) -> "Node":
        return self

    def warning(self, text: str) -> None:
        self.warnings.append(text)


@dataclass
class Subscriber:
    """One topic."""

    node: Node
    kind: type
    topic: str
    qos_profile: Any = None


SYNCHRONIZED: list["Synchronizer"] = []  # in the order they were made


class Synchronizer:
    """Delivers sets of messages that a test declares to belong together."""

    def __init__(self, subscribers: list[Subscriber], queue_size: int, slop: float) -> None:
        assert queue_size > 0
        assert slop > 0
        self.topics = [(s.topic, s.kind.TYPE) for s in subscribers]
        self.node = subscribers[0].node
        SYNCHRONIZED.append(self)

    def registerCallback(self, callback: Any) -> None:  # noqa: N802 - ROS 2's name
        self.deliver = callback


def modules(node: Node) -> dict[str, ModuleType]:
    """The modules that the node imports; rclpy's `create_node` returns `node`."""
    made = {}
    for package, names in {
        "geometry_msgs": ("Point", "Pose", "PoseArray", "Quaternion"),
        "sensor_msgs": ("CameraInfo", "Image"),
        "std_msgs": ("Float32MultiArray", "Header"),
    }.items():
        made[package], made[f"{package}.msg"] = ModuleType(package), ModuleType(f"{package}.msg")
        for name in names:
            setattr(made[f"{package}.msg"], name, message_type(f"{package}/msg/{name}"))
    filters = made["message_filters"] = ModuleType("message_filters")
    filters.Subscriber, filters.ApproximateTimeSynchronizer = Subscriber, Synchronizer
    rclpy, qos = ModuleType("rclpy"), ModuleType("rclpy.qos")
    made |= {"rclpy": rclpy, "rclpy.qos": qos}
    qos.qos_profile_sensor_data = "best effort"
    rclpy.init = lambda: None
    rclpy.create_node = lambda name: node
    rclpy.spin = lambda node: None
    return made


def install(monkeypatch, node: Node) -> None:
    """Let imports find the stand-ins."""
    for name, module in modules(node).items():
        monkeypatch.setitem(sys.modules, name, module)

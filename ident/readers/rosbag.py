"""Logs in ROS bags: sensor_msgs/JointState in rosbag2 (.db3, .mcap, folder), MCAP and ROS 1 .bag."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.arrays import Array, FloatArray, IntArray
from ident.errors import InputError
from ident.log import JointLog
from ident.readers.columns import Columns, mapped_columns
from ident.readers.source import FileLog

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

    from ident.robot import Robot

JOINT_STATE = ("sensor_msgs/msg/JointState", "sensor_msgs/JointState")
NANOSECONDS = 1e-9


class BagLog(FileLog):
    """The joint states of a bag: position is q, velocity dq where sent, effort the current.

    Time counts from the first message of the bag. The stamps of the message headers are taken where they increase and
    span what the bag's own stamps span to 10 %, the bag's own stamps otherwise.
    """

    def _pieces(self) -> Iterator[tuple[JointLog, Columns]]:
        records = _read(self.path, self.robot)
        scale = {} if self.robot.card.log is None else mapped_columns(self.robot).scale
        fields: dict[str, Array] = {
            "q": np.array(records.position) * scale.get("q", 1.0),
            "current": np.array(records.effort) * scale.get("current", 1.0),
        }
        names = {"t": ("stamp",), "q": ("position",), "current": ("effort",), "dq": ("velocity",)}
        if records.velocity:
            fields["dq"] = np.array(records.velocity) * scale.get("dq", 1.0)
        stamps = _stamps(np.array(records.bag_time), np.array(records.header_time))
        yield JointLog(t=stamps, **fields, name=self.path.stem), Columns(names)


@dataclass
class _Records:
    """Joint states of one topic, one list entry a message; times in ns."""

    bag_time: list[int] = field(default_factory=list)
    header_time: list[int] = field(default_factory=list)
    position: list[FloatArray] = field(default_factory=list)
    velocity: list[FloatArray] = field(default_factory=list)
    effort: list[FloatArray] = field(default_factory=list)


def _stamps(bag: IntArray, header: IntArray) -> FloatArray:
    """Choose between bag and header times [ns] and return seconds from the first."""
    span = bag[-1] - bag[0]
    plausible = bool((np.diff(header) > 0).all()) and abs(int(header[-1] - header[0]) - int(span)) <= 0.1 * span
    chosen = header if plausible else bag
    return np.asarray((chosen - chosen[0]) * NANOSECONDS, dtype=np.float64)


def _read(path: Path, robot: Robot) -> _Records:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    try:
        # Bags before ROS 2 Iron carry no message definitions; JointState has been the same in all of them.
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            return _read_topic(reader, path, robot)
    except InputError:
        raise
    except Exception as error:  # rosbags raises its own, sqlite's and struct's errors on a broken bag
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"cannot be read as a bag ({reason})", str(path), "record or copy the bag again") from None


def _read_topic(reader: AnyReader, path: Path, robot: Robot) -> _Records:
    candidates = [c for c in reader.connections if c.msgtype in JOINT_STATE]
    if not candidates:
        has = ", ".join(sorted({f"{c.topic} ({c.msgtype})" for c in reader.connections})) or "nothing"
        raise InputError(f"no sensor_msgs/JointState in the bag, which has {has}", str(path), "record /joint_states")
    topics = sorted({c.topic for c in candidates})
    seen: list[str] = []
    for topic in topics:
        connections = [c for c in candidates if c.topic == topic]
        records = _Records()
        for connection, bag_time, raw in reader.messages(connections):
            message: Any = reader.deserialize(raw, connection.msgtype)
            columns = _joint_columns(message.name, robot)
            if columns is None:
                seen += [name for name in message.name if name not in seen]
                continue
            _append(records, message, columns, bag_time, path)
        if records.bag_time:
            return records
    if not seen:
        raise InputError(f"no messages on {', '.join(topics)}", str(path), "record the motion again")
    what = f"the bag has joints {', '.join(seen)}, not all of {', '.join(robot.joints)}"
    raise InputError(what, str(path), "set joints of the card, or name the bag's joints as [log] position")


def _joint_columns(names: list[str], robot: Robot) -> list[int] | None:
    """Return where in a message each of the robot's joints is; None where one is missing.

    Joints are known by the card's names or, where drivers name them otherwise, by those in ``[log] position``.
    """
    wanted: list[tuple[str, ...]] = [tuple(robot.joints)]
    if robot.card.log is not None:
        position = robot.card.log.position
        wanted.append((position,) if isinstance(position, str) else tuple(position))
    for listed in wanted:
        if len(listed) == robot.n and all(name in names for name in listed):
            return [names.index(name) for name in listed]
    return None


def _append(records: _Records, message: Any, columns: list[int], bag_time: int, path: Path) -> None:
    """Add one message of a topic that carries the robot's joints."""
    row = len(records.bag_time) + 1
    for name, values in (("position", message.position), ("effort", message.effort)):
        if len(values) != len(message.name):
            what = f"{name} has {len(values)} values for {len(message.name)} joints"
            how = "record joint states with position and effort"
            raise InputError(what, f"{path} row {row}", how)
    records.bag_time.append(bag_time)
    records.header_time.append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
    records.position.append(message.position[columns])
    records.effort.append(message.effort[columns])
    # A driver that leaves velocity out of some messages cannot be trusted with the others.
    complete = len(message.velocity) == len(message.name) and len(records.velocity) == row - 1
    if complete:
        records.velocity.append(message.velocity[columns])
    else:
        records.velocity.clear()

"""ROS bags, read with rosbags: the folder or .db3 file of a ROS 2 bag, and the .bag file of ROS 1."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ..table import LogTable
from ._format import Format
from ._messages import Message, message_tables


def _read(path: Path) -> list[LogTable]:
    return message_tables(path, _messages(path))


def _messages(path: Path) -> Iterator[Message]:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    # Bags of older recorders do not describe their messages; the standard ones have not changed since.
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        known = reader.typestore.types
        connections = [connection for connection in reader.connections if connection.msgtype in known]
        for connection, recorded, data in reader.messages(connections=connections):
            yield Message(connection.topic, recorded, reader.deserialize(data, connection.msgtype))


def _is_bag(path: Path, head: bytes) -> bool:
    return not head and (path / "metadata.yaml").is_file()


format = Format(
    name="ROS bag",
    suffixes=(".db3", ".bag"),
    contents="as MCAP; a ROS 2 bag is its folder or its .db3 file",
    read=_read,
    modules=("rosbags",),
    extra="ros",
    magic=(b"#ROSBAG", b"SQLite format 3\x00"),
    recognises=_is_bag,
)

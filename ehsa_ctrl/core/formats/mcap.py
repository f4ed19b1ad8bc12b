"""MCAP of ROS 2 and Foxglove, read with mcap: messages in ROS 2's encoding (mcap-ros2-support) or in JSON."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from ..table import LogTable
from ._format import Format
from ._messages import Message, message_tables


def _read(path: Path) -> list[LogTable]:
    return message_tables(path, _messages(path))


def _messages(path: Path) -> Iterator[Message]:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    factory = DecoderFactory()
    decoders = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.id not in decoders:
                plain = json.loads if channel.message_encoding == "json" else None
                decoders[channel.id] = plain or factory.decoder_for(channel.message_encoding, schema)
            decoder = decoders[channel.id]
            if decoder is not None:
                yield Message(channel.topic, message.log_time, decoder(message.data))


format = Format(
    name="MCAP",
    suffixes=(".mcap",),
    contents="topics in ROS 2's encoding or JSON: each number of a message is a channel; time from `header.stamp`, "
    "else the time of recording",
    read=_read,
    modules=("mcap", "mcap_ros2"),
    extra="ros",
    magic=(b"\x89MCAP0\r\n",),
)

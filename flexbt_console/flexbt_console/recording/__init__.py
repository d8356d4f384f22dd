# SPDX-License-Identifier: BSD-3-Clause
"""Runs as files: recorded from the topics of a robot, and replayed for the console without one."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .player import RunPlayer

__all__ = ['open_recording', 'write_recording']


def open_recording(file: Path) -> RunPlayer:
    """Return a recording to be shown, see :class:`RunPlayer`. Raises what that raises."""
    from .player import RunPlayer  # it loads ROS, which who only asks for help does without

    return RunPlayer(file)


def write_recording(file: Path, messages: Iterable[tuple[int, str, Any]]) -> None:
    """Write a recording of messages, each with its time (ns since the epoch) and the name of its topic.

    Raises OSError when there is such a file, or it cannot be written.
    """
    import contextlib

    from rclpy.serialization import serialize_message

    from .run_file import RunWriter
    from .topics import TOPICS, full_definition

    with contextlib.closing(RunWriter(file)) as writer:
        for now, name, message in messages:
            writer.add_topic(name, f'/{name}', TOPICS[name].type, full_definition(TOPICS[name].type))
            writer.add(name, serialize_message(message), now, now)

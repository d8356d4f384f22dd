# SPDX-License-Identifier: BSD-3-Clause
"""Runs as files: recorded from the topics of a robot, and replayed for the console without one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .player import RunPlayer

__all__ = ['open_recording']


def open_recording(file: Path) -> RunPlayer:
    """A recording to be shown, see :class:`flexbt_console.recording.player.RunPlayer`. Raises what that raises."""
    from .player import RunPlayer  # it loads ROS, which who only asks for help does without

    return RunPlayer(file)

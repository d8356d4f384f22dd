# SPDX-License-Identifier: BSD-3-Clause
"""Recordings that pages open: of robots and incidents (MCAP), and logs of trees (``.btlog``)."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from flexbt_common.files import USER_DIRECTORY, home_path
from flexbt_console.errors import ConsoleError
from flexbt_console.ui.web.past import RecordedPast, Recordings
from flexbt_core.values.text import one_line
from flexbt_server.groot2.log_file import SUFFIX, LogError, read_log
from flexbt_studio.documents.project import Project
from flexbt_studio.errors import StudioError

from .groot2_robot import described

PREFIX: Final = 'recording '
MOST_BYTES: Final = 8_000_000
MOST_TRANSITIONS: Final = 100_000
"""Bytes and transitions of a log of a tree, at most."""


def recordings_of(project: Project, folder: str) -> Recordings:
    """Return the recordings of a ``folder``, or else those of the folder ``recordings`` of the project, or else those
    that ``recorder`` writes. Raises StudioError."""
    own = project.root / 'recordings'
    if folder and not Path(folder).is_dir():
        raise StudioError(f'{folder} is not a folder; name the folder of the recordings')
    if not folder and own.is_dir() and own.resolve().is_relative_to(project.root):
        folder = str(own)
    return Recordings(Path(folder) if folder else home_path(USER_DIRECTORY), has_logs=True)


def opened(recordings: Recordings, robot: str) -> RecordedPast:
    """Return the recording that pages watch by this name. Raises StudioError."""
    try:
        return recordings.past(robot.removeprefix(PREFIX))
    except ConsoleError as error:
        raise StudioError(one_line(str(error), 500)) from error


def log_of(recordings: Recordings, name: str) -> tuple[str, str, dict[str, Any]]:
    """Return a log of a tree: the name and text of a file with the tree, and what a page plays. Raises StudioError."""
    try:
        file = recordings.file(name)
        if file.suffix != SUFFIX or file.stat().st_size > MOST_BYTES:
            raise StudioError(
                f'{name} is no log of a tree of at most {MOST_BYTES // 10**6} MB; "bt_tool log" prints it'
            )
        log = read_log(file)
    except (ConsoleError, LogError, OSError) as error:
        raise StudioError(one_line(str(error), 500)) from error
    if len(log.transitions) > MOST_TRANSITIONS:
        raise StudioError(f'{name} has more than {MOST_TRANSITIONS} transitions; "bt_tool log" prints it')
    tree, text, nodes, _ = described(name, log.xml)
    events = [
        {'path': nodes[one.uid], 'before': one.before.name, 'after': one.after.name, 'time': one.time}
        for one in log.transitions
        if one.uid in nodes
    ]
    shown = f'{PREFIX}{name}.xml'
    return shown, text, {'file': shown, 'tree': tree, 'nodes': len(nodes), 'events': events, 'epoch': log.epoch}

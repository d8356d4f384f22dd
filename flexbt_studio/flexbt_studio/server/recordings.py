# SPDX-License-Identifier: BSD-3-Clause
"""Recordings that pages open: of robots and incidents (MCAP), and logs of trees (``.btlog``). A recording of a robot
is decided again by files as they are edited (``flexbt_testing.one_process.recorded``)."""

from __future__ import annotations

import contextlib
import re
import shutil
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from ament_index_python.packages import PackageNotFoundError, get_package_share_path

from flexbt_common.files import USER_DIRECTORY, home_path
from flexbt_console.errors import ConsoleError
from flexbt_console.ui.web.past import RecordedPast, Recordings
from flexbt_core.values.text import one_line
from flexbt_server.groot2.log_file import SUFFIX, LogError, read_log
from flexbt_studio.documents.project import Project
from flexbt_studio.errors import StudioError
from flexbt_studio.tool_process import ToolCopy, new_folder

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


def decide_copy(project: Project, recordings: Recordings, file: str, name: str) -> ToolCopy:
    """Return the copy for a job that lets a recording be decided again by a tree or a behavior in YAML as it is edited,
    and by all other edited files that are installed. Raises StudioError.
    """
    if find_spec('flexbt_testing') is None:
        raise StudioError('what decides again is in the package flexbt_testing, which is not installed')
    try:
        recorded = recordings.file(name)
    except ConsoleError as error:
        raise StudioError(one_line(str(error), 500)) from error
    if recorded.suffix != '.mcap' or project.open(file).document.language == 'python':
        raise StudioError('only recordings of a robot (.mcap) are decided again, by trees and behaviors in YAML')
    swaps = {file: installed_name(project, file)}
    for other, opened in project.open_files.items():
        if opened.is_changed and opened.disk and opened.document.language != 'python':
            with contextlib.suppress(StudioError):  # what is not installed, the robot has not used
                swaps[other] = installed_name(project, other)
    folder = new_folder({f'edited/{one}': project.text(one) for one in swaps})
    try:
        shutil.copyfile(recorded, Path(folder.name, 'run.mcap'))
    except OSError as error:
        folder.cleanup()
        raise StudioError(f'{name}: {error}') from error
    words = [word for one, installed in swaps.items() for word in ('--swap', installed, f'edited/{one}')]
    return ToolCopy(folder, 'recorded', ['run.mcap', '--json', *words], files=list(swaps))


def installed_name(project: Project, file: str) -> str:
    """Return the name under which a file of the project is installed, ``package/relative/path``: that of the installed
    file whose path ends most like its own. Raises StudioError if there is none.
    """
    own = project.path(file)
    manifest = next((one / 'package.xml' for one in own.parents if (one / 'package.xml').is_file()), None)
    declared = re.search(r'<name>\s*(\w+)\s*</name>', manifest.read_text('utf-8', 'replace')) if manifest else None
    if declared is None:
        raise StudioError(f'{file}: is in no ROS package, so no robot has used it')
    try:
        share = get_package_share_path(declared[1])
    except PackageNotFoundError:
        raise StudioError(f'{file}: its package {declared[1]} is not installed; build and source it') from None

    def likeness(path: Path) -> int:
        pairs = zip(reversed(path.parts), reversed(own.parts), strict=False)
        return next((count for count, (one, other) in enumerate(pairs) if one != other), len(own.parts))

    found = [one for one in share.rglob(own.name) if one.is_file()]
    if not found:
        raise StudioError(
            f'{file}: {declared[1]} is installed without it; add it to the data_files of setup.py, and build'
        )
    return f'{declared[1]}/{max(found, key=likeness).relative_to(share).as_posix()}'

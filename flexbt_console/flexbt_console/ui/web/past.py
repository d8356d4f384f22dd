# SPDX-License-Identifier: BSD-3-Clause
"""The past that a page can show: that of its robot, and recordings. Moments and lanes as plain data."""

from __future__ import annotations

import contextlib
import threading
import time
from collections import OrderedDict, defaultdict
from collections.abc import Callable
from operator import itemgetter
from pathlib import Path
from typing import Any, Final, Protocol

from flexbt_common import names
from flexbt_common.errors import LimitExceededError
from flexbt_common.middleware.received_messages import Received
from flexbt_console.errors import UsageError
from flexbt_console.link.messages import record_of
from flexbt_console.mirror.history import History
from flexbt_console.mirror.lanes import Lanes
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.trees import MirroredStatus, TreeNodes
from flexbt_console.present.json_form import fields_of
from flexbt_console.recording.player import RunPlayer
from flexbt_console.recording.run_file import RECORDING, read_run
from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_msgs.msg import TreeStatus, TreeStructure

from .picture import LOG_LINES, left_out_lines, log_part, parts_of

OPEN_RECORDINGS: Final = 2
MOST_MEMORY: Final = 200_000_000
"""Recordings that are open at the same time, for all pages, and bytes of the messages of each, at most."""

MOST_NAMES: Final = 200
_RUNS: Final = ('*.mcap', f'[0-9]*/{RECORDING}', f'incidents/[0-9]*/{RECORDING}')
_LOGS: Final = ('*.btlog', '[0-9]*/records/*.btlog', 'incidents/[0-9]*/records/*.btlog')
MOST_SENT: Final = 2000
"""Entries of lanes in one answer, at most."""

PAST_PARTS: Final = frozenset(
    {
        'link',
        'status',
        'active',
        'decisions',
        'queue',
        'machine',
        'trees',
        'tree_states',
        'pose',
        'where',
        'plan',
        'scan',
        'places',
    }
)
"""Parts of a picture that a page shows of the past."""


class Past(Protocol):
    """What can be shown at each of its times, in seconds. Thread-safe; not for the thread of the loop."""

    def moment(self, time: float) -> Mirror:
        """Return the mirror as it was at a time, limited to what is known."""

    def lanes(self, revision: int) -> dict[str, Any]:
        """Return the entries of the lanes that have changed since a revision, and the extent of the time line. ``wall``
        is the time at its 0 by the clock of this computer, as in the log: s since its midnight at the epoch."""


class LivePast:
    """The past of a robot, which goes on. ``now`` returns the time of the mirror."""

    def __init__(self, history: History, lanes: Lanes, now: Callable[[], float]) -> None:
        self._history = history
        self._lanes = lanes
        self._now = now

    def moment(self, time: float) -> Mirror:
        """See :class:`Past`."""
        return self._history.moment(min(time, self._now()))

    def lanes(self, revision: int) -> dict[str, Any]:
        """See :class:`Past`."""
        now = self._now()
        return {
            **_lanes_part(self._lanes, revision),
            'begin': self._history.begin,
            'end': now,
            'wall': _of_day(time.time() - now),
            'live': True,
        }


_REACHED: Final = frozenset({MirroredStatus.RUNNING, MirroredStatus.SUCCESS, MirroredStatus.FAILURE})


class RecordedPast:
    """A recording."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._lock = threading.Lock()
        self._player = RunPlayer(file, MOST_MEMORY)

    def moment(self, time: float) -> Mirror:
        """See :class:`Past`."""
        with self._lock:
            return self._player.moment(time)

    def lanes(self, revision: int) -> dict[str, Any]:
        """See :class:`Past`."""
        with self._lock:
            lanes = self._player.lanes()
        return {
            **_lanes_part(lanes, revision),
            'begin': 0.0,
            'end': self._player.duration,
            'wall': _of_day(self._player.begin * 1e-9),
            'live': False,
        }

    def reached(self) -> dict[str, list[str]]:
        """Return the paths of the nodes that have run or ended in it, by the IDs of their trees."""
        nodes: dict[tuple[str, int], TreeNodes] = {}
        seen: defaultdict[tuple[str, int], set[int]] = defaultdict(set)
        for one in read_run(self._file):
            type = {names.TREE_STRUCTURE: TreeStructure, names.TREE_STATUS: TreeStatus}.get(one.topic)
            if type is None:
                continue
            with contextlib.suppress(ValueError, LimitExceededError):  # it is skipped by the player, too
                record = record_of(Received(one.data, len(one.data), b'', 0.0).unpack(type))
                run = record.run_id, record.structure
                if isinstance(record, TreeNodes):
                    nodes[run] = record
                else:
                    statuses = [*enumerate(record.statuses, 1), *((one.uid, one.status) for one in record.changes)]
                    seen[run].update(uid for uid, status in statuses if status in _REACHED)
        found: defaultdict[str, set[str]] = defaultdict(set)
        for run, tree in nodes.items():
            found[tree.tree].update(node.path for node in tree.nodes if node.uid in seen[run])
        return {tree: sorted(paths) for tree, paths in found.items()}


class Recordings:
    """The recordings in a folder, and those of incidents. A name leads to no file elsewhere. Thread-safe.

    With ``has_logs`` the log files of trees (``.btlog``) are among the names; they have no :meth:`past`.
    """

    def __init__(self, folder: Path, *, has_logs: bool = False) -> None:
        self._folder = folder
        self._patterns = (*_RUNS, *_LOGS) if has_logs else _RUNS
        self._lock = threading.Lock()
        self._open: OrderedDict[tuple[str, int, int], RecordedPast] = OrderedDict()

    def _files(self) -> dict[str, Path]:
        """Return the files by their names; that of an incident is its folder."""
        root, found = self._folder.resolve(), {}
        for file in (one for pattern in self._patterns for one in self._folder.glob(pattern)):
            if file.is_file() and not file.is_symlink() and file.resolve().is_relative_to(root):
                found[file.relative_to(self._folder).as_posix().removesuffix(f'/{RECORDING}')] = file
        return found

    def names(self) -> list[dict[str, Any]]:
        """Return the name, size and time of change of each recording, the newest first."""
        found = []
        for name, file in self._files().items():
            with contextlib.suppress(OSError):  # it was removed just now
                facts = file.stat()
                found.append({'name': name, 'bytes': facts.st_size, 'changed': facts.st_mtime})
        return sorted(found, key=itemgetter('changed'), reverse=True)[:MOST_NAMES]

    def file(self, name: str) -> Path:
        """Return the file of a recording. Raises UsageError."""
        known = self._files()
        if name not in known:
            raise UsageError(f'{self._folder} has no recording {short_repr(name)}{did_you_mean(name, list(known))}')
        return known[name]

    def past(self, name: str) -> RecordedPast:
        """Return a recording by its name.

        Raises:
            UsageError: there is none of this name, or it cannot be read, or is too large.
        """
        file = self.file(name)
        facts = file.stat()
        key = name, facts.st_mtime_ns, facts.st_size
        with self._lock:  # others wait until it is read, which they may want, too
            if key not in self._open:
                self._open[key] = RecordedPast(file)
            self._open.move_to_end(key)
            while len(self._open) > OPEN_RECORDINGS:
                self._open.popitem(last=False)
            return self._open[key]


class PagePast:
    """What one page can show: the past of its ``robot``, and recordings."""

    def __init__(self, robot: Past, recordings: Recordings) -> None:
        self._robot = robot
        self._recordings = recordings
        self.names = recordings.names

    def of(self, recording: str) -> Past:
        """Return a recording by its name, or for '' the past of the robot. Raises UsageError."""
        return self._recordings.past(recording) if recording else self._robot


def _of_day(stamp: float) -> float:
    return stamp + time.localtime(stamp).tm_gmtoff


def _lanes_part(lanes: Lanes, revision: int) -> dict[str, Any]:
    """Return the next entries, and whether there are ``more``."""
    found = lanes.since(revision, MOST_SENT)
    entries = [{**fields_of(one, 'revision'), 'text': '' if one.text == one.key else one.text} for one in found]
    last = found[-1].revision if found else revision
    return {'revision': last, 'entries': entries, 'more': len(found) == MOST_SENT}


def moment_part(mirror: Mirror, operator: str | None) -> dict[str, Any]:
    """Return what a page shows of a mirror of the past."""
    view = mirror.view()
    parts = {name: part for name, part in parts_of(view, operator).items() if name in PAST_PARTS}
    return {
        **parts,
        'left_out': left_out_lines(view),
        'driven': [[round(x, 2), round(y, 2)] for x, y in view.surroundings.driven],
        'log': [log_part(line) for line in mirror.log(LOG_LINES)],
    }

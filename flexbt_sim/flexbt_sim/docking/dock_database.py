# SPDX-License-Identifier: BSD-3-Clause
"""Which docks there are: the database of Nav2's docking server, or the charging stations of a world file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from flexbt_core.values import load_yaml, read_text, shown
from flexbt_sim.errors import DockError
from flexbt_sim.world import Pose

MOST_BYTES: Final = 4_000_000


@dataclass(frozen=True)
class DockType:
    """A kind of dock: at one of ``charges`` the robot waits until it is charged."""

    name: str
    charges: bool


@dataclass(frozen=True)
class Dock:
    """Where the robot is when it is docked, in ``frame``. Of a station the ``type`` is empty: it charges."""

    name: str
    pose: Pose
    frame: str = 'map'
    type: str = ''


def load_docks(file: Path) -> dict[str, Dock]:
    """The docks of a file, by their names.

    ``docks:`` has for each one ``type``, ``pose`` (x, y, yaw) and, when it is not map, ``frame``. A world file has
    ``stations:`` with ``pose``.

    Raises:
        DockError: the file cannot be read, or it has no docks.
    """
    try:
        content = load_yaml(read_text(file, MOST_BYTES), aliases=True)
    except (OSError, ValueError, RecursionError) as error:
        reason = ' '.join(str(error).split())[:200] or type(error).__name__
        raise DockError(file, '', f'cannot be read: {reason}; give a YAML file with docks') from error
    section = next((name for name in ('docks', 'stations') if isinstance(content, dict) and name in content), None)
    if section is None:
        raise DockError(file, '', 'has neither docks: nor stations:')
    entries = content[section]
    if not isinstance(entries, dict):
        raise _unfit(file, section, 'docks by their names', entries)
    return {
        str(name): _dock(file, f'{section}.{name}', str(name), entry, is_station=section == 'stations')
        for name, entry in entries.items()
    }


def _dock(file: Path, where: str, name: str, entry: object, *, is_station: bool) -> Dock:
    if not isinstance(entry, Mapping):
        raise _unfit(file, where, 'a mapping with pose', entry)
    pose = _pose(entry.get('pose'))
    if pose is None:
        raise _unfit(file, f'{where}.pose', 'x, y and yaw: m, m, rad', entry.get('pose'))
    if is_station:
        return Dock(name, pose)
    frame, kind = entry.get('frame', 'map'), entry.get('type')
    if not isinstance(kind, str) or not kind:
        raise _unfit(file, f'{where}.type', 'the name of a type of docks', kind)
    if not isinstance(frame, str) or not frame:
        raise _unfit(file, f'{where}.frame', 'the name of a frame', frame)
    return Dock(name, pose, frame, kind)


def _pose(value: Any) -> Pose | None:
    """Of three numbers; a world file may leave the heading out."""
    if not isinstance(value, list) or len(value) not in (2, 3):
        return None
    if not all(isinstance(one, int | float) and not isinstance(one, bool) and abs(one) < math.inf for one in value):
        return None
    x, y, yaw = (*value, 0.0)[:3]
    pose = Pose(float(x), float(y), float(yaw)) if max(map(abs, value)) < 1e9 else None
    return pose if pose is not None and pose.is_place else None


def _unfit(file: Path, where: str, expected: str, value: object) -> DockError:
    return DockError(file, where, f'expected {expected}, got {shown(value)}')

# SPDX-License-Identifier: BSD-3-Clause
"""Docks: from the database of Nav2's docking server, or the charging stations of a world file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from flexbt_core.values.json_data import finite_number
from flexbt_core.values.text import short_repr
from flexbt_core.values.text_files import read_text
from flexbt_core.values.yaml_data import load_yaml
from flexbt_navigation.errors import DockError
from flexbt_sim.world.descriptions.models import StationModel
from flexbt_sim.world.descriptions.world_file import WorldFile
from flexbt_sim.world.plane.geometry import Pose

MOST_BYTES: Final = 4_000_000


@dataclass(frozen=True)
class DockType:
    """A kind of dock: at one of ``charges`` the robot waits until it is charged."""

    name: str
    charges: bool


@dataclass(frozen=True)
class Dock:
    """Pose of the docked robot, in ``frame``. The ``type`` of a station is empty: it charges."""

    name: str
    pose: Pose
    frame: str = 'map'
    type: str = ''


def load_docks(file: Path) -> dict[str, Dock]:
    """Return the docks of a file, by their names.

    ``docks:`` has for each one ``type``, ``pose`` (x, y, yaw) and, when it is not map, ``frame``. A file that has
    ``stations:`` is a world file.

    Raises:
        DockError: the file cannot be read, or it has no docks.
        WorldError: it is a world file that cannot be used.
    """
    try:
        text = read_text(file, MOST_BYTES)
        content = load_yaml(text, aliases=True)
    except (OSError, ValueError) as error:
        raise DockError.unreadable(file, error, 'a YAML file with docks') from error
    sections = content if isinstance(content, dict) else {}
    if 'docks' in sections:
        docks = sections['docks']
        if not isinstance(docks, dict):
            raise _unfit(file, 'docks', 'docks by their names', docks)
        return {str(name): _dock(file, f'docks.{name}', str(name), entry) for name, entry in docks.items()}
    if 'stations' in sections:
        entities = WorldFile(file, text).entities
        return {name: Dock(name, model.pose) for _, name, model, _ in entities if isinstance(model, StationModel)}
    raise DockError(file, '', 'has neither docks: nor stations:')


def _dock(file: Path, where: str, name: str, entry: object) -> Dock:
    if not isinstance(entry, Mapping):
        raise _unfit(file, where, 'a mapping with pose', entry)
    pose = _pose(entry.get('pose'))
    if pose is None:
        raise _unfit(file, f'{where}.pose', 'x, y and yaw: m, m, rad', entry.get('pose'))
    frame, kind = entry.get('frame', 'map'), entry.get('type')
    if not isinstance(kind, str) or not kind:
        raise _unfit(file, f'{where}.type', 'the name of a type of docks', kind)
    if not isinstance(frame, str) or not frame:
        raise _unfit(file, f'{where}.frame', 'the name of a frame', frame)
    return Dock(name, pose, frame, kind)


def _pose(value: Any) -> Pose | None:
    if not isinstance(value, list) or len(value) != 3:
        return None
    pose = Pose(*(math.nan if (number := finite_number(one)) is None else number for one in value))
    return pose if pose.is_place else None


def _unfit(file: Path, where: str, expected: str, value: object) -> DockError:
    return DockError(file, where, f'expected {expected}, got {short_repr(value)}')

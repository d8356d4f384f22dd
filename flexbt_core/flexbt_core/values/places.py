# SPDX-License-Identifier: BSD-3-Clause
"""Files of named places for a robot to drive to."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from .json_data import finite_number
from .text import short_repr
from .text_files import read_text

_NO_WORD: Final = re.compile(r'[\s;]|^[-+.\d{\[]')


@dataclass(frozen=True, slots=True)
class Place:
    """A 2D pose in ``frame``, in metres and radians."""

    x: float
    y: float
    yaw: float = 0.0
    frame: str = 'map'


def load_places(file: Path) -> dict[str, Place]:
    """Read a YAML file ``{name: {x: 1.0, y: 2.0, yaw: 0.0}}``; yaw (radians) and frame are optional.

    Raises:
        ValueError: the file cannot be read, or an entry is not a place; the error names file and entry.
    """
    from .yaml_data import load_yaml  # slow to import

    try:
        content = load_yaml(read_text(file), aliases=True)
    except (OSError, ValueError) as error:
        raise ValueError(f'places file {file}: {error}') from error
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise ValueError(f'places file {file}: expected "name: {{x: 1.0, y: 2.0, yaw: 0.0}}", one a line')
    return {str(name): _place(file, str(name), entry) for name, entry in content.items()}


def _place(file: Path, name: str, entry: Any) -> Place:
    where = f'places file {file}, place {name!r}'
    if _NO_WORD.search(name) or not name:
        raise ValueError(f'{where}: a name is one word that begins with a letter')
    if not isinstance(entry, dict) or not {'x', 'y'} <= entry.keys() <= {'x', 'y', 'yaw', 'frame'}:
        raise ValueError(f'{where}: expected {{x: 1.0, y: 2.0, yaw: 0.0}} with metres and radians')
    numbers = []
    for key in ('x', 'y', 'yaw'):
        number = finite_number(entry.get(key, 0.0))
        if number is None:
            raise ValueError(f'{where}: {key} is {short_repr(entry[key])}, not a number')
        numbers.append(number)
    x, y, yaw = numbers
    place = Place(x, y, yaw)
    return replace(place, frame=str(entry['frame'])) if 'frame' in entry else place

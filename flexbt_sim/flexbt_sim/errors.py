# SPDX-License-Identifier: BSD-3-Clause
"""The errors of the simulated world and its simulator.

FlexbtError
└── SimulationError
    ├── FileError           a file that cannot be used; names file, field and remedy
    │   └── MapError        of a map
    └── WorldError          a world file that cannot be used; lists all problems with positions and remedies
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Self

from flexbt_core.errors import FlexbtError
from flexbt_core.values.text import one_line


class SimulationError(FlexbtError):
    """Base of the errors of this package."""


class FileError(SimulationError):
    """A file cannot be used. ``field`` is the wrong field, or empty for the whole file."""

    def __init__(self, file: Path, field: str, message: str) -> None:
        super().__init__(f'{file}: {field}: {message}' if field else f'{file}: {message}')
        self.file = file
        self.field = field

    @classmethod
    def unreadable(cls, file: Path, error: Exception, wanted: str) -> Self:
        """Return the error of an unreadable file, from ``error``; ``wanted`` describes the expected file."""
        reason = one_line(str(error), 200) or type(error).__name__
        return cls(file, '', f'cannot be read: {reason}; give {wanted}')


class MapError(FileError):
    """A map cannot be used."""


class MapImageError(MapError):
    """The image of a map cannot be read."""


class WorldError(SimulationError):
    """A world file cannot be used. ``problems`` has a line, FILE:LINE:COLUMN: WHERE: WHAT, for each defect."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__('\n'.join(problems))
        self.problems = tuple(problems)

# SPDX-License-Identifier: BSD-3-Clause
"""The errors of the simulator and the navigation servers.

FlexbtError
└── SimulationError
    ├── MapError            a map that cannot be used; names file, field and remedy
    └── NavigationError     a request that ends with one of Nav2's error codes
"""

from __future__ import annotations

from pathlib import Path

from flexbt_core.errors import FlexbtError


class SimulationError(FlexbtError):
    """Base of the errors of this package."""


class MapError(SimulationError):
    """A map cannot be used."""

    def __init__(self, file: Path, field: str, message: str) -> None:
        super().__init__(f'{file}: {field}: {message}' if field else f'{file}: {message}')
        self.file = file
        self.field = field


class NavigationError(SimulationError):
    """A planner, controller or behavior aborts its goal. ``code`` is the name of a constant of the action's result."""

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code

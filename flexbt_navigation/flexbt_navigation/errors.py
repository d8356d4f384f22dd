# SPDX-License-Identifier: BSD-3-Clause
"""The errors of the navigation servers.

SimulationError
├── NavigationError         a request that ends with one of Nav2's error codes
└── FileError
    ├── GraphError          a graph of routes that cannot be used
    └── DockError           a database of docks that cannot be used
"""

from __future__ import annotations

from typing import Any

from flexbt_sim.errors import FileError, SimulationError


class NavigationError(SimulationError):
    """A planner, controller or behavior aborts its goal. ``code`` is the name of a constant of the action's result, of
    which ``fields`` may have more."""

    def __init__(self, code: str, message: str, **fields: Any) -> None:
        super().__init__(message)
        self.code = code
        self.fields = fields


class GoalCanceled(Exception):
    """The client has canceled an active goal."""


class GraphError(FileError):
    """A graph of routes cannot be used."""


class DockError(FileError):
    """A database of docks cannot be used."""

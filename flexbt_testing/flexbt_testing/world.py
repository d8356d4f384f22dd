# SPDX-License-Identifier: BSD-3-Clause
"""Tests of missions with the fixture ``world``: a pytest plugin (``-p flexbt_testing.world``), and the class World.

The tutorial "Test your mission" shows how to use it.
"""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING, Any

from .one_process import install

if TYPE_CHECKING:
    from .one_process.programs import Program as Program
    from .one_process.world import World as World

if 'pytest' in sys.modules:  # in tests a field of a wrong type is an error, as where it is sent
    os.environ.setdefault('ROS_PYTHON_CHECK_FIELDS', '1')
install()
pytest_plugins = ['flexbt_testing.one_process.plugin']


def __getattr__(name: str) -> Any:
    """Import the classes when they are used: pytest loads the plugin before it can watch imports."""
    from .one_process import programs, world

    if name in ('World', 'Mission'):
        return getattr(world, name)
    if name == 'Program':
        return programs.Program
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')

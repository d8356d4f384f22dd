# SPDX-License-Identifier: BSD-3-Clause
"""The mirror knows neither ROS nor a user interface, and help needs neither."""

from __future__ import annotations

import pkgutil
import subprocess
import sys
from types import ModuleType

import pytest

import flexbt_console.commands
import flexbt_console.mirror
import flexbt_console.present

LISTING = 'import sys; print(" ".join(sorted(name.partition(".")[0] for name in sys.modules)))'


PICTURES = {f'flexbt_console.present.{name}' for name in ('cells', 'lane_lines', 'maps', 'tree_lines')}
"""Modules that a command imports only to draw: they need rich."""


def import_all(*folders: ModuleType) -> str:
    """Return the statement that imports every module of the folders."""
    found = {one.name for folder in folders for one in pkgutil.iter_modules(folder.__path__, f'{folder.__name__}.')}
    return f'import {", ".join(sorted(found - PICTURES))}'


def modules_after(statement: str) -> set[str]:
    """Top-level packages that are loaded after a statement in a fresh interpreter."""
    command = [sys.executable, '-c', f'{statement}\n{LISTING}']
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.parametrize(
    'statement',
    [
        import_all(flexbt_console.mirror),
        import_all(flexbt_console.commands, flexbt_console.present),
        'import flexbt_console.ui.station',
        'from flexbt_console.ui.console import main; main(["--help"])',
        'from flexbt_console.ui.console import main; main(["start"])',
    ],
)
def test_is_free_of_ros_and_of_a_user_interface(statement: str) -> None:
    loaded = modules_after(statement)
    assert 'flexbt_console' in loaded
    assert not loaded & {'rclpy', 'flexbt_msgs', 'prompt_toolkit', 'textual', 'rich', 'numpy', 'yaml'}


def test_line_mode_waits_for_no_library_of_a_user_interface() -> None:
    loaded = modules_after('import flexbt_console.ui.line.line_mode')
    assert 'rclpy' in loaded and not loaded & {'asyncio', 'prompt_toolkit', 'textual'}

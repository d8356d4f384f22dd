# SPDX-License-Identifier: BSD-3-Clause
"""The mirror knows neither ROS nor a user interface, and help needs neither."""

from __future__ import annotations

import subprocess
import sys

import pytest

LISTING = 'import sys; print(" ".join(sorted(name.partition(".")[0] for name in sys.modules)))'


def modules_after(statement: str) -> set[str]:
    """Top-level packages that are loaded after a statement in a fresh interpreter."""
    command = [sys.executable, '-c', f'{statement}\n{LISTING}']
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.parametrize(
    'statement',
    [
        'import flexbt_console.mirror',
        'import flexbt_console.commands, flexbt_console.present',
        'from flexbt_console.ui.console import main; main(["--help"])',
        'from flexbt_console.ui.console import main; main(["start"])',
    ],
)
def test_is_free_of_ros_and_of_a_user_interface(statement: str) -> None:
    loaded = modules_after(statement)
    assert 'flexbt_console' in loaded
    assert not loaded & {'rclpy', 'flexbt_msgs', 'prompt_toolkit', 'textual', 'rich', 'numpy', 'yaml'}

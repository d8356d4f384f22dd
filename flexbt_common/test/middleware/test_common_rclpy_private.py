# SPDX-License-Identifier: BSD-3-Clause
"""Private parts of rclpy: where one is missing, or is another one, nodes work all the same, and say what is lost.

Each case is a process that imports rclpy with names changed in all of its source: rclpy itself is as good as before.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from flexbt_common.middleware.rclpy_private import EXECUTOR, PARAMETERS, SWITCH, PrivatePart, PrivateUse, is_usable

pytestmark = pytest.mark.dds("it is about rclpy's compiled module")

CASE = Path(__file__).with_name('changed_rclpy.py')
USES = {'EXECUTOR': EXECUTOR, 'PARAMETERS': PARAMETERS}
PARTS = {name: tuple(part for part in use.parts if part.name.startswith('_')) for name, use in USES.items()}
"""Those of Python; the others are members of compiled classes."""


def run(pattern: str, replacement: str, stock: str = '0') -> list[str]:
    """Return the uses that are left in a process whose rclpy is changed, and then the warnings of its nodes, each once.

    There a node with all that is made of private parts serves goals, a cancel, services and a transition.
    """
    done = subprocess.run(
        [sys.executable, str(CASE), pattern, replacement],
        env=os.environ | {SWITCH: stock},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert 'Traceback' not in done.stderr
    warnings = re.findall(r'this version of rclpy is not fully known: .*', done.stderr)
    return [*done.stdout.split(), *dict.fromkeys(warnings)]


def test_this_rclpy_has_all_parts() -> None:
    assert [part.fault() for use in USES.values() for part in use.parts if part.fault()] == []
    assert run('no such name', '') == list(USES)


@pytest.mark.parametrize('use', USES)
def test_without_its_parts_a_use_is_left_out_and_everything_works(use: str) -> None:
    missing = [part.name for part in PARTS[use]]
    *usable, warning = run(rf'\b({"|".join(missing)})\b', r'_renamed\1')
    assert usable == [other for other in USES if other != use]
    assert [name for name in missing if f'.{name} is missing' not in warning] == []
    assert USES[use].loss in warning


def test_with_another_signature_a_part_is_not_used() -> None:
    *usable, warning = run(r'def _take_timer\(self, tmr(: Timer)?\)', 'def _take_timer(self, tmr, more=None)')
    assert usable == ['PARAMETERS']
    assert re.search(r'_take_timer\(self, tmr, more=None\).* has another signature', warning)


def test_the_environment_leaves_out_all_uses_without_a_warning() -> None:
    assert run('no such name', '', stock='1') == []


def test_a_compiled_member_that_is_missing_is_named() -> None:
    assert PrivatePart(EXECUTOR.parts[-1].owner, 'add_events').fault().endswith('.WaitSet.add_events is missing')
    assert not is_usable(PrivateUse((PrivatePart(object, 'add_events'),), 'nothing'))

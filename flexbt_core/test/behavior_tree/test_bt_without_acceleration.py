# SPDX-License-Identifier: BSD-3-Clause
"""The engine without its acceleration: a part of these tests again, with FLEXBT_ACCELERATION=0."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

TESTS: Final = (
    'tree',
    'conditions',
    'failure_trace',
    'decision_controls',
    'function_nodes',
    'loops',
    'coroutine_action',
)
DEADLINE: Final = 300.0


@pytest.mark.skipif(os.environ.get('FLEXBT_ACCELERATION') == '0', reason='all tests run without it')
def test_the_plain_engine_passes_the_tests() -> None:
    here = Path(__file__).parent
    files = [here / f'test_bt_{name}.py' for name in TESTS]
    command = [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', '-p', 'no:xdist', *map(str, files)]
    environment = {name: value for name, value in os.environ.items() if not name.startswith('PYTEST_')}
    done = subprocess.run(
        command,
        env={**environment, 'FLEXBT_ACCELERATION': '0'},
        cwd=here.parents[1],
        capture_output=True,
        text=True,
        timeout=DEADLINE,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]

# SPDX-License-Identifier: BSD-3-Clause
"""The executables simulator and navigation as processes: what they refuse to start with, and how they end."""

from __future__ import annotations

import signal
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix

from flexbt_navigation import executables as navigation_executables
from flexbt_sim import executables
from flexbt_testing.system.python_processes import PythonProcess, python_process
from flexbt_testing.waiting import DEADLINE, contended_time, uncontended_time

pytestmark = pytest.mark.dds('the executables run as processes')

PACKAGES = {'simulator': 'flexbt_sim', 'navigation': 'flexbt_navigation', 'simulation': 'flexbt_navigation'}


def start(executable: str, *settings: str) -> subprocess.Popen[str]:
    """Start an installed executable with parameters ``name:=value``."""
    package = PACKAGES[executable]
    path = Path(get_package_prefix(package)) / 'lib' / package / executable
    words = [str(path), '--ros-args', *(word for setting in settings for word in ('-p', setting))]
    return subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_what_cannot_work_is_refused_in_one_line() -> None:
    for executable, setting in (('simulator', 'map:=/nowhere/flat.yaml'), ('navigation', 'robot_radius:=-0.2')):
        process = start(executable, setting)
        out, err = process.communicate(timeout=DEADLINE)
        assert (process.returncode, out) == (1, ''), err
        assert err.startswith(f'{executable}: cannot start: ') and err.count('\n') == 1, err


PREPARED = (
    'flexbt_navigation.simulation',
    'flexbt_sim.world.world.prepare_world',
    'flexbt_navigation.preparation.prepare_navigation',
)

PROGRAM = """
import sys
from {package}.executables import {name}

sys.exit({name}())
"""


def fork(executable: str, setting: str) -> PythonProcess:
    """Return an executable with a parameter, where its beginning is not the subject."""
    return python_process(
        ['-c', PROGRAM.format(package=PACKAGES[executable], name=executable), '--ros-args', '-p', setting], PREPARED
    )


@pytest.mark.parametrize('name', ['simulator', 'navigation', 'simulation'])
def test_a_thread_that_computes_lets_others_go_on_after_a_millisecond(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    found, before = [], sys.getswitchinterval()
    monkeypatch.setattr(executables, 'run_main', lambda _module, **_options: found.append(sys.getswitchinterval()))
    try:
        getattr(navigation_executables if name in vars(navigation_executables) else executables, name)()
    finally:
        sys.setswitchinterval(before)
    assert found == pytest.approx([0.001])


BROKEN = """
import sys
from flexbt_sim import world
from flexbt_sim.simulator.node import main

def step(*_):
    raise ZeroDivisionError('a wheel came off')

world.World.step = step
sys.exit(main([]))
"""


def test_a_simulator_whose_world_raises_ends_and_says_why() -> None:
    with python_process(['-c', BROKEN], PREPARED) as process:
        _, err = process.communicate(timeout=DEADLINE)
    assert process.returncode == 1
    assert 'simulator: cannot continue' in err and 'a wheel came off' in err


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_everything_in_time(number: signal.Signals) -> None:
    running: list[PythonProcess] = []
    with ExitStack() as stack:
        for executable, setting in (
            ('navigation', 'use_sim_time:=true'),
            ('simulator', 'speed_factor:=1.0'),
            ('simulator', 'speed_factor:=0.0001'),
            ('simulation', 'speed_factor:=0.0'),  # which takes all of a processor
        ):
            running.append(fork(executable, setting))
            stack.enter_context(running[-1])
            assert running[-1].stderr is not None
            assert running[-1].stderr.readline()  # it has said that it runs
        for process in reversed(running):
            began, waited = uncontended_time(), contended_time()
            process.send_signal(number)
            _, err = process.communicate(timeout=DEADLINE)
            assert uncontended_time() - began < 2.0
            # It leaves without an end in time: where that is for want of a processor it is right to.
            is_late = 'did not come to an end' in err and contended_time() - waited > 1.0
            assert process.returncode == is_late, (process.returncode, err)
            assert 'Traceback' not in err and 'ERROR' not in err, err

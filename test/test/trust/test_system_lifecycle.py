# SPDX-License-Identifier: BSD-3-Clause
"""Processes of managed nodes, brought up and down as Nav2's lifecycle manager does it."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from flexbt_common.middleware.implementation import implementation
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_testing.nodes.clients import LifecycleClient
from flexbt_testing.system.probe import Probe
from flexbt_testing.system.processes import Stack
from flexbt_testing.system.python_processes import console_answer, run_console
from flexbt_testing.waiting import uncontended_time

MANAGED = ('bt_server', 'onboard_executive')
"""In the order in which they are brought up."""


@pytest.fixture
def stack(tmp_path: Path) -> Iterator[Stack]:
    with Stack(tmp_path) as stack:
        yield stack


@pytest.fixture
def runtime() -> Iterator[NodeRuntime]:
    with NodeRuntime.open('manager') as runtime:
        yield runtime


def shown() -> str:
    """Return the behavior line of the console."""
    done = run_console('status', '--timeout', '50')
    assert done.returncode == 0, done
    return next(line for line in done.stdout.splitlines() if line.startswith('behavior'))


def comes_to_rest(probe: Probe, answered: float) -> None:
    """Check that the robot stands when the manager has its answer, as far as poses are not under way."""
    probe.wait_at_rest(quiet=1.0)
    assert probe.moved_at < answered + 0.3


def test_a_manager_brings_the_robot_up_and_down(stack: Stack, runtime: NodeRuntime) -> None:
    stack.start('simulation', {'speed_factor': '3.0'})
    stack.start('stop_guard')
    for name in MANAGED:
        stack.start(name, {'autostart': 'false'})
    managers = [LifecycleClient(runtime, name) for name in MANAGED]
    probe = Probe(runtime)
    for place in ((10.0, 2.3), (3.8, 1.2)):
        assert [manager.state() for manager in managers] == ['unconfigured'] * 2
        assert 'the executive is unconfigured; configure and activate it' in shown()
        for label in ('configure', 'activate'):
            assert all(manager.change(label) for manager in managers)
        probe.wait(lambda: not probe.status.message, 'active executive')
        probe.wait_ready()
        probe.drive_to(*place)
        for manager in reversed(managers):
            assert manager.change('deactivate')
        comes_to_rest(probe, uncontended_time())
        probe.wait(lambda: probe.status.outcome == 'preempted', 'end of the run')
        assert 'the executive is inactive; activate it' in shown()
        for manager in reversed(managers):
            assert manager.change('cleanup')
    for manager in reversed(managers):
        assert manager.change('shutdown')
        assert manager.state() == 'finalized'
    for name in MANAGED:
        ending = stack.end(name, signal.SIGTERM, 60.0)
        assert ending.exit_code == 0, ending
        assert 'Traceback' not in ending.output


@pytest.mark.parametrize('labels', [(), ('configure',), ('configure', 'cleanup'), ('shutdown',)], ids='-'.join)
@pytest.mark.parametrize('name', MANAGED)
def test_a_signal_ends_a_process_that_is_not_active(
    stack: Stack, runtime: NodeRuntime, name: str, labels: tuple[str, ...]
) -> None:
    stack.start(name, {'autostart': 'false', 'use_sim_time': 'false'})
    manager = LifecycleClient(runtime, name)
    for label in labels:
        assert manager.change(label)
    assert manager.state() in ('unconfigured', 'inactive', 'finalized')
    ending = stack.end(name, signal.SIGINT, 60.0)
    assert (ending.exit_code, ending.seconds < 2.5) == (0, True), ending
    assert 'Traceback' not in ending.output and 'leaving without' not in ending.output


def test_a_parameter_that_cannot_work_ends_a_node_that_starts_by_itself_only(
    stack: Stack, runtime: NodeRuntime
) -> None:
    wrong = {'nav2_branch': 'humble', 'use_sim_time': 'false'}
    for name, parameters, why in (
        ('bt_server', wrong, "parameter 'nav2_branch': there is no 'humble'; known: jazzy, main"),
        ('onboard_executive', {'autonomy': '7', 'use_sim_time': 'false'}, "parameter 'autonomy': 7 is out of range"),
    ):
        stack.start(name, parameters)
        ending = stack.end(name, signal.SIGCONT, 60.0)
        assert ending.exit_code == 1
        # No advice to configure it; the middleware may have a line of its own.
        (line,) = (line for line in ending.output.splitlines() if implementation() not in line)
        assert line.startswith(f'{name}: cannot start: {why}')
    stack.start('bt_server', {'autostart': 'false', **wrong})
    manager = LifecycleClient(runtime, 'bt_server')
    for _ in range(2):
        assert not manager.change('configure')
        assert manager.state() == 'unconfigured'
    ending = stack.end('bt_server', signal.SIGINT, 60.0)
    assert ending.exit_code == 0
    assert 'unconfigured because of an error: parameter ' in ending.output


def test_commands_to_an_executive_that_is_not_configured_are_refused(stack: Stack) -> None:
    stack.start('onboard_executive', {'autostart': 'false', 'use_sim_time': 'false'})
    assert 'unconfigured' in str(console_answer('start', 'Navigate', exit_code=3))

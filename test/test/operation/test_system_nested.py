# SPDX-License-Identifier: BSD-3-Clause
"""Three levels in processes of their own: a behavior runs a tree, which runs a behavior of another executive."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import pytest

from flexbt_common.runtime import NodeRuntime
from flexbt_msgs.msg import ExecutiveStatus
from flexbt_testing.system.console_process import console_answer
from flexbt_testing.system.probe import Probe
from flexbt_testing.system.processes import Stack

INNER = 'inspector/onboard_executive'
DEADLINE = 60.0


@pytest.fixture(scope='module')
def stack(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stack]:
    with Stack(tmp_path_factory.mktemp('robot')) as stack:
        for name in ('bt_server', 'onboard_executive', INNER):
            stack.start(name, {'use_sim_time': 'false'})
        wait_for_server()
        yield stack


def console(*words: str, namespace: str = '') -> Any:
    """What a command of the console answers."""
    return console_answer(*words, '--operator', 'ann', *(['--namespace', namespace] if namespace else []))


def wait_for_server() -> None:
    """Wait until the executive of the mission sees the BT server ready."""
    end = time.monotonic() + DEADLINE
    while not any(peer['ready'] for peer in console('status')['peers'] if 'bt_server' in peer['name']):
        assert time.monotonic() < end, 'the BT server is not ready'


def wait(namespace: str, state: str) -> Any:
    """Wait for a state of an executive."""
    end = time.monotonic() + DEADLINE
    while (status := console('status', namespace=namespace))['state'] != state:
        assert time.monotonic() < end, status
    return status


def test_values_go_down_and_come_back_and_stop_goes_down(stack: Stack) -> None:
    ended = console('start', 'Inspection', 'site=tower', 'duration=0.1', '--autonomy', 'high', '--wait')
    assert ended['outcome'] == 'finished'
    lines = [line['text'] for line in console('log')]
    assert 'the inspector reports: all is well at the tower' in lines
    inner = wait('inspector', 'idle')
    assert (inner['behavior'], inner['outcome']) == ('Inspect Site', 'finished')
    console('start', 'Inspection', 'duration=1000', '--autonomy', 'high')
    inner = wait('inspector', 'running')
    assert [state['path'] for state in inner['active_states']] == ['/Look']
    # The operator of the inspector sees it, and the one of the mission sees the leaf.
    (outer,) = console('status')['active_states']
    assert outer['path'] == '/Inspect'
    assert 'InspectSite' in ' '.join(outer['activity'])
    console('stop', '--wait')
    assert wait('inspector', 'idle')['outcome'] == 'preempted'


def test_the_death_of_the_tree_in_the_middle_stops_what_is_below(stack: Stack) -> None:
    with NodeRuntime.open('probe', namespace='inspector') as runtime:
        probe = Probe(runtime)
        console('start', 'Inspection', 'duration=1000', '--autonomy', 'high')
        probe.wait_state(ExecutiveStatus.RUNNING)
        stack.kill('bt_server')
        probe.wait_state(ExecutiveStatus.IDLE)
        assert probe.status.outcome == 'preempted'

# SPDX-License-Identifier: BSD-3-Clause
"""Three levels in processes of their own: a behavior runs a tree, which runs a behavior of another executive."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from flexbt_common.runtime import NodeRuntime
from flexbt_msgs.msg import ExecutiveStatus
from flexbt_testing.system.console_process import console_answer
from flexbt_testing.system.probe import Probe
from flexbt_testing.system.processes import Stack
from flexbt_testing.waiting import wait_until

INNER = 'inspector/onboard_executive'


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
    wait_until(
        lambda: any(peer['ready'] for peer in console('status')['peers'] if 'bt_server' in peer['name']), 'BT server'
    )


def wait(namespace: str, seen: Callable[[Any], object]) -> Any:
    """The status of an executive that is as it has to be."""
    status: Any = None

    def is_seen() -> object:
        nonlocal status
        status = console('status', namespace=namespace)
        return seen(status)

    wait_until(is_seen, lambda: status)
    return status


def is_idle(status: Any) -> bool:
    """Whether no behavior runs."""
    return bool(status['state'] == 'idle')


def test_values_go_down_and_come_back_and_stop_goes_down(stack: Stack) -> None:
    ended = console('start', 'Inspection', 'site=tower', 'duration=0.1', '--autonomy', 'high', '--wait')
    assert ended['outcome'] == 'finished'
    lines = [line['text'] for line in console('log')]
    assert 'the inspector reports: all is well at the tower' in lines
    inner = wait('inspector', is_idle)
    assert (inner['behavior'], inner['outcome']) == ('Inspect Site', 'finished')
    console('start', 'Inspection', 'duration=1000', '--autonomy', 'high')
    # The operator of the inspector sees it, and the one of the mission sees the leaf.
    wait('inspector', lambda status: [state['path'] for state in status['active_states']] == ['/Look'])
    wait('', lambda status: 'InspectSite' in str([state['activity'] for state in status['active_states']]))
    console('stop', '--wait')
    assert wait('inspector', is_idle)['outcome'] == 'preempted'


def test_the_death_of_the_tree_in_the_middle_stops_what_is_below(stack: Stack) -> None:
    with NodeRuntime.open('probe', namespace='inspector') as runtime:
        probe = Probe(runtime)
        console('start', 'Inspection', 'duration=1000', '--autonomy', 'high')
        probe.wait_state(ExecutiveStatus.RUNNING)
        stack.kill('bt_server')
        probe.wait_state(ExecutiveStatus.IDLE)
        assert probe.status.outcome == 'preempted'

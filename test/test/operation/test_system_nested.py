# SPDX-License-Identifier: BSD-3-Clause
"""Three levels in processes of their own: a behavior runs a tree, which runs a behavior of another executive."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_msgs.msg import ExecutiveStatus
from flexbt_testing.nodes.operator import Operator
from flexbt_testing.system.processes import Stack
from flexbt_testing.system.python_processes import console_answer

INNER = 'inspector/onboard_executive'


@pytest.fixture(scope='module')
def stack(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stack]:
    with Stack(tmp_path_factory.mktemp('robot')) as stack:
        for name in ('bt_server', 'onboard_executive', INNER):
            stack.start(name, {'use_sim_time': 'false'})
        yield stack


@pytest.fixture(scope='module')
def mission(stack: Stack) -> Iterator[Operator]:
    """Hear the executive of the mission, which sees the BT server ready."""
    with NodeRuntime.open('mission') as runtime:
        operator = Operator(runtime)
        operator.wait_for(
            lambda status: any(peer.ready for peer in status.peers if 'bt_server' in peer.name), 'BT server'
        )
        yield operator


@pytest.fixture(scope='module')
def inspector(stack: Stack) -> Iterator[Operator]:
    """Hear the executive of the inspector."""
    with NodeRuntime.open('inspection', namespace='inspector') as runtime:
        yield Operator(runtime)


def console(*words: str, namespace: str = '') -> Any:
    """Return what a command of the console answers."""
    return console_answer(*words, '--operator', 'ann', *(['--namespace', namespace] if namespace else []))


def test_values_go_down_and_come_back_and_stop_goes_down(mission: Operator, inspector: Operator) -> None:
    ended = console('start', 'Inspection', 'site=tower', 'duration=0.1', '--autonomy', 'high', '--wait')
    assert ended['outcome'] == 'finished'
    lines = [line['text'] for line in console('log')]
    assert 'the inspector reports: all is well at the tower' in lines
    inspector.wait_idle()
    inner = console('status', namespace='inspector')
    assert (inner['behavior'], inner['outcome']) == ('Inspect Site', 'finished')
    console('start', 'Inspection', 'duration=1000', '--autonomy', 'high')
    # The operator of the inspector sees it, and the one of the mission sees the leaf.
    inspector.wait_active('/Look')
    assert [state['path'] for state in console('status', namespace='inspector')['active_states']] == ['/Look']
    mission.wait_for(lambda status: any('InspectSite' in str(one.activity) for one in status.active_states), 'the leaf')
    assert 'InspectSite' in str([state['activity'] for state in console('status')['active_states']])
    console('stop', '--wait')
    inspector.wait_for(lambda status: status.state == ExecutiveStatus.IDLE, 'the end of the inspection')
    assert console('status', namespace='inspector')['outcome'] == 'preempted'


def test_the_death_of_the_tree_in_the_middle_stops_what_is_below(
    stack: Stack, mission: Operator, inspector: Operator
) -> None:
    console('start', 'Inspection', 'duration=1000', '--autonomy', 'high')
    inspector.wait_for(lambda status: status.state == ExecutiveStatus.RUNNING, 'the inspection')
    stack.kill('bt_server')
    inspector.wait_for(lambda status: status.state == ExecutiveStatus.IDLE, 'the end of the inspection')
    assert inspector.status.outcome == 'preempted'

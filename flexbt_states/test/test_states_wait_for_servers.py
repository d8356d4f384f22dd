# SPDX-License-Identifier: BSD-3-Clause
"""A state that waits for servers goes on when they are ready, whenever they come."""

from __future__ import annotations

from typing import Any

import pytest
from nav2_msgs.action import Wait

from flexbt_common.lifecycle.liveliness import LivelinessToken
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_states import WaitForServersState
from flexbt_states.errors import StateParameterError
from flexbt_testing.nodes.scripted_action_server import ScriptedActionServer
from flexbt_testing.nodes.state_bench import Run, StateBench
from flexbt_testing.waiting import wait_until


def activity(run: Run) -> tuple[str, ...]:
    return next((leaf.activity for leaf in run.active()), ())


def test_it_goes_on_when_a_node_is_ready_again(bench: StateBench) -> None:
    def make() -> Any:
        return WaitForServersState(nodes=['some_server'])

    run = bench.run_state(make)
    shown = ('waits for some_server (not seen yet)',)
    wait_until(lambda: activity(run) == shown, lambda: activity(run))
    with NodeRuntime.open('some_server') as server:
        token = LivelinessToken(server)
        starting = ('waits for some_server (it is starting, or inactive)',)
        wait_until(lambda: activity(run) == starting, lambda: activity(run))
        token.set_ready(True)
        assert run.wait() == 'ready'
        assert bench.run_state(make).wait() == 'ready'
    run = bench.run_state(make)
    wait_until(lambda: activity(run) == ('waits for some_server (gone)',), lambda: activity(run))
    with NodeRuntime.open('some_server') as server:
        LivelinessToken(server).set_ready(True)
        assert run.wait() == 'ready'


def test_it_waits_for_action_servers_that_say_nothing_of_themselves(bench: StateBench) -> None:
    run = bench.run_state(lambda: WaitForServersState([], {'drill': 'nav2_msgs/action/Wait'}))
    wait_until(lambda: activity(run) == ('waits for drill',), lambda: activity(run))
    with NodeRuntime.open('driller') as server:
        ScriptedActionServer(server, Wait, 'drill')
        assert run.wait() == 'ready'


def test_it_is_left_by_timeout_and_says_what_is_missing(bench: StateBench) -> None:
    run = bench.run_state(lambda: WaitForServersState(['a', 'b'], timeout=0.3))
    assert run.wait() == 'timeout'
    assert 'not ready within 0.3 s: a (not seen yet), b (not seen yet)' in run.errors()


@pytest.mark.parametrize(
    'parameters',
    [
        {'nodes': 'bt_server'},
        {'nodes': []},
        {'nodes': ['a b']},
        {'actions': {'drill': 'nav2_msgs/action/Nothing'}},
        {'actions': {'drill': 'nonsense'}},
        {'actions': {'drill': ''}},
        {'actions': {'drill': '/action/Spin'}},
        {'timeout': -1.0},
    ],
)
def test_what_cannot_work_is_refused_when_the_state_is_made(parameters: Any) -> None:
    with pytest.raises(StateParameterError):
        WaitForServersState(**parameters)

# SPDX-License-Identifier: BSD-3-Clause
"""The leaf that runs a behavior of an executive, on a live server."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.entries import from_entry, to_entry
from flexbt_msgs.action import BtExecute, ExecuteBehavior
from flexbt_testing.nodes.scripted_action_server import ScriptedActionServer
from flexbt_testing.nodes.server_world import ServerWorld, open_server_world
from flexbt_testing.waiting import DEADLINE, wait_until

Result = BtExecute.Result
RESULT = ExecuteBehavior.Result
LEAF = '<ExecuteBehavior behavior="Inspect" {ports} outcome="{{outcome}}" error_msg="{{why}}"/>'


class Executive:
    """An executive as far as the leaf sees it: it ends each goal as it is told."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self.answer: tuple[str, Any] | None = ('succeed', RESULT(code=RESULT.SUCCESS, outcome='finished'))
        self.action = ScriptedActionServer(
            runtime, ExecuteBehavior, 'execute_behavior', answer=lambda _number, _goal: self.answer
        )


@pytest.fixture
def world() -> Iterator[ServerWorld]:
    with open_server_world(tick_rate=50.0) as opened:
        yield opened


@pytest.fixture
def executive() -> Iterator[Executive]:
    with NodeRuntime.open('other_executive') as runtime:
        yield Executive(runtime)


def run(world: ServerWorld, ports: str = '', **inputs: Any) -> Any:
    """Run a tree of the leaf to its end."""
    world.client.load_tree(LEAF.format(ports=ports))
    return world.client.execute(inputs=inputs, outputs=['outcome', 'why', 'report']).result


def outputs(result: Any) -> dict[str, Any]:
    return {entry.key: from_entry(entry) for entry in result.outputs}


def test_entries_go_in_and_outputs_come_back(world: ServerWorld, executive: Executive) -> None:
    executive.answer = (
        'succeed',
        RESULT(code=RESULT.SUCCESS, outcome='done', outputs=[to_entry('report', 'well'), to_entry('more', 1)]),
    )
    ports = 'inputs="site; count" outputs="report" arguments="duration=2; mode = fast" autonomy="1"'
    result = run(world, ports, site='gate', count=3)
    assert (result.code, outputs(result)) == (Result.SUCCESS, {'outcome': 'done', 'why': '', 'report': 'well'})
    (goal,) = executive.action.goals
    assert {entry.key: from_entry(entry) for entry in goal.inputs} == {'site': 'gate', 'count': 3}
    assert [(one.name, one.value) for one in goal.arguments] == [('duration', '2'), ('mode', 'fast')]
    assert (goal.behavior, goal.autonomy) == ('Inspect', 1)
    executive.answer = ('succeed', RESULT(code=RESULT.SUCCESS, outcome='empty'))
    assert run(world, 'success_outcomes="empty"').code == Result.SUCCESS


@pytest.mark.parametrize(
    ('ports', 'how', 'answer', 'words'),
    [
        ('', 'succeed', RESULT(code=RESULT.SUCCESS, outcome='failed'), "ended with 'failed'"),
        ('outputs="report"', 'succeed', RESULT(code=RESULT.SUCCESS, outcome='done'), "no output 'report'"),
        ('', 'abort', RESULT(code=RESULT.FAILURE, message='it runs already'), 'it runs already'),
        ('inputs="nowhere"', 'succeed', RESULT(), "no value for 'nowhere'"),
        ('arguments="fast"', 'succeed', RESULT(), 'is not name=value'),
        ('autonomy="4"', 'succeed', RESULT(), 'autonomy 4'),
    ],
)
def test_everything_else_is_a_failure_with_its_reason(
    world: ServerWorld, executive: Executive, ports: str, how: str, answer: Any, words: str
) -> None:
    executive.answer = (how, answer)
    result = run(world, ports)
    assert result.code == Result.FAILURE
    assert words in result.message
    assert words in outputs(result)['why']


def test_halting_stops_the_behavior(world: ServerWorld, executive: Executive) -> None:
    executive.answer = None
    world.client.load_tree(LEAF.format(ports=''))
    goal = world.client.execute()
    wait_until(lambda: executive.action.running == [0], 'behavior begun')
    goal.call.cancel(DEADLINE)
    assert goal.result.code == Result.CANCELED
    assert executive.action.statuses == {0: 'canceled'}

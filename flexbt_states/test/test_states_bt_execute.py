# SPDX-License-Identifier: BSD-3-Clause
"""The states that run behavior trees, against servers that do what servers do at their worst."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.action import CancelResponse

from flexbt_common.calls.action_call import ActionCall, GoalStatus
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.entries import from_entry, to_entry
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.definition import Child
from flexbt_msgs.action import BtExecute
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest
from flexbt_onboard.behaviors.behavior_library import BehaviorEntry, BehaviorLibrary
from flexbt_onboard.behaviors.run_building import RunRequest
from flexbt_onboard.node.executive import open_executive
from flexbt_onboard.node.executive_parameters import ExecutiveParameters
from flexbt_states import BtExecuteGoalState, BtExecuteState
from flexbt_states.errors import StateParameterError
from flexbt_testing.nodes.scripted_action_server import ScriptedActionServer, ends
from flexbt_testing.nodes.state_bench import StateBench
from flexbt_testing.waiting import DEADLINE, wait_until

RESULT = BtExecute.Result


def pose(x: float, y: float = 0.0) -> PoseStamped:
    message = PoseStamped()
    message.header.frame_id = 'map'
    message.pose.position.x, message.pose.position.y = x, y
    return message


def execute(**options: Any) -> BtExecuteState:
    return BtExecuteState(bt_file='navigate', **options)


def test_a_tree_that_succeeds_gives_done_and_its_outputs(bench: StateBench) -> None:
    path = Path(poses=[pose(1.0), pose(2.0)])
    server = bench.serve(
        BtExecute,
        'bt_executor',
        ends(RESULT(code=RESULT.SUCCESS, outputs=[to_entry('path', path), to_entry('tries', 3)])),
    )
    read: dict[str, Any] = {}
    run = bench.run_state(
        lambda: execute(
            inputs={'speed': 'float64'}, outputs={'path': 'nav_msgs/Path', 'tries': 'int32'}, blackboard='b'
        ),
        {'speed': 0.25, 'path': None, 'tries': None},
        outputs=['path', 'tries'],
        read=read,
    )
    assert run.wait() == 'done', run.lines
    assert read == {'path': path, 'tries': 3}
    (goal,) = server.goals
    assert (goal.behavior_tree, goal.blackboard, goal.owner) == ('navigate', 'b', '/bench_executive')
    assert [(entry.key, from_entry(entry)) for entry in goal.inputs] == [('speed', 0.25)]
    assert (list(goal.outputs), goal.output_encoding) == (['path', 'tries'], BtExecute.Goal.BINARY)


@pytest.mark.parametrize(
    ('result', 'how', 'outcome', 'words'),
    [
        (RESULT(), 'succeed', 'failed', 'without filling in the result'),
        (RESULT(), 'abort', 'failed', 'navigate'),
        (RESULT(code=RESULT.SUCCESS), 'abort', 'failed', 'although its result says success'),
        (RESULT(code=RESULT.FAILURE, message='no', failed_node='R/Plan'), 'abort', 'failed', 'no (node R/Plan)'),
        (
            RESULT(code=RESULT.FAILURE, message='a: no', failed_node='a', reasons=['a: no', 's: x', 'r: y']),
            'abort',
            'failed',
            'a: no (node a); so s: x; so r: y',
        ),
        (RESULT(code=RESULT.FAILURE, message='no way'), 'succeed', 'failed', 'no way'),
        (RESULT(code=RESULT.ERROR, message='node raised'), 'abort', 'failed', 'node raised'),
        (RESULT(code=RESULT.ERROR, message='node raised'), 'succeed', 'failed', 'node raised'),
        (RESULT(code=RESULT.CANCELED, message='replaced'), 'abort', 'canceled', 'replaced'),
        (RESULT(code=RESULT.CANCELED, message='replaced'), 'succeed', 'canceled', 'replaced'),
        (RESULT(code=RESULT.SUCCESS, missing_outputs=['path']), 'succeed', 'failed', "did not write 'path'"),
        (RESULT(code=RESULT.SUCCESS), 'succeed', 'failed', "did not send 'path'"),
        (RESULT(code=RESULT.SUCCESS, outputs=[to_entry('path', pose(1.0))]), 'succeed', 'failed', 'PoseStamped'),
        (RESULT(code=77), 'succeed', 'failed', 'navigate'),
    ],
)  # fmt: skip
def test_nothing_but_success_counts_as_done(bench: StateBench, result: Any, how: str, outcome: str, words: str) -> None:
    bench.serve(BtExecute, 'bt_executor', ends(result, how))
    run = bench.run_state(lambda: execute(outputs={'path': 'nav_msgs/Path'}), {'path': None})
    assert run.wait() == outcome
    assert words in run.errors()


def test_without_a_server_the_state_fails_soon_and_says_so(bench: StateBench) -> None:
    run = bench.run_state(execute)
    assert run.wait() == 'failed'
    assert 'bt_executor' in run.errors()


def test_a_server_that_begins_is_waited_for(bench: StateBench) -> None:
    bench.services = replace(bench.services, starting=lambda: ['/bt_server'])
    link = bench.services.actions.link(BtExecute, 'bt_executor')
    call = ActionCall(link, BtExecute.Goal(), on_done=lambda _outcome: None)
    run = bench.run_state(execute)
    wait_until(lambda: call.outcome is not None and call.outcome.status is GoalStatus.NO_SERVER, 'end of the patience')
    bench.serve(BtExecute, 'bt_executor', ends(RESULT(code=RESULT.SUCCESS)))
    assert run.wait() == 'done'


def test_a_rejected_goal_is_failed(bench: StateBench) -> None:
    server = bench.serve(BtExecute, 'bt_executor', ends(RESULT(code=RESULT.SUCCESS)), accept=lambda _goal: False)
    run = bench.run_state(execute)
    assert run.wait() == 'failed'
    assert 'reject' in run.errors()
    assert server.goals == []


def test_a_script_that_raises_is_failed(bench: StateBench) -> None:
    async def script(goal_handle: Any) -> Any:
        raise RuntimeError('crash inside the server')

    bench.serve(BtExecute, 'bt_executor', script)
    run = bench.run_state(execute)
    assert run.wait() == 'failed'


def test_a_server_that_dies_is_noticed(bench: StateBench) -> None:
    server = hanging(bench)
    run = bench.run_state(execute)
    wait_until(lambda: server.running, 'goal active')
    server.runtime.close()
    assert run.wait() == 'failed'
    assert 'bt_executor' in run.errors()
    assert run.message.startswith('/State: ') and "server 'bt_executor' " in run.message, run.message
    assert 'is gone' in run.message, run.message


def test_a_value_that_does_not_fit_is_refused_before_anything_runs(bench: StateBench) -> None:
    server = bench.serve(BtExecute, 'bt_executor', ends(RESULT(code=RESULT.SUCCESS)))
    run = bench.run_state(lambda: execute(inputs={'speed': 'float64'}), {'speed': 'fast'})
    assert run.wait() == 'failed'
    assert 'speed' in run.errors()
    assert 'fast' in run.errors()
    assert server.goals == []


def test_the_stop_of_the_run_cancels_the_tree_and_waits_for_it(bench: StateBench) -> None:
    server = hanging(bench)
    run = bench.run_state(execute)
    wait_until(lambda: server.running, 'goal active')
    assert run.stop() == 'preempted'
    assert (len(server.running), server.cancels) == (0, 1)


def test_a_stop_while_the_cancel_takes_long_waits_for_the_confirmation(bench: StateBench) -> None:
    async def script(goal_handle: Any) -> Any:
        await released
        goal_handle.canceled()
        return RESULT(code=RESULT.CANCELED)

    server = bench.serve(BtExecute, 'bt_executor', script)
    released = server.future()
    run = bench.run_state(execute)
    wait_until(lambda: server.running, 'goal active')
    run.behavior_run.stop('test')
    wait_until(lambda: server.cancels, 'cancel has arrived')
    assert run.outcome is None, 'the run has ended although the tree still runs'
    server.resolve(released)
    assert run.wait() == 'preempted'
    assert len(server.running) == 0


def test_a_stop_before_the_goal_is_accepted_leaves_no_goal_active(bench: StateBench) -> None:
    asked, go = threading.Event(), threading.Event()

    def accept(_goal: Any) -> bool:
        asked.set()
        return go.wait(DEADLINE)

    server = hanging(bench, accept=accept)
    run = bench.run_state(execute)
    assert asked.wait(DEADLINE)
    run.behavior_run.stop('test')
    go.set()
    assert run.wait() == 'preempted'
    assert (len(server.goals), len(server.running)) == (1, 0)


def test_a_goal_that_is_accepted_too_late_is_failed_and_canceled(bench: StateBench) -> None:
    go = threading.Event()
    server = hanging(bench, accept=lambda _goal: go.wait(DEADLINE))
    run = bench.run_state(execute)
    assert run.wait() == 'failed'
    assert 'bt_executor' in run.errors()
    go.set()
    wait_until(lambda: server.goals and not server.running, 'the late goal is canceled')


def test_the_end_of_the_executive_leaves_no_goal_active(bench: StateBench) -> None:
    server = hanging(bench)

    class Drive(Behavior):
        manifest = BehaviorManifest('Drive')

        def create(self) -> OperatableStateMachine:
            machine = OperatableStateMachine(outcomes=['end'])
            with machine:
                OperatableStateMachine.add('Drive', execute(), dict.fromkeys(('done', 'canceled', 'failed'), 'end'))
            return machine

    entry = BehaviorEntry('Drive', 'test', Drive.manifest, (), Drive)
    runtime = NodeRuntime('onboard_executive', args=())
    executive = open_executive(runtime, ExecutiveParameters(peers=()), BehaviorLibrary([entry]))
    runtime.call(lambda: executive.runs.start(RunRequest(entry, (), (), 3)))
    wait_until(lambda: server.running, 'goal active')
    assert server.goals[0].owner == '/onboard_executive'
    runtime.close()
    assert (len(server.running), server.cancels) == (0, 1)


def test_a_tree_that_takes_too_long_is_canceled_and_failed(bench: StateBench) -> None:
    server = hanging(bench)
    run = bench.run_state(lambda: execute(timeout=0.1))
    assert run.wait() == 'failed'
    assert '0.1 s' in run.errors()
    assert (len(server.running), server.cancels) == (0, 1)


def test_a_server_that_refuses_to_cancel_holds_the_run_until_that_is_given_up(bench: StateBench) -> None:
    server = hanging(bench, on_cancel=lambda _goal_handle: CancelResponse.REJECT)
    run = bench.run_state(execute)
    wait_until(lambda: server.running, 'goal active')
    run.behavior_run.stop('test')
    wait_until(lambda: 'goal of bt_executor not confirmed canceled' in run.errors(), 'the reason')
    assert run.outcome is None
    run.behavior_run.abort('enough')
    assert run.wait() == 'error'
    assert run.message == 'test; enough, while /State: goal of bt_executor not confirmed canceled'


def test_feedback_that_comes_when_the_run_has_ended_is_no_fault(bench: StateBench) -> None:
    faults: list[BaseException] = []
    bench.runtime.on_fault(faults.append)
    server = hanging(bench, on_cancel=lambda _goal_handle: CancelResponse.REJECT)
    run = bench.run_state(execute)
    wait_until(lambda: server.running, 'goal active')
    run.behavior_run.stop('test')
    wait_until(lambda: 'goal of bt_executor not confirmed canceled' in run.errors(), 'the reason')
    run.behavior_run.abort('enough')
    assert run.wait() == 'error'
    assert run.behavior_run.join(DEADLINE)  # the state is part of no run
    heard: list[Any] = []
    link = bench.services.actions.link(BtExecute, 'bt_executor')
    ActionCall(link, BtExecute.Goal(), on_done=lambda _outcome: None, on_feedback=heard.append)
    wait_until(lambda: len(server.running) == 2, 'another goal')
    for goal in (0, 1):  # what comes for the second goal comes after what came for the first one
        server.feedback(goal, BtExecute.Feedback(run_id='tree', active_nodes=['Root'], not_ended=['Root continues']))
    wait_until(lambda: heard, 'feedback')
    assert faults == [] and 'Root continues' not in run.errors()


def test_the_running_nodes_are_the_activity_of_the_state(bench: StateBench) -> None:
    async def script(goal_handle: Any) -> Any:
        goal_handle.publish_feedback(
            BtExecute.Feedback(
                active_nodes=['Root', 'Root/Follow'], run_id='tree', distance_remaining=4.5, time_remaining=-1.0
            )
        )
        await future
        goal_handle.canceled()
        return RESULT(code=RESULT.CANCELED)

    server = bench.serve(BtExecute, 'bt_executor', script, on_cancel=lambda _goal: resolve())
    future = server.future()

    def resolve() -> CancelResponse:
        future.set_result(None)
        return CancelResponse.ACCEPT

    run = bench.run_state(execute)

    def activity() -> list[str]:
        return [line for state in run.active() for line in state.activity]

    wait_until(lambda: activity() == ['Root', 'Root/Follow'], 'activity shown')
    (progress,) = [state.progress for state in run.active()]
    assert progress is not None and (progress.tree_run_id, progress.distance, progress.time) == ('tree', 4.5, -1.0)
    assert any(leaf.activity == ('Root', 'Root/Follow') for told in run.told for leaf in told.active)
    run.stop()


def test_nothing_of_a_tree_that_has_ended_is_shown_while_the_operator_decides(bench: StateBench) -> None:
    async def script(goal_handle: Any) -> Any:
        goal_handle.publish_feedback(BtExecute.Feedback(active_nodes=['Root', 'Root/Follow']))
        await future
        goal_handle.abort()
        return RESULT(code=RESULT.FAILURE)

    server = bench.serve(BtExecute, 'bt_executor', script)
    future = server.future()

    def machine() -> OperatableStateMachine:
        ways = {'done': 'done', 'canceled': 'done', 'failed': 'failed'}
        child = Child('State', execute(), ways, autonomy={'failed': Autonomy.Full})
        return OperatableStateMachine(outcomes=['done', 'failed'], children=[child])

    run = bench.run(machine)

    def shown() -> list[list[str]]:
        return [list(state.activity) for state in run.active()]

    wait_until(lambda: shown() == [['Root', 'Root/Follow']], 'activity shown')
    server.resolve(future)
    wait_until(lambda: run.decisions(), 'the decision whether it has failed')
    assert shown() == [[]]
    run.stop()


@pytest.mark.parametrize(
    ('goal', 'options', 'poses', 'entries'),
    [
        (pose(1.0), {}, [pose(1.0)], []),
        ([pose(1.0), pose(2.0)], {}, [pose(1.0), pose(2.0)], []),
        ([pose(1.0)], {'goal_id': 'goals'}, [], [('goals', [pose(1.0)])]),
        (pose(1.0), {'goal_id': 'dock'}, [], [('dock', pose(1.0))]),
        (pose(1.0), {'goal_msg_type': 'geometry_msgs/msg/PoseStamped[]'}, [pose(1.0)], []),
        ('blue', {'goal_id': 'color', 'goal_msg_type': 'string'}, [], [('color', 'blue')]),
        (Path(), {'goal_id': 'path', 'goal_msg_type': 'nav_msgs/Path'}, [], [('path', Path())]),
    ],
)
def test_goals_of_all_kinds_arrive(
    bench: StateBench, goal: Any, options: dict[str, Any], poses: list[Any], entries: list[Any]
) -> None:
    server = bench.serve(BtExecute, 'bt_executor', ends(RESULT(code=RESULT.SUCCESS)))
    run = bench.run_state(lambda: BtExecuteGoalState(**options), {'goal': goal})
    assert run.wait() == 'done', run.lines
    (sent,) = server.goals
    assert list(sent.goals) == poses
    assert [(entry.key, from_entry(entry)) for entry in sent.inputs] == entries


@pytest.mark.parametrize(
    ('goal', 'words'), [([], 'empty'), (7, 'PoseStamped'), ([pose(1.0), 'x'], 'PoseStamped'), (None, 'PoseStamped')]
)
def test_what_is_no_goal_pose_is_refused(bench: StateBench, goal: Any, words: str) -> None:
    server = bench.serve(BtExecute, 'bt_executor', ends(RESULT(code=RESULT.SUCCESS)))
    run = bench.run_state(BtExecuteGoalState, {'goal': goal})
    assert run.wait() == 'failed'
    assert words in run.errors()
    assert server.goals == []


@pytest.mark.parametrize(('code', 'outcome'), [('SUCCESS', 'done'), ('FAILURE', 'failed'), ('CANCELED', 'canceled')])
def test_the_requested_value_comes_under_the_key_data(bench: StateBench, code: str, outcome: str) -> None:
    result = RESULT(code=getattr(RESULT, code), outputs=[to_entry('path', Path(poses=[pose(3.0)]))])
    bench.serve(BtExecute, 'bt_executor', ends(result))
    read: dict[str, Any] = {}
    run = bench.run_state(
        lambda: BtExecuteGoalState(request_id='path', request_msg_pkg='nav_msgs', request_msg_type='Path'),
        {'goal': pose(1.0), 'data': None},
        outputs=['data'],
        read=read,
    )
    assert run.wait() == outcome
    assert read['data'].poses == [pose(3.0)]


@pytest.mark.parametrize(
    ('make', 'words'),
    [
        (lambda: BtExecuteState(bt_file='flexbt_msgs/trees/none.xml'), 'bt_file'),
        (lambda: BtExecuteState(bt_file='no_such_package/tree.xml'), 'no_such_package'),
        (lambda: BtExecuteState(bt_topic='not a name'), 'bt_topic'),
        (lambda: BtExecuteState(outputs={'path': 'nav_msgs/msg/Paht'}), "did you mean 'Path'"),
        (lambda: BtExecuteState(inputs={'': 'string'}), 'inputs'),
        (lambda: BtExecuteState(bt_topic=5), 'bt_topic: 5 is not text'),  # type: ignore[arg-type]
        (lambda: BtExecuteState(inputs={'a': 5}), "inputs['a']: 5 is not text"),  # type: ignore[dict-item]
        (lambda: BtExecuteState(timeout=10**400), 'timeout'),
        (lambda: BtExecuteState(timeout=0.0), 'timeout'),
        (lambda: BtExecuteState(bt_file=5), 'bt_file'),  # type: ignore[arg-type]
        (lambda: BtExecuteState(blackboard=5), 'blackboard'),  # type: ignore[arg-type]
        (lambda: BtExecuteGoalState(goal_msg_type='PoseStamped'), 'goal_msg_type'),
        (lambda: BtExecuteGoalState(goal_id=''), 'goal_id'),
        (lambda: BtExecuteGoalState(request_id='path'), 'request_msg_type'),
        (lambda: BtExecuteGoalState(inputs={'goal': 'string'}), "'goal'"),
        (lambda: BtExecuteGoalState(goal_id='place', inputs={'place': 'string'}), "'place' is one of inputs"),
    ],
)
def test_what_cannot_work_is_refused_when_the_state_is_made(make: Any, words: str) -> None:
    with pytest.raises(StateParameterError, match='BtExecute') as refusal:
        make()
    assert words in str(refusal.value)


def hanging(bench: StateBench, **options: Any) -> ScriptedActionServer:
    """Return a server whose goals run until they are canceled."""

    async def script(goal_handle: Any) -> Any:
        await future
        if goal_handle.is_cancel_requested:
            goal_handle.canceled()
        return RESULT(code=RESULT.CANCELED)

    def cancel(_goal_handle: Any) -> CancelResponse:
        future.set_result(None)
        return CancelResponse.ACCEPT

    server = bench.serve(BtExecute, 'bt_executor', script, **{'on_cancel': cancel, **options})
    future = server.future()
    return server

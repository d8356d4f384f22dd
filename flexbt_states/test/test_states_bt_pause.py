# SPDX-License-Identifier: BSD-3-Clause
"""A state that is paused pauses its tree, whenever that comes."""

from __future__ import annotations

import itertools
import time
from types import SimpleNamespace
from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped

from flexbt_common import names
from flexbt_common.calls.service_call import ServiceOutcome
from flexbt_core.clock.clock import ManualClock
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.authoring.wrappers import with_timeout
from flexbt_core.state_machine.engine import operator_commands
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_msgs.action import BtExecute, BtSetData
from flexbt_msgs.srv import ControlTree
from flexbt_states import BtExecuteGoalState, BtExecuteState, BtSetDataState, bt_execute_states
from flexbt_testing.nodes.scripted_action_server import ScriptedActionServer
from flexbt_testing.nodes.state_bench import Run, StateBench
from flexbt_testing.waiting import wait_until

RESULT = BtExecute.Result
PAUSE, RESUME = ControlTree.Request.PAUSE, ControlTree.Request.RESUME


class TreeServer:
    """A BT server whose tree runs until it is let go; knows its run only when ``knows`` is set."""

    def __init__(self, bench: StateBench, prefix: str = '') -> None:
        self.knows = True
        self.refusal = ''
        self.not_paused: list[str] = []
        self.not_ended: list[str] = []
        self.answers: bool = True
        self.commands: list[tuple[int, str]] = []
        self.owner = ''
        self.handle: Any = None
        self._release: Any = None
        self.actions: ScriptedActionServer = bench.serve(BtExecute, f'{prefix}{names.BT_EXECUTOR}', self._run)
        runtime = self.actions.runtime
        runtime.call(
            lambda: runtime.node.create_service(
                ControlTree, f'{prefix}{names.CONTROL_TREE}', self._control, qos_profile=names.service_qos()
            )
        )

    async def _run(self, handle: Any) -> Any:
        self.handle = handle
        from rclpy.task import Future

        self._release = Future()
        await self._release
        if handle.is_cancel_requested:
            handle.canceled()
            return RESULT(code=RESULT.CANCELED, not_ended=self.not_ended)
        handle.succeed()
        return RESULT(code=RESULT.SUCCESS, not_ended=self.not_ended)

    def end(self) -> None:
        self.actions.resolve(self._release)

    def tell(self) -> bool:
        """Send feedback: the tree runs."""
        feedback = BtExecute.Feedback(active_nodes=['main'], not_ended=self.not_ended)
        self.actions.runtime.call(lambda: self.handle.publish_feedback(feedback))
        return True

    @property
    def run_id(self) -> str:
        return bytes(self.handle.goal_id.uuid).hex()

    def _control(self, request: Any, response: Any) -> Any:
        while not self.answers:
            time.sleep(0.01)
        if not self.knows:
            response.message = f'no run has the ID {request.run_id!r}'
            return response
        self.commands.append((request.command, request.run_id))
        self.owner = request.owner
        response.success, response.message = not self.refusal, self.refusal
        if request.command == PAUSE:
            response.not_paused = self.not_paused
        return response


def state() -> BtExecuteState:
    return BtExecuteState(bt_file='navigate')


def start(bench: StateBench, server: TreeServer, made: Any = state) -> Run:
    run = bench.run_state(made, {'goal': PoseStamped()})
    wait_until(lambda: server.handle is not None, 'the goal')
    return run


def pause(run: Run, paused: bool) -> None:
    wait_until(lambda: run.structure, 'the machine')
    assert run.answer_to(operator_commands.pause if paused else operator_commands.resume) is None


@pytest.mark.parametrize('kind', [BtExecuteState, BtExecuteGoalState])
@pytest.mark.parametrize('prefix', ['', 'robot/'])
def test_the_tree_is_paused_and_resumed_with_the_state(bench: StateBench, prefix: str, kind: Any) -> None:
    server = TreeServer(bench, prefix)
    run = start(bench, server, lambda: kind(bt_topic=f'{prefix}{names.BT_EXECUTOR}', bt_file='navigate'))
    pause(run, True)
    wait_until(lambda: server.commands, 'the pause')
    pause(run, False)
    wait_until(lambda: len(server.commands) == 2, 'the resume')
    assert server.commands == [(PAUSE, server.run_id), (RESUME, server.run_id)]
    server.end()
    assert run.wait() == 'done', run.lines
    assert run.errors() == ''


def test_a_run_that_is_not_known_yet_is_paused_when_it_is(bench: StateBench) -> None:
    server = TreeServer(bench)
    server.knows = False
    run = start(bench, server)
    pause(run, True)
    server.tell()
    server.knows = True
    wait_until(lambda: server.tell() and server.commands, 'the pause')
    assert server.commands == [(PAUSE, server.run_id)]
    pause(run, False)
    wait_until(lambda: server.commands[1:], 'the resume')
    server.end()
    assert run.wait() == 'done', run.lines


def test_a_tree_that_is_not_paused_is_told_to_the_operator(bench: StateBench) -> None:
    server = TreeServer(bench)
    server.refusal = 'the brake is loose'
    run = start(bench, server)
    server.tell()
    pause(run, True)
    wait_until(lambda: server.tell() and 'the tree was not paused: the brake is loose' in run.errors(), 'the warning')
    pause(run, False)
    server.end()
    assert run.wait() == 'done', run.lines


SPIN, BACK_UP, WAIT = (
    f'{action}: its server has not ended the goal canceled at 12:34:56: the robot may move; STOP keeps it at rest, '
    'restart a server that hangs'
    for action in ('spin', 'backup', 'wait')
)


def warned(run: Run) -> list[str]:
    """Return what was told to the operator of goals that go on, but for the status of a pause."""
    return [line for line in run.errors().splitlines() if line.endswith('hangs') and 'is paused' not in line]


def test_goals_that_their_servers_do_not_end_are_told_to_the_operator(bench: StateBench) -> None:
    server = TreeServer(bench)
    server.not_paused = ['main/Door: a service call cannot be stopped', 'main/Arm: a thread cannot be stopped']
    run = start(bench, server)
    pause(run, True)
    server.not_ended = [SPIN, BACK_UP]
    shown = tuple(f'goal of bt_executor: {line}' for line in (*server.not_ended, *server.not_paused))
    wait_until(lambda: server.tell() and not_paused(run) == shown, lambda: not_paused(run))
    assert warned(run) == []
    pause(run, False)
    wait_until(lambda: server.tell() and warned(run), run.errors)
    server.not_ended = [SPIN, BACK_UP, WAIT]
    server.end()  # with what no feedback has told yet
    assert run.wait() == 'done', run.lines
    assert warned(run) == [SPIN, BACK_UP, WAIT]


def test_what_goes_on_is_told_once_in_a_run_and_when_a_tree_was_canceled(bench: StateBench) -> None:
    server = TreeServer(bench)

    def machine() -> OperatableStateMachine:
        root = OperatableStateMachine(outcomes=['done', 'failed', 'canceled'])
        with root:
            OperatableStateMachine.add('First', state(), {'done': 'Next', 'failed': 'failed', 'canceled': 'canceled'})
            OperatableStateMachine.add('Next', state(), {name: name for name in root.outcomes})
        return root

    run = bench.run(machine)
    first = wait_until(lambda: server.handle, 'the first goal')
    server.not_ended = [SPIN, BACK_UP]
    wait_until(lambda: server.tell() and warned(run), run.errors)
    server.end()
    wait_until(lambda: server.handle is not first, 'the next goal')
    wait_until(lambda: server.tell() and [leaf.activity for leaf in run.active()] == [('main',)], run.active)
    server.not_ended = [BACK_UP, WAIT]
    run.behavior_run.stop('test')
    wait_until(lambda: server.actions.cancels, 'the cancel')
    server.end()
    run.wait()
    assert warned(run) == [SPIN, BACK_UP, WAIT]


def test_pauses_in_quick_succession_end_as_the_last_one_wants(bench: StateBench) -> None:
    server = TreeServer(bench)
    run = start(bench, server)
    server.tell()
    for _ in range(20):
        pause(run, True)
        pause(run, False)
    pause(run, True)
    wait_until(lambda: server.tell() and server.commands[-1:] == [(PAUSE, server.run_id)], 'the last pause')
    kinds = [command for command, _ in server.commands]
    assert all(one != other for one, other in itertools.pairwise(kinds)), kinds
    pause(run, False)
    wait_until(lambda: server.commands[-1:] == [(RESUME, server.run_id)], 'the last resume')
    server.end()
    assert run.wait() == 'done', run.lines


class Requests(list[tuple[int, Any]]):
    """The requests of the pause of a tree whose run has ended, each with the function that gets its answer."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        super().__init__()
        monkeypatch.setattr(bt_execute_states, 'ServiceCall', self._call)
        runtime = SimpleNamespace(steady=ManualClock())
        services: Any = SimpleNamespace(runtime=runtime, node_name='/executive', changed=lambda: None)
        link: Any = SimpleNamespace(name='bt_server/control')
        state = EventState(outcomes=['done'])
        assert state.bound_to is None
        self.pause = bt_execute_states.TreePause(state, services, link, 'run')

    def _call(self, link: Any, request: Any, on_done: Any, **_: Any) -> Any:
        self.append((request.command, on_done))
        return SimpleNamespace()

    def answer(self, outcome: ServiceOutcome) -> None:
        self[-1][1](outcome)

    @property
    def commands(self) -> list[int]:
        return [command for command, _ in self]


def test_an_answer_that_arrives_after_the_end_of_the_run_is_no_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    requests = Requests(monkeypatch)
    requests.pause.set(True)
    requests.answer(ServiceOutcome(ControlTree.Response(), ''))
    requests.pause.set(False)
    requests.answer(ServiceOutcome(ControlTree.Response(message='unknown'), ''))
    requests.pause.run_seen()
    requests.answer(ServiceOutcome(None, 'no answer'))


@pytest.mark.parametrize('when', ['before', 'after'])
def test_a_pause_without_an_answer_is_taken_back(monkeypatch: pytest.MonkeyPatch, when: str) -> None:
    requests, lost = Requests(monkeypatch), ServiceOutcome(None, 'no answer')
    requests.pause.set(True)
    if when == 'after':
        requests.answer(lost)
    requests.pause.set(False)
    if when == 'before':
        requests.answer(lost)
    assert requests.commands == [PAUSE, RESUME]  # a server that was stopped may carry out the first one yet
    requests.answer(ServiceOutcome(ControlTree.Response(message='no such run yet'), ''))
    requests.pause.run_seen()
    assert requests.commands == [PAUSE, RESUME, RESUME]
    requests.answer(ServiceOutcome(ControlTree.Response(success=True), ''))
    requests.pause.run_seen()
    assert requests.commands == [PAUSE, RESUME, RESUME]


def test_a_paused_state_that_is_stopped_cancels_its_tree(bench: StateBench) -> None:
    server = TreeServer(bench)
    run = start(bench, server)
    pause(run, True)
    wait_until(lambda: server.commands, 'the pause')
    run.behavior_run.stop('test')
    wait_until(lambda: server.actions.cancels, 'the cancel')
    assert [command for command, _ in server.commands] == [PAUSE]  # it is not to move before it ends
    server.end()
    run.wait()
    wait_until(lambda: len(server.commands) == 2, 'what may continue for somebody else')
    assert server.commands[-1] == (RESUME, server.run_id)


def test_a_tree_that_was_taken_over_in_a_pause_goes_on_when_the_state_is_stopped(bench: StateBench) -> None:
    server = TreeServer(bench)
    run = start(bench, server)
    pause(run, True)
    wait_until(lambda: server.commands, 'the pause')
    assert server.owner == bench.services.node_name
    server.end()  # as it does when another goal takes over
    state = run.behavior_run
    wait_until(lambda: server.handle.status == GoalStatus.STATUS_SUCCEEDED, 'the end of the goal')
    assert len(server.commands) == 1  # the pause is that of the operator
    state.stop('test')
    wait_until(lambda: len(server.commands) == 2, 'the newer goal may continue')
    assert server.commands[-1] == (RESUME, server.run_id)
    run.wait()


def not_paused(run: Run) -> tuple[str, ...]:
    return next((leaf.not_paused for leaf in run.active()), ())


def test_what_the_tree_cannot_pause_is_shown_until_it_is_resumed(bench: StateBench) -> None:
    server = TreeServer(bench)
    server.not_paused = ['main/Door: a service call cannot be stopped']
    run = start(bench, server)
    assert not_paused(run) == ()
    pause(run, True)
    shown = ('goal of bt_executor: main/Door: a service call cannot be stopped',)
    wait_until(lambda: not_paused(run) == shown, lambda: not_paused(run))
    assert f'is paused, and yet continues: {shown[0]}' in run.errors()
    pause(run, False)
    wait_until(lambda: not_paused(run) == (), 'nothing is paused')
    server.end()
    assert run.wait() == 'done', run.lines


def test_a_server_that_does_not_answer_the_pause_is_shown(bench: StateBench) -> None:
    server = TreeServer(bench)
    run = start(bench, server)
    server.answers = False
    try:
        pause(run, True)
        shown = ('goal of bt_executor: control_tree has not confirmed the pause of the tree',)
        wait_until(lambda: not_paused(run) == shown, lambda: not_paused(run))
    finally:
        server.answers = True
    wait_until(lambda: not_paused(run) == (), lambda: not_paused(run))
    pause(run, False)
    server.end()
    assert run.wait() == 'done', run.lines


def test_a_goal_that_has_no_pause_is_shown(bench: StateBench) -> None:
    bench.serve(BtSetData, names.BT_SET_DATA)
    run = bench.run_state(lambda: BtSetDataState(inputs={'x': 'float64'}), {'x': 1.0})
    wait_until(lambda: run.active(), 'the state')
    pause(run, True)
    wait_until(lambda: not_paused(run) == ('goal of bt_set_data: its action has no pause',), lambda: not_paused(run))


class Busy(EventState):
    """Something of its own that goes on; ``fails`` when it is asked what."""

    def __init__(self, fails: bool) -> None:
        super().__init__(outcomes=['done'], desired_rate=None)
        self._fails = fails

    def not_paused(self) -> list[str]:
        if self._fails:
            raise ArithmeticError
        return ['gripper: it has no pause']


@pytest.mark.parametrize('wrap', [lambda state: state, lambda state: with_timeout(state, 1000.0)])
def test_what_a_state_says_of_itself_is_shown(bench: StateBench, wrap: Any) -> None:
    run = bench.run_state(lambda: wrap(Busy(False)))
    wait_until(lambda: run.active(), 'the state')
    assert not_paused(run) == ()
    pause(run, True)
    wait_until(lambda: not_paused(run) == ('gripper: it has no pause',), lambda: not_paused(run))


def test_a_state_that_raises_when_it_is_asked_is_told_once(bench: StateBench) -> None:
    run = bench.run_state(lambda: Busy(True))
    wait_until(lambda: run.active(), 'the state')
    pause(run, True)
    wait_until(lambda: not_paused(run) == ('not_paused() raised; see the log',), lambda: not_paused(run))
    for _ in range(3):
        run.active()
    pause(run, False)
    wait_until(lambda: not_paused(run) == (), lambda: not_paused(run))
    assert run.errors().count('not_paused raised:') == 1

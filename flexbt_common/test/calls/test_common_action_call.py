# SPDX-License-Identifier: BSD-3-Clause
"""Action calls against real servers: every way in which a goal can end, and the races in between."""

from __future__ import annotations

import gc
import signal
import threading
import time
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from action_msgs.srv import CancelGoal
from builtin_interfaces.msg import Duration
from nav2_msgs.action import Spin, Wait
from rclpy.action import ActionServer, CancelResponse
from unique_identifier_msgs.msg import UUID

from flexbt_common import discovery
from flexbt_common.calls.action_call import ActionCall, ActionLinks, ActionServerLink, GoalOutcome, GoalStatus
from flexbt_common.lifecycle.liveliness import LivelinessWatch
from flexbt_common.middleware.fastdds import FAST_DDS
from flexbt_common.middleware.implementation import implementation
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_testing.nodes.scripted_action_server import ScriptedActionServer
from flexbt_testing.system.python_processes import PythonProcess, python_process
from flexbt_testing.waiting import DEADLINE, wait_until

APPEARS = 10.0  # wall time for the server to be discovered on a busy machine


class Done:
    """Collects outcomes, and lets a test wait for the first."""

    def __init__(self) -> None:
        self.outcomes: list[GoalOutcome] = []
        self.threads: list[bool] = []
        self.event = threading.Event()

    def __call__(self, outcome: GoalOutcome) -> None:
        self.outcomes.append(outcome)
        self.event.set()

    def wait(self) -> GoalOutcome:
        assert self.event.wait(DEADLINE), 'no outcome'
        return self.outcomes[0]


@pytest.fixture
def client() -> Iterator[NodeRuntime]:
    with NodeRuntime.open('client') as runtime:
        yield runtime


@pytest.fixture
def server() -> Iterator[ScriptedActionServer]:
    with NodeRuntime.open('server') as runtime:
        yield ScriptedActionServer(runtime, Wait, 'wait')


@pytest.fixture
def link(client: NodeRuntime) -> ActionServerLink:
    return ActionLinks(client).link(Wait, 'wait')


def call(link: ActionServerLink, done: Done, goal: Any = None, **options: Any) -> ActionCall:
    timeouts = {'server_timeout': APPEARS, 'accept_timeout': APPEARS}
    return ActionCall(link, goal or Wait.Goal(), on_done=done, **timeouts | options)


def test_a_goal_succeeds(link: ActionServerLink, server: ScriptedActionServer, client: NodeRuntime) -> None:
    done, feedback, accepted, threads = Done(), threading.Event(), threading.Event(), []

    def on_feedback(message: Any) -> None:
        threads.append(client.on_executor_thread)
        assert message.time_left.sec == 3
        feedback.set()

    one = call(link, done, on_feedback=on_feedback, on_accepted=accepted.set)
    assert accepted.wait(DEADLINE)
    wait_until(lambda: len(server.goals) == 1)
    while not feedback.wait(0.05):
        server.feedback(0, Wait.Feedback(time_left=Duration(sec=3)))
    server.end(0)
    outcome = done.wait()
    assert outcome.status is GoalStatus.SUCCEEDED
    assert isinstance(outcome.result, Wait.Result)
    assert outcome.reason == ''
    assert one.outcome is outcome and one.accepted
    assert all(threads)


def test_an_abort_carries_the_servers_reason(link: ActionServerLink, server: ScriptedActionServer) -> None:
    done = Done()
    call(link, done)
    server.end(0, 'abort', Wait.Result(error_msg='scripted abort'))
    outcome = done.wait()
    assert outcome.status is GoalStatus.ABORTED
    assert 'scripted abort' in outcome.reason
    assert outcome.result is not None and outcome.result.error_msg == 'scripted abort'


def test_a_rejected_goal(link: ActionServerLink, server: ScriptedActionServer) -> None:
    server.accept = lambda goal: False
    done = Done()
    call(link, done)
    assert done.wait().status is GoalStatus.REJECTED


def test_no_server(link: ActionServerLink) -> None:
    done = Done()
    call(link, done, server_timeout=0.1)
    outcome = done.wait()
    assert outcome.status is GoalStatus.NO_SERVER
    assert "'wait'" in outcome.reason and 'nav2_msgs/action/Wait' in outcome.reason


def test_a_server_of_another_type_is_no_server(link: ActionServerLink) -> None:
    with NodeRuntime.open('other') as runtime:
        runtime.call(lambda: ActionServer(runtime.node, Spin, 'wait', lambda handle: Spin.Result()))
        done = Done()
        call(link, done, server_timeout=0.5)
        assert done.wait().status is GoalStatus.NO_SERVER


def test_a_goal_that_cannot_be_serialized_is_a_fault(link: ActionServerLink, server: ScriptedActionServer) -> None:
    done = Done()
    ActionCall(link, Spin.Goal(), on_done=done, server_timeout=APPEARS)
    assert done.wait().status is GoalStatus.FAULT


def test_a_goal_arrives_as_its_fields_show(client: NodeRuntime) -> None:
    done, link = Done(), ActionLinks(client).link(Spin, 'spin')
    with NodeRuntime.open('spinner') as runtime:
        server = ScriptedActionServer(runtime, Spin, 'spin')
        call(link, done, goal=Spin.Goal(check_fields=False, target_yaw=2))
        wait_until(lambda: server.goals, 'the goal')
        assert repr(server.goals[0].target_yaw) == '2.0'
        server.end(0)
        assert done.wait().status is GoalStatus.SUCCEEDED
        refused = Done()
        call(link, refused, goal=Spin.Goal(check_fields=False, target_yaw=True))
        assert 'field target_yaw: expected a number, got True' in refused.wait().reason


def test_cancel(link: ActionServerLink, server: ScriptedActionServer) -> None:
    done, accepted = Done(), threading.Event()
    one = call(link, done, on_accepted=accepted.set)
    assert accepted.wait(DEADLINE)
    wait_until(lambda: len(server.goals) == 1)
    one.cancel(timeout=DEADLINE)
    one.cancel(timeout=DEADLINE)
    outcome = done.wait()
    assert outcome.status is GoalStatus.CANCELED
    assert server.cancels == 1


def test_cancel_before_the_server_appears_sends_nothing(link: ActionServerLink) -> None:
    done = Done()
    call(link, done).cancel()
    assert done.wait().status is GoalStatus.CANCELED


def test_cancel_before_acceptance_is_sent_on_acceptance(link: ActionServerLink, server: ScriptedActionServer) -> None:
    wait_until(link.is_ready)
    gate = threading.Event()
    server.accept = lambda _goal: gate.wait(DEADLINE)
    done = Done()
    one = call(link, done)
    wait_until(lambda: one._sent)
    one.cancel(timeout=DEADLINE)
    gate.set()
    assert done.wait().status is GoalStatus.CANCELED
    wait_until(lambda: server.statuses == {0: 'canceled'})


def test_a_cancel_that_comes_with_the_acceptance_is_repeated_once_each_time(
    link: ActionServerLink, server: ScriptedActionServer, client: NodeRuntime, monkeypatch: pytest.MonkeyPatch
) -> None:
    wait_until(link.is_ready)
    gate, passed, sent, cancel = threading.Event(), threading.Event(), list[object](), link.cancel
    server.accept = lambda _goal: gate.wait(DEADLINE)

    def count(goal_id: Any) -> Any:
        sent.append(goal_id)
        return cancel(goal_id)

    monkeypatch.setattr(link, 'cancel', count)
    done = Done()
    one = call(link, done)
    wait_until(lambda: one._sent)

    def accept() -> None:
        one.cancel(timeout=DEADLINE)
        one.goal_answered(True)
        client.post_in(0.1, note)

    def note() -> None:
        sent.append('passed')
        passed.set()

    client.call(accept)
    assert passed.wait(DEADLINE)
    assert sent.index('passed') == 1
    gate.set()
    assert done.wait().status is GoalStatus.CANCELED


def test_a_late_acceptance_is_canceled(link: ActionServerLink, server: ScriptedActionServer) -> None:
    wait_until(link.is_ready)
    gate = threading.Event()
    server.accept = lambda _goal: gate.wait(DEADLINE)
    done = Done()
    one = call(link, done, accept_timeout=0.1)
    outcome = done.wait()
    assert outcome.status is GoalStatus.TIMEOUT
    gate.set()
    wait_until(lambda: server.statuses == {0: 'canceled'})
    assert done.outcomes == [outcome] and one.outcome is outcome


@pytest.mark.parametrize('delay_ms', [0, 1, 2, 4, 8, 16])
def test_cancel_at_any_moment_leaves_no_goal_running(
    link: ActionServerLink, server: ScriptedActionServer, delay_ms: int
) -> None:
    wait_until(link.is_ready)
    dones = []
    for _ in range(10):
        done = Done()
        one = call(link, done)
        time.sleep(delay_ms / 1000)
        one.cancel(timeout=DEADLINE)
        dones.append(done)
    for done in dones:
        assert done.wait().status is GoalStatus.CANCELED
        assert len(done.outcomes) == 1
    wait_until(lambda: len(server.statuses) == len(server.goals))
    assert set(server.statuses.values()) <= {'canceled'}


def test_a_cancel_that_is_refused_ends_at_its_deadline(link: ActionServerLink, server: ScriptedActionServer) -> None:
    server.on_cancel = lambda _handle: CancelResponse.REJECT
    done, accepted = Done(), threading.Event()
    one = call(link, done, on_accepted=accepted.set)
    assert accepted.wait(DEADLINE)
    one.cancel(timeout=0.2)
    outcome = done.wait()
    assert outcome.status is GoalStatus.TIMEOUT
    assert '0.2 s of the cancel' in outcome.reason


def test_a_cancel_without_a_limit_is_asked_for_until_the_server_answers(
    link: ActionServerLink, server: ScriptedActionServer
) -> None:
    server.on_cancel = lambda _handle: CancelResponse.REJECT
    done = Done()
    one = call(link, done)
    wait_until(lambda: server.goals, 'the goal')
    one.cancel(None)
    wait_until(lambda: server.cancels >= 3, 'three cancels')
    assert not one.done
    server.on_cancel = None
    assert done.wait().status is GoalStatus.CANCELED
    assert len(done.outcomes) == 1


def test_a_cancel_without_a_limit_waits_for_a_late_acceptance(
    link: ActionServerLink, server: ScriptedActionServer
) -> None:
    wait_until(lambda: link.runtime.call(link.is_ready), 'the server')
    server.delay_accept = 1.0
    done = Done()
    one = call(link, done, accept_timeout=0.2)
    one.cancel(None)
    assert done.wait().status is GoalStatus.CANCELED
    wait_until(lambda: not server.running, 'no goal is left')


class ForgetfulServer(ActionServer):
    """Knows no goal: their requests are lost."""

    async def _execute_goal_request(self, request_header_and_message: Any) -> None: ...


class DeafServer(ForgetfulServer):
    """Answers no cancel either."""

    async def _execute_cancel_request(self, request_header_and_message: Any) -> None: ...


def test_a_request_that_is_never_answered_does_not_keep_its_caller(link: ActionServerLink) -> None:
    """A tree that tries again and again, at a server that hangs, would keep the goal of each attempt."""
    done = Done()
    with NodeRuntime.open('server') as runtime:
        ScriptedActionServer(runtime, Wait, 'wait', server_class=DeafServer)
        kept = weakref.ref(call(link, done, accept_timeout=0.1))
        assert done.wait().status is GoalStatus.TIMEOUT
        wait_until(lambda: gc.collect() >= 0 and kept() is None, 'the end of the caller', every=0.25)


def test_requests_that_are_never_answered_are_bounded(link: ActionServerLink, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('flexbt_common.calls.action_call._MOST_UNANSWERED', 8)
    with NodeRuntime.open('server') as runtime:
        ScriptedActionServer(runtime, Wait, 'wait', server_class=DeafServer)
        for _ in range(20):
            done = Done()
            call(link, done, accept_timeout=0.01)
            assert done.wait().status is GoalStatus.TIMEOUT
        assert sum(len(client._pending_requests) for client in (link._goals, link._cancels)) <= 8


def test_a_result_that_never_arrives_does_not_keep_its_caller(
    link: ActionServerLink, server: ScriptedActionServer
) -> None:
    server.on_cancel = lambda _handle: CancelResponse.REJECT
    done, accepted = Done(), threading.Event()
    kept = weakref.ref(call(link, done, on_accepted=accepted.set))
    assert accepted.wait(DEADLINE)
    running = kept()
    assert running is not None
    running.cancel(timeout=0.1)
    del running
    assert done.wait().status is GoalStatus.TIMEOUT
    wait_until(lambda: gc.collect() >= 0 and kept() is None, 'the end of the caller', every=0.25)


@pytest.mark.parametrize('server_class', [ForgetfulServer, DeafServer])
def test_a_goal_whose_request_was_lost_ends_when_it_was_canceled(
    link: ActionServerLink, server_class: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    if server_class is DeafServer:  # only the look for the server can tell
        monkeypatch.setattr('flexbt_common.calls.action_call._CANCEL_REPEAT', (1000.0, 1000.0))
    done = Done()
    with NodeRuntime.open('server') as runtime:
        ScriptedActionServer(runtime, Wait, 'wait', server_class=server_class)
        one = call(link, done, accept_timeout=0.2)
        wait_until(lambda: one._sent, 'the request')
        one.cancel(None)
        if server_class is ForgetfulServer:
            done.wait()
        else:
            wait_until(lambda: 'watch' in one._timers, 'the wait for a late answer')
    outcome = done.wait()
    assert outcome.status is GoalStatus.LOST, outcome.reason


class OvertakingServer(ActionServer):
    """Answers each cancel with ``cancel_code``, and requests for results only when :meth:`release` is called."""

    cancel_code = CancelGoal.Response.ERROR_NONE

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.held: list[Any] = []

    async def _execute_cancel_request(self, request_header_and_message: Any) -> None:
        self._handle.send_cancel_response(
            request_header_and_message[0], CancelGoal.Response(return_code=self.cancel_code)
        )

    async def _execute_get_result_request(self, request_header_and_message: Any) -> None:
        self.held.append(request_header_and_message)

    async def release(self) -> None:
        for request in self.held:
            await super()._execute_get_result_request(request)


@pytest.fixture
def cancels_answered(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Return the answers to cancels that calls have dealt with."""
    answers: list[Any] = []
    deal_with = ActionCall._cancel_answered

    def note(self: ActionCall, future: Any) -> None:
        deal_with(self, future)
        answers.append(future.result())

    monkeypatch.setattr(ActionCall, '_cancel_answered', note)
    return answers


@pytest.mark.parametrize('code', ['ERROR_UNKNOWN_GOAL_ID', 'ERROR_GOAL_TERMINATED'])
def test_a_result_that_the_answer_to_a_late_cancel_overtakes_counts(
    link: ActionServerLink, code: str, cancels_answered: list[Any]
) -> None:
    with NodeRuntime.open('server') as runtime:
        server = ScriptedActionServer(runtime, Wait, 'wait', server_class=OvertakingServer)
        server.server.cancel_code = getattr(CancelGoal.Response, code)
        done, accepted = Done(), threading.Event()
        one = call(link, done, on_accepted=accepted.set)
        assert accepted.wait(DEADLINE)
        server.end(0)
        wait_until(lambda: server.statuses == {0: 'succeed'})
        one.cancel(timeout=DEADLINE)
        wait_until(lambda: cancels_answered, 'the answer to the cancel')
        assert not one.done, one.outcome
        wait_until(lambda: len(server.server.held) > 1, 'another request for the result')
        runtime.call(lambda: runtime.node.executor.create_task(server.server.release))
        outcome = done.wait()
    assert outcome.status is GoalStatus.SUCCEEDED, outcome.reason
    assert len(done.outcomes) == 1


def test_a_cancel_at_a_server_that_does_not_know_the_goal_loses_it(
    link: ActionServerLink, cancels_answered: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('flexbt_common.calls.action_call.WATCH_SECONDS', 1000.0)  # only the cancel can tell
    done, accepted = Done(), threading.Event()
    with NodeRuntime.open('server') as first:
        ScriptedActionServer(first, Wait, 'wait')
        one = call(link, done, on_accepted=accepted.set)
        assert accepted.wait(DEADLINE)
    wait_until(lambda: not link.is_ready(), 'the end of the server')
    with NodeRuntime.open('server') as second:
        ScriptedActionServer(second, Wait, 'wait')
        wait_until(link.is_ready, 'the next server')
        one.cancel(timeout=DEADLINE)
        outcome = done.wait()
    assert outcome.status is GoalStatus.LOST
    assert 'does not know the goal' in outcome.reason
    assert cancels_answered[-1].return_code == CancelGoal.Response.ERROR_UNKNOWN_GOAL_ID


def test_a_cancel_by_somebody_else_stays_canceled(link: ActionServerLink, server: ScriptedActionServer) -> None:
    done = Done()
    one = call(link, done)
    wait_until(lambda: len(server.goals) == 1)
    with NodeRuntime.open('stranger') as stranger:
        stranger_link = ActionLinks(stranger).link(Wait, 'wait')
        wait_until(stranger_link.is_ready)
        wait_until(lambda: one.accepted)
        stranger.call(lambda: stranger_link.cancel(UUID(uuid=list(one.goal_id))))
        outcome = done.wait()
    assert outcome.status is GoalStatus.CANCELED
    assert 'somebody else' in outcome.reason


def test_a_callback_that_raises_does_not_stop_the_node(
    link: ActionServerLink, server: ScriptedActionServer, client: NodeRuntime
) -> None:
    faults: list[BaseException] = []
    client.on_fault(faults.append)

    def bad(outcome: GoalOutcome) -> None:
        raise ValueError('scripted')

    ActionCall(link, Wait.Goal(), on_done=bad, server_timeout=APPEARS, accept_timeout=APPEARS)
    server.end(0)
    done = Done()
    call(link, done)
    server.end(1)
    assert done.wait().status is GoalStatus.SUCCEEDED
    assert [str(fault) for fault in faults] == ['scripted']


def test_a_lost_result_is_asked_for_again(
    link: ActionServerLink, server: ScriptedActionServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    lost: list[Any] = []
    arrived = ActionCall._result_arrived

    def lose_first(self: ActionCall, future: Any) -> None:
        if not lost:
            lost.append(future)
        else:
            arrived(self, future)

    monkeypatch.setattr(ActionCall, '_result_arrived', lose_first)
    done = Done()
    call(link, done)
    server.end(0)
    assert done.wait().status is GoalStatus.SUCCEEDED
    assert lost


def test_an_acceptance_whose_answer_is_lost_counts(
    link: ActionServerLink, server: ScriptedActionServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ActionCall, 'goal_answered', lambda self, is_accepted: None)
    done = Done()
    call(link, done)
    server.end(0)
    assert done.wait().status is GoalStatus.SUCCEEDED
    done, accepted = Done(), threading.Event()
    two = call(link, done, on_accepted=accepted.set)
    assert accepted.wait(DEADLINE)
    two.cancel(timeout=DEADLINE)
    assert done.wait().status is GoalStatus.CANCELED


def start_child(*arguments: str) -> PythonProcess:
    child = python_process(['-m', 'flexbt_testing.nodes.scripted_action_server', *arguments])
    wait_for_line(child, 'ready')
    return child


def wait_for_line(child: PythonProcess, line: str) -> None:
    assert child.stdout is not None
    said = ''
    while said != f'{line}\n':
        said = child.stdout.readline()
        assert said, f'the server has ended before it said {line!r}'


@pytest.fixture
def children() -> Iterator[list[PythonProcess]]:
    """Yield those that a test starts, the newest last; all are ended."""
    started: list[PythonProcess] = []
    yield started
    for child in started:
        with child:
            child.kill()


def find_token(link: ActionServerLink) -> None:
    """Wait until the liveliness token of the server has been heard."""
    client = link.runtime
    watch = LivelinessWatch(client, '/scripted')
    wait_until(lambda: client.call(link.is_ready) and watch.ready, 'the server and its token')
    watch.close()


@pytest.mark.dds('another process takes part')
@pytest.mark.parametrize('is_restarted', [False, True])
@pytest.mark.parametrize('moment', ['before the acceptance', 'while it executes', 'during a cancel', 'relied on'])
def test_a_server_with_a_token_that_is_killed_loses_the_goal_at_once_and_the_next_one_is_used(
    link: ActionServerLink, client: NodeRuntime, children: list[PythonProcess], moment: str, is_restarted: bool
) -> None:
    children.append(start_child('token', 'stubborn'))
    find_token(link)
    done = Done()
    if moment == 'before the acceptance':
        children[0].send_signal(signal.SIGSTOP)
        call(link, done, accept_timeout=1e3)
        client.call(lambda: None)  # after it was sent
    else:
        accepted = threading.Event()
        one = call(link, done, on_accepted=accepted.set)
        assert accepted.wait(DEADLINE)
        if moment != 'while it executes':
            one.cancel(timeout=None if moment == 'relied on' else 1e3)
            wait_for_line(children[0], 'cancel')
    children[0].kill()
    if is_restarted:
        children.append(start_child('token'))
    assert done.wait().status is GoalStatus.LOST
    if not is_restarted:
        # Until the lease of its participant is over, the middleware shows the server that was killed.
        assert client.call(link.is_shown) and not client.call(link.is_ready)
        children.append(start_child('token'))
    done, accepted = Done(), threading.Event()
    one = call(link, done, on_accepted=accepted.set)
    assert accepted.wait(DEADLINE)
    one.cancel(timeout=DEADLINE)
    assert done.wait().status is GoalStatus.CANCELED


@pytest.mark.dds('another process takes part')
def test_a_server_that_is_stopped_loses_the_goal_after_its_time_and_finds_a_cancel(
    client: NodeRuntime, children: list[PythonProcess]
) -> None:
    link = ActionLinks(client, peer_timeout=1.0).link(Wait, 'wait')
    children.append(start_child('token'))
    find_token(link)
    given_up, relied_on, accepted = Done(), Done(), threading.Semaphore(0)
    call(link, given_up, on_accepted=accepted.release)
    canceled = call(link, relied_on, on_accepted=accepted.release)
    for _ in range(2):
        assert accepted.acquire(timeout=DEADLINE)
    children[0].send_signal(signal.SIGSTOP)
    canceled.cancel(timeout=None)
    outcome = given_up.wait()
    assert outcome.status is GoalStatus.LOST
    assert client.call(link.is_shown) and not client.call(link.is_ready)
    assert not relied_on.outcomes, 'who cancels without a time limit relies on the end'
    children[0].send_signal(signal.SIGCONT)
    wait_for_line(children[0], 'cancel')
    wait_for_line(children[0], 'cancel')
    assert relied_on.wait().status in (GoalStatus.CANCELED, GoalStatus.LOST)
    wait_until(lambda: client.call(link.is_ready), 'the server is used again')


@pytest.mark.dds('another process takes part')
@pytest.mark.parametrize('how', [signal.SIGKILL, signal.SIGTERM])
def test_a_server_that_dies_loses_the_goal_and_is_used_again(link: ActionServerLink, how: signal.Signals) -> None:
    child = start_child()
    try:
        done, accepted = Done(), threading.Event()
        call(link, done, on_accepted=accepted.set)
        assert accepted.wait(DEADLINE)
        child.send_signal(how)
        child.wait(DEADLINE)
        assert done.event.wait(DEADLINE), 'the death was not noticed'
        outcome = done.wait()
        assert outcome.status is GoalStatus.LOST
        assert outcome.result is None
        child = start_child()
        done, accepted = Done(), threading.Event()
        one = call(link, done, on_accepted=accepted.set)
        assert accepted.wait(DEADLINE)
        one.cancel(timeout=DEADLINE)
        assert done.wait().status is GoalStatus.CANCELED
    finally:
        with child:
            child.kill()


@pytest.mark.dds('another process takes part')
@pytest.mark.skipif(implementation() != FAST_DDS, reason='needs Fast DDS')
def test_where_the_middleware_tells_no_liveliness_servers_are_judged_by_the_graph(
    client: NodeRuntime, children: list[PythonProcess], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in a console on a radio: a token cannot be watched there."""
    profile = tmp_path / 'profile.xml'
    profile.write_text('<use_WriterLivelinessProtocol>false</use_WriterLivelinessProtocol>')
    children.append(start_child('token'))
    with monkeypatch.context() as patch:
        patch.setenv(discovery.PROFILE, str(profile))
        link = ActionLinks(client).link(Wait, 'wait')
        done, accepted = Done(), threading.Event()
        one = call(link, done, on_accepted=accepted.set)
        assert accepted.wait(DEADLINE)
        one.cancel(timeout=DEADLINE)
        assert done.wait().status is GoalStatus.CANCELED
    assert not client.node.count_subscribers('/scripted/alive')


@pytest.mark.dds('another process takes part')
def test_a_server_that_is_replaced_within_the_outage_time_does_not_know_the_goal(link: ActionServerLink) -> None:
    child = start_child()
    try:
        done, accepted = Done(), threading.Event()
        call(link, done, on_accepted=accepted.set, outage_timeout=60.0)
        assert accepted.wait(DEADLINE)
        child.terminate()
        child.wait(DEADLINE)
        child = start_child()
        outcome = done.wait()
        assert outcome.status is GoalStatus.LOST
        assert 'does not know the goal' in outcome.reason
    finally:
        with child:
            child.kill()


def test_many_goals_at_once_all_end(link: ActionServerLink, server: ScriptedActionServer) -> None:
    dones = [Done() for _ in range(60)]
    for done in dones:
        call(link, done)
    for index in range(len(dones)):
        server.end(index, 'succeed' if index % 2 else 'abort')
    outcomes = [done.wait().status for done in dones]
    assert outcomes.count(GoalStatus.SUCCEEDED) == 30
    assert outcomes.count(GoalStatus.ABORTED) == 30

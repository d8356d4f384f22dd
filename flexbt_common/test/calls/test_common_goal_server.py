# SPDX-License-Identifier: BSD-3-Clause
"""The goal server against real clients: each goal ends once, as it was ended, and its result can be asked for again."""

from __future__ import annotations

import queue
import random
import threading
import uuid
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import pytest
from action_msgs.msg import GoalInfo, GoalStatusArray
from action_msgs.msg import GoalStatus as RosGoalStatus
from action_msgs.srv import CancelGoal
from builtin_interfaces.msg import Time
from nav2_msgs.action import Wait
from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.action.server import RCLError
from rclpy.publisher import Publisher
from rclpy.service import Service
from unique_identifier_msgs.msg import UUID

from flexbt_common.calls.action_call import ActionCall, ActionLinks, GoalOutcome, GoalStatus
from flexbt_common.calls.goal_server import GoalFault, GoalServer, ServedGoal, goal_servers
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_testing.nodes.scripted_action_server import DEEP_QUEUES
from flexbt_testing.waiting import DEADLINE, wait_until


class Served:
    """A goal server in a node of its own. Goals are held; ``on_goal`` is called with each."""

    def __init__(self, runtime: NodeRuntime, *, cancelable: bool = True) -> None:
        self.runtime = runtime
        self.goals: list[ServedGoal] = []
        self.canceled: list[tuple[ServedGoal, bool]] = []
        self.faults: list[BaseException] = []
        self.on_goal: Callable[[ServedGoal], None] = lambda goal: None
        runtime.on_fault(self.faults.append)
        self.server = runtime.call(
            lambda: GoalServer(runtime, Wait, 'wait', self._serve, self._cancel, cancelable=cancelable)
        )

    def _serve(self, goal: ServedGoal) -> None:
        self.goals.append(goal)
        self.on_goal(goal)

    def _cancel(self, goal: ServedGoal) -> None:
        self.canceled.append((goal, goal.cancel_requested))

    def goal(self, number: int = 0) -> ServedGoal:
        wait_until(lambda: len(self.goals) > number, f'goal {number}')
        return self.goals[number]


@pytest.fixture
def served() -> Iterator[Served]:
    with NodeRuntime.open('server') as runtime:
        yield Served(runtime)


class Client:
    """A plain client of rclpy, which hears the lists of goals too."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self.runtime = runtime
        self.listed: list[list[int]] = []
        self.client: Any = runtime.call(self._make)
        wait_until(self.client.server_is_ready, 'the server')

    def _make(self) -> ActionClient:
        topic = 'wait/_action/status'
        self.runtime.node.create_subscription(
            GoalStatusArray, topic, lambda message: self.listed.append([one.status for one in message.status_list]), 100
        )
        return ActionClient(self.runtime.node, Wait, 'wait', **DEEP_QUEUES)

    def send(self, goal_id: bytes | None = None, seconds: int = 0) -> ClientGoalHandle:
        goal = Wait.Goal()
        goal.time.sec = seconds
        key = UUID(uuid=list(goal_id or uuid.uuid4().bytes))
        return self.answer(lambda: self.client.send_goal_async(goal, goal_uuid=key))

    def answer(self, ask: Callable[[], Any]) -> Any:
        future = self.runtime.call(ask)
        wait_until(future.done, 'the answer')
        return future.result()


@pytest.fixture
def client(served: Served) -> Iterator[Client]:
    with NodeRuntime.open('client') as runtime:
        client = Client(runtime)
        # rmw_fastrtps drops an answer to a client that the server has not found within 0.1 s.
        services = [f'wait/_action/{service}' for service in ('send_goal', 'cancel_goal', 'get_result')]
        wait_until(lambda: all(map(served.runtime.node.count_clients, services)), 'the client at the server')
        yield client


def result(text: str) -> Any:
    return Wait.Result(error_msg=text)


def test_a_client_does_not_remember_the_goals_that_have_ended(served: Served) -> None:
    served.on_goal = lambda goal: goal.succeed(result(''))
    with NodeRuntime.open('client') as runtime:
        link = ActionLinks(runtime).link(Wait, 'wait')
        for _ in range(3):
            outcomes: queue.Queue[GoalOutcome] = queue.Queue()
            ActionCall(link, Wait.Goal(), on_done=outcomes.put, server_timeout=DEADLINE, accept_timeout=DEADLINE)
            assert outcomes.get(timeout=DEADLINE).status is GoalStatus.SUCCEEDED
        assert not link.listeners


def test_results_can_be_asked_for_when_the_goal_is_not_listed_any_more(served: Served, client: Client) -> None:
    served.on_goal = lambda goal: goal.abort(result(f'goal {len(served.goals)}'))
    handles = [client.send() for _ in range(20)]
    wait_until(lambda: not served.server.listed, 'the end of the listing')
    client.send()
    wait_until(lambda: client.listed and client.listed[-1] == [RosGoalStatus.STATUS_ABORTED], 'the short list')
    for number, handle in enumerate(handles, 1):
        for _ in range(2):
            response = client.answer(handle.get_result_async)
            assert (response.status, response.result.error_msg) == (RosGoalStatus.STATUS_ABORTED, f'goal {number}')


def test_a_goal_that_was_never_there_is_unknown(client: Client) -> None:
    response_type = Wait.Impl.SendGoalService.Response
    stranger = ClientGoalHandle(client.client, UUID(uuid=list(uuid.uuid4().bytes)), response_type(accepted=True))
    assert client.answer(stranger.get_result_async).status == RosGoalStatus.STATUS_UNKNOWN


@pytest.mark.parametrize(('until', 'canceled'), [(Time(sec=-1), 0), (Time(nanosec=1), 0), (Time(sec=2**31 - 1), 2)])
def test_a_cancel_of_all_until_a_time_spares_later_goals(
    served: Served, client: Client, until: Time, canceled: int
) -> None:
    handles = [client.send() for _ in range(2)]
    name, node = 'wait/_action/cancel_goal', client.runtime.node
    cancels = client.runtime.call(lambda: node.create_client(CancelGoal, name))
    wait_until(lambda: cancels.service_is_ready() and served.runtime.node.count_clients(name) == 2, 'the client')
    answer = client.answer(lambda: cancels.call_async(CancelGoal.Request(goal_info=GoalInfo(stamp=until))))
    assert (answer.return_code, len(answer.goals_canceling)) == (CancelGoal.Response.ERROR_NONE, canceled)
    assert len(handles) == len(served.goals) and served.faults == []


def test_a_late_cancel_is_told_that_the_goal_has_ended_while_its_result_is_kept(served: Served, client: Client) -> None:
    handle = client.send()
    goal = served.goal()
    served.runtime.call(lambda: goal.succeed(result('')))
    assert client.answer(handle.cancel_goal_async).return_code == CancelGoal.Response.ERROR_GOAL_TERMINATED  # listed
    wait_until(lambda: not served.server.listed, 'the end of the listing')
    assert client.answer(handle.cancel_goal_async).return_code == CancelGoal.Response.ERROR_GOAL_TERMINATED
    served.runtime.call(lambda: served.server.results.drop(goal.id))
    assert client.answer(handle.cancel_goal_async).return_code == CancelGoal.Response.ERROR_UNKNOWN_GOAL_ID


def test_results_are_not_kept_for_ever(served: Served, client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('flexbt_common.calls.goal_server.RESULT_SECONDS', 0.05)
    served.on_goal = lambda goal: goal.succeed(result(''))
    client.send()
    wait_until(lambda: served.goals and served.goals[0].id not in served.server.results, 'the end of the result')


def test_the_result_of_a_later_goal_with_the_same_id_is_kept_for_its_own_time(
    served: Served, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    served.on_goal = lambda goal: goal.succeed(result(f'goal {len(served.goals)}'))
    goal_id, passed = uuid.uuid4().bytes, threading.Event()
    for seconds in (0.5, 1000.0):
        monkeypatch.setattr('flexbt_common.calls.goal_server.RESULT_SECONDS', seconds)
        handle = client.send(goal_id)
        wait_until(lambda: not served.server.listed, 'the end of the listing')
    served.runtime.call(lambda: served.runtime.post_in(0.6, passed.set))
    assert passed.wait(DEADLINE)
    assert client.answer(handle.get_result_async).result.error_msg == 'goal 2'


def test_the_result_comes_before_the_list_that_tells_of_the_end(
    served: Served, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Any] = []
    handle = client.send()
    future = client.runtime.call(handle.get_result_async)
    goal = served.goal()
    wait_until(lambda: served.server.listed[goal.id].askers, 'the request for the result')
    respond, publish = Service.send_response, Publisher.publish

    def note_response(service: Any, response: Any, header: Any) -> None:
        seen.append(getattr(response, 'status', None))
        respond(service, response, header)

    def note_message(publisher: Any, message: Any) -> None:
        if isinstance(message, GoalStatusArray):
            seen.append([one.status for one in message.status_list])
        publish(publisher, message)

    monkeypatch.setattr(Service, 'send_response', note_response)
    monkeypatch.setattr(Publisher, 'publish', note_message)
    served.runtime.call(lambda: goal.succeed(result('done')))
    ended = RosGoalStatus.STATUS_SUCCEEDED
    wait_until(lambda: [ended] in seen, 'the list')
    assert [one for one in seen if one in (ended, [ended])] == [ended, [ended]]
    wait_until(future.done, 'the result')
    assert future.result().result.error_msg == 'done'


def test_the_first_end_counts_and_nothing_is_sent_after_it(served: Served, client: Client) -> None:
    feedback: list[Any] = []
    handle = client.answer(lambda: client.client.send_goal_async(Wait.Goal(), feedback_callback=feedback.append))
    goal = served.goal()

    def end() -> None:
        goal.publish_feedback(Wait.Feedback())
        goal.succeed(result('first'))
        goal.abort(result('second'))
        goal.publish_feedback(Wait.Feedback())

    served.runtime.call(end)
    response = client.answer(handle.get_result_async)
    assert (response.status, response.result.error_msg) == (RosGoalStatus.STATUS_SUCCEEDED, 'first')
    other = client.send()
    served.runtime.call(lambda: served.goal(1).succeed(result('')))
    client.answer(other.get_result_async)
    assert len(feedback) == 1


def fail_once(monkeypatch: pytest.MonkeyPatch, service_name: str) -> list[str]:
    """Have the next answer of a service fail, as when the middleware has lost its client. Return the failures."""
    real, failed = Service.send_response, list[str]()

    def send(service: Any, response: Any, header: Any) -> None:
        if service.srv_name == service_name and not failed:
            failed.append(service_name)
            raise RCLError('client will not receive response')
        real(service, response, header)

    monkeypatch.setattr(Service, 'send_response', send)
    return failed


def test_a_goal_whose_acceptance_cannot_be_sent_is_served(
    served: Served, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    failed = fail_once(monkeypatch, 'wait/_action/send_goal')
    served.on_goal = lambda goal: goal.succeed(result('done'))
    outcomes: list[GoalOutcome] = []
    link = ActionLinks(client.runtime).link(Wait, 'wait')
    ActionCall(link, Wait.Goal(), on_done=outcomes.append, accept_timeout=2.0)
    wait_until(lambda: outcomes, 'the outcome')
    assert failed
    assert outcomes[0].status is GoalStatus.SUCCEEDED, outcomes[0].reason
    assert len(served.goals) == 1 and not served.faults


def test_a_client_that_asks_for_the_result_of_a_stranger_and_goes_is_no_fault(
    served: Served, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    failed = fail_once(monkeypatch, 'wait/_action/get_result')
    response_type = Wait.Impl.SendGoalService.Response
    stranger = ClientGoalHandle(client.client, UUID(uuid=list(uuid.uuid4().bytes)), response_type(accepted=True))
    client.runtime.call(stranger.get_result_async)
    wait_until(lambda: failed, 'the answer')
    assert served.runtime.call(lambda: served.faults) == []


def test_a_goal_may_end_when_its_server_is_closed(served: Served, client: Client) -> None:
    client.send()
    goal = served.goal()
    served.runtime.call(served.server.close)

    def end() -> None:
        goal.publish_feedback(Wait.Feedback())
        goal.succeed(result('too late'))

    served.runtime.call(end)
    assert not goal.active
    assert not served.faults


def test_a_fault_in_the_callback_aborts_the_goal_and_is_reported(served: Served, client: Client) -> None:
    def fail(goal: ServedGoal) -> None:
        raise ValueError('no such map')

    served.on_goal = fail
    response = client.answer(client.send().get_result_async)
    assert response.status == RosGoalStatus.STATUS_ABORTED
    assert [str(fault) for fault in served.faults] == ['no such map']
    served.on_goal = lambda goal: goal.succeed(result('well'))
    assert client.answer(client.send().get_result_async).result.error_msg == 'well'


def test_a_cancel_shows_before_its_callback_and_the_goal_may_end_otherwise(served: Served, client: Client) -> None:
    handles = [client.send(), client.send()]
    for handle in handles:
        assert len(client.answer(handle.cancel_goal_async).goals_canceling) == 1
    wait_until(lambda: len(served.canceled) == 2, 'the cancels')
    assert served.canceled == [(served.goals[0], True), (served.goals[1], True)]
    served.runtime.call(lambda: served.goals[0].canceled(result('rest')))
    served.runtime.call(lambda: served.goals[1].succeed(result('was done already')))
    statuses = [client.answer(handle.get_result_async).status for handle in handles]
    assert statuses == [RosGoalStatus.STATUS_CANCELED, RosGoalStatus.STATUS_SUCCEEDED]
    assert not client.answer(handles[0].cancel_goal_async).goals_canceling


def test_canceled_by_nobody_is_aborted(served: Served, client: Client) -> None:
    served.on_goal = lambda goal: goal.canceled(result('a newer goal'))
    assert client.answer(client.send().get_result_async).status == RosGoalStatus.STATUS_ABORTED


def test_a_server_that_is_not_cancelable_refuses() -> None:
    with NodeRuntime.open('server') as runtime, NodeRuntime.open('client') as client_runtime:
        served = Served(runtime, cancelable=False)
        client = Client(client_runtime)
        handle = client.send()
        response = client.answer(handle.cancel_goal_async)
        assert (response.return_code, list(response.goals_canceling)) == (CancelGoal.Response.ERROR_REJECTED, [])
        assert served.goal().active and not served.goal().cancel_requested


def set_fault(served: Served, **fault: Any) -> None:
    def change() -> None:
        goal_servers(served.runtime)['wait'].fault = GoalFault(**fault)

    served.runtime.call(change)


def test_a_fault_of_a_server_is_seen_by_its_clients_until_it_ends(served: Served, client: Client) -> None:
    running = client.send()
    served.goal()
    set_fault(served, refusal='out of order')
    assert not client.send().accepted
    assert served.goal().active
    set_fault(served, failure=result('broken'))
    for handle in (running, client.send()):
        response = client.answer(handle.get_result_async)
        assert (response.status, response.result.error_msg) == (RosGoalStatus.STATUS_ABORTED, 'broken')
    assert len(served.goals) == 1 and not served.goal().active
    wait_until(lambda: served.canceled == [(served.goals[0], True)], 'the goal is taken from who works on it')
    served.runtime.call(lambda: served.goals[0].succeed(result('too late')))
    set_fault(served)
    served.on_goal = lambda goal: goal.succeed(result('well'))
    assert client.answer(client.send().get_result_async).result.error_msg == 'well'
    assert not served.faults


def test_goals_of_a_server_that_hangs_are_begun_after_the_fault(served: Served, client: Client) -> None:
    handles = [client.send(seconds=1)]
    first = served.goal()
    set_fault(served, hangs=True)
    assert not first.active and first.cancel_requested
    handles.append(client.send(seconds=2))
    assert handles[1].accepted
    served.runtime.call(lambda: first.succeed(result('not told')))
    set_fault(served)
    assert [goal.request.time.sec for goal in served.goals] == [1, 1, 2]
    for goal in served.goals[1:]:
        served.runtime.call(partial(goal.succeed, result('done')))
    assert [client.answer(handle.get_result_async).result.error_msg for handle in handles] == ['done'] * 2
    assert not served.faults


def test_a_server_that_hangs_answers_cancels_after_the_fault(served: Served, client: Client) -> None:
    handle = client.send()
    served.goal()
    set_fault(served, hangs=True)
    answers = [client.runtime.call(handle.cancel_goal_async) for _ in range(3)]
    assert client.send().accepted  # the server has seen what came before
    wait_until(lambda: len(served.server._held_cancels) == 3, 'the cancels')
    assert not any(answer.done() for answer in answers)
    set_fault(served)
    wait_until(lambda: all(answer.done() for answer in answers), 'the answers')
    wait_until(lambda: len(served.goals) == 3, 'both goals are begun')
    assert [goal.cancel_requested for goal in served.goals[1:]] == [True, False]
    assert (served.goals[1], True) in served.canceled
    set_fault(served, hangs=True)
    served.runtime.call(lambda: served.server.end_all(lambda goal, _empty: goal.abort(result('nobody is left'))))
    assert not served.server.busy
    response = client.answer(handle.get_result_async)
    assert (response.status, response.result.error_msg) == (RosGoalStatus.STATUS_ABORTED, 'nobody is left')
    assert not served.faults


def test_a_goal_with_the_id_of_an_old_one_has_a_result_of_its_own(served: Served, client: Client) -> None:
    served.on_goal = lambda goal: goal.succeed(result('old'))
    goal_id = uuid.uuid4().bytes
    client.answer(client.send(goal_id).get_result_async)
    assert not client.send(goal_id).accepted  # listed still
    wait_until(lambda: not served.server.listed, 'the end of the listing')
    served.on_goal = lambda goal: None
    handle = client.send(goal_id)
    future = client.runtime.call(handle.get_result_async)
    wait_until(lambda: served.server.listed[goal_id].askers, 'the request for the result')
    served.runtime.call(lambda: served.goal(1).succeed(result('new')))
    wait_until(future.done, 'the result')
    assert future.result().result.error_msg == 'new'


def test_many_goals_of_two_clients_end_as_they_were_ended(served: Served) -> None:
    """End come at once, later, or after a cancel, on the server's thread and from timers."""
    chance = random.Random(7)
    steady = served.runtime.steady

    def end(goal: ServedGoal) -> None:
        text = str(goal.request.time.sec)
        (goal.canceled if goal.cancel_requested else goal.succeed if int(text) % 2 else goal.abort)(result(text))

    def on_goal(goal: ServedGoal) -> None:
        wait = chance.choice([0.0, 0.0, 0.01, 0.05])
        if wait:
            steady.call_at(steady.now() + wait, lambda: served.runtime.post(lambda: end(goal)))
        else:
            end(goal)

    served.on_goal = on_goal
    outcomes: dict[int, GoalOutcome] = {}
    done = threading.Event()
    total = 120

    def ended(number: int, outcome: GoalOutcome) -> None:
        assert number not in outcomes
        outcomes[number] = outcome
        if len(outcomes) == total:
            done.set()

    with NodeRuntime.open('one') as one, NodeRuntime.open('two') as two:
        links = [ActionLinks(runtime).link(Wait, 'wait') for runtime in (one, two)]
        calls: list[ActionCall] = []
        for number in range(total):
            goal = Wait.Goal()
            goal.time.sec = number
            calls.append(
                ActionCall(
                    links[number % 2],
                    goal,
                    on_done=partial(ended, number),
                    server_timeout=DEADLINE,
                    accept_timeout=DEADLINE,
                )
            )
            if chance.random() < 0.3:
                calls[chance.randrange(number + 1)].cancel(DEADLINE)
        assert done.wait(DEADLINE), f'{total - len(outcomes)} goals have not ended'
    for number, outcome in outcomes.items():
        uncanceled = GoalStatus.SUCCEEDED if number % 2 else GoalStatus.ABORTED
        allowed = {uncanceled, GoalStatus.CANCELED} if calls[number].cancel_requested else {uncanceled}
        assert outcome.status in allowed, (number, outcome)
        if outcome.result is not None:
            assert outcome.result.error_msg == str(number)

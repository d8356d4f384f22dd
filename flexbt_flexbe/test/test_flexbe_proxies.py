# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's proxies: what FlexBE's own test_proxies.py demands, and what its proxies get wrong."""

from __future__ import annotations

import gc
import threading
import time
import weakref
from collections.abc import Callable
from typing import Any

import pytest
from rclpy.action import CancelResponse
from rclpy.exceptions import InvalidTopicNameException
from std_msgs.msg import Int64, String
from std_srvs.srv import Trigger

from flexbt_common.errors import TopicTypeError
from flexbt_flexbe import (
    QOS_LATCH,
    EventState,
    ProxyActionClient,
    ProxyPublisher,
    ProxyServiceCaller,
    ProxySubscriberCached,
)
from flexbt_flexbe.errors import ProxyError
from flexbt_msgs.action import BtExecute
from flexbt_testing.nodes.scripted_action_server import ends
from flexbt_testing.nodes.state_bench import Run, StateBench
from flexbt_testing.waiting import uncontended_time, wait_until

Goal, Result = BtExecute.Goal, BtExecute.Result
GOOD = Result(code=Result.SUCCESS, message='ok')


class Script(EventState):
    """A state whose callbacks the test gives."""

    def __init__(self, test: Any) -> None:
        super().__init__(outcomes=['done', 'failed'], desired_rate=None)
        self.test = test

    def on_start(self) -> None:
        self.test.start(self)

    def on_enter(self, userdata: Any) -> None:
        self.test.enter(self)

    def execute(self, userdata: Any) -> str | None:
        outcome: str | None = self.test.execute(self)
        return outcome

    def on_exit(self, userdata: Any) -> None:
        self.test.exit(self)


class Steps:
    """Callbacks of a state, all of which do nothing; and what was seen."""

    def __init__(self) -> None:
        self.seen: list[Any] = []

    def start(self, state: Script) -> None: ...

    def enter(self, state: Script) -> None: ...

    def execute(self, state: Script) -> str | None:
        return None

    def exit(self, state: Script) -> None: ...


def run(bench: StateBench, steps: Steps) -> Run:
    return bench.run_state(lambda: Script(steps))


class TestTopics:
    def test_publish_and_subscribe_with_proxies_made_apart(self, bench: StateBench) -> None:
        class Both(Steps):
            def start(self, state: Script) -> None:
                ProxyPublisher({'one': String})
                self.pub = ProxyPublisher({'two': String})
                self.sub = ProxySubscriberCached({'one': String}, inst_id=1)
                self.seen.append((self.pub.is_available('one'), self.pub.is_available('three')))

            def execute(self, state: Script) -> str | None:
                counts = [self.pub.number_of_subscribers(topic) for topic in ('one', 'two')]
                if counts == [0, 0]:
                    state.wake_at(state.clock.now() + 0.01)
                    return None
                if counts == [1, 0]:
                    self.seen.append('one')
                    self.sub = ProxySubscriberCached({'two': 'std_msgs/msg/String'}, inst_id=1)
                    state.wake_at(state.clock.now() + 0.01)
                    return None
                if 'sent' not in self.seen:
                    self.seen.append('sent')
                    self.pub.publish('one', String(data='1'))
                    self.pub.publish('two', String(data='2'))
                if not (self.sub.has_msg('one') and self.sub.has_msg('two')):
                    return None
                self.seen += [self.sub.get_last_msg(topic).data for topic in ('one', 'two')]
                self.sub.remove_last_msg('one')
                self.seen += [self.sub.has_msg('one'), self.sub.get_last_msg('one'), self.sub.has_msg('two')]
                return 'done'

        steps = Both()
        assert run(bench, steps).wait() == 'done'
        assert steps.seen[0] == (True, False)
        assert steps.seen[-6:] == ['sent', '1', '2', False, None, True]

    @pytest.mark.parametrize('topic', ['taken', 'a b', '7'])
    def test_a_topic_that_cannot_be_subscribed_is_told_and_is_not_subscribed(
        self, bench: StateBench, topic: str
    ) -> None:
        class Hearing(Steps):
            def start(self, state: Script) -> None:
                proxy = ProxySubscriberCached()
                with pytest.raises((TopicTypeError, InvalidTopicNameException)):
                    proxy.subscribe(topic, String)
                self.seen.append(proxy.is_available(topic))

            def execute(self, state: Script) -> str:
                return 'done'

        bench.runtime.call(lambda: bench.runtime.node.create_publisher(Int64, 'taken', 1))
        steps = Hearing()
        assert run(bench, steps).wait() == 'done'
        assert steps.seen == [False]

    def test_a_message_that_comes_with_the_subscription_reaches_callback_and_buffer(
        self, bench: StateBench, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        class Hearing(Steps):
            def start(self, state: Script) -> None:
                proxy = ProxySubscriberCached()
                proxy.subscribe('map', String, self.seen.append, buffered=True, qos=QOS_LATCH)
                self.seen.append(proxy.get_from_buffer('map'))

            def execute(self, state: Script) -> str:
                return 'done'

        latched = String(data='latched')
        monkeypatch.setattr(
            bench.runtime.node, 'create_subscription', lambda kind, topic, receive, qos: receive(latched)
        )
        steps = Hearing()
        assert run(bench, steps).wait() == 'done'
        assert steps.seen == [latched, latched]

    def test_a_buffer_is_first_in_first_out(self, bench: StateBench) -> None:
        class Buffered(Steps):
            def start(self, state: Script) -> None:
                self.pub = ProxyPublisher({'numbers': Int64})
                self.sub = ProxySubscriberCached({'numbers': Int64})
                self.sub.enable_buffer('numbers')

            def enter(self, state: Script) -> None:
                self.sent = False

            def execute(self, state: Script) -> str | None:
                if not self.pub.number_of_subscribers('numbers'):
                    state.wake_at(state.clock.now() + 0.01)
                    return None
                if not self.sent:
                    self.sent = True
                    for number in (1, 2, 3):
                        self.pub.publish('numbers', Int64(data=number))
                while self.sub.has_buffered('numbers'):
                    self.seen.append(self.sub.get_from_buffer('numbers').data)
                if len(self.seen) < 3:
                    return None
                self.seen.append(self.sub.get_from_buffer('numbers'))
                return 'done'

        steps = Buffered()
        assert run(bench, steps).wait() == 'done'
        assert steps.seen == [1, 2, 3, None]

    def test_a_message_wakes_the_state_that_asked_for_it(self, bench: StateBench) -> None:
        """FlexBE finds it at the next tick: 50 ms later on average at its default rate. This one has no rate at all."""

        class Waiting(Steps):
            def start(self, state: Script) -> None:
                self.sub = ProxySubscriberCached({'news': String})

            def execute(self, state: Script) -> str | None:
                if not self.sub.has_msg('news'):
                    return None
                self.seen.append(time.monotonic())
                return 'done'

        steps = Waiting()
        going = run(bench, steps)
        wait_until(going.active, 'active')
        node = bench.runtime.node
        publisher = bench.runtime.call(lambda: node.create_publisher(String, 'news', 10))
        wait_until(lambda: publisher.get_subscription_count() == 1, 'matched')
        publisher.publish(String(data='now'))
        assert going.wait() == 'done'

    def test_a_callback_hears_each_message_and_may_log(self, bench: StateBench) -> None:
        from flexbt_flexbe import Logger

        class Hearing(Steps):
            def enter(self, state: Script) -> None:
                self.pub = ProxyPublisher({'calls': String})
                self.sub = ProxySubscriberCached()
                self.sub.subscribe('calls', String, callback=self.hear)

            def hear(self, message: Any) -> None:
                Logger.loginfo('heard %s', message.data)
                self.seen.append(message.data)

            def execute(self, state: Script) -> str | None:
                if self.seen:
                    return 'done'
                if self.pub.number_of_subscribers('calls'):
                    self.pub.publish('calls', String(data='x'))
                state.wake_at(state.clock.now() + 0.02)
                return None

        going = run(bench, Hearing())
        assert going.wait() == 'done'
        assert 'heard x' in [text for _, _, text in going.lines]

    def test_what_a_run_has_opened_is_closed_with_it(self, bench: StateBench) -> None:
        class Opening(Steps):
            def execute(self, state: Script) -> str:
                ProxyPublisher({'mine': String})
                ProxySubscriberCached({'mine': String})
                return 'done'

        node = bench.runtime.node
        for _ in range(2):
            assert run(bench, Opening()).wait() == 'done'
        wait_until(
            lambda: (
                bench.runtime.call(lambda: (node.count_publishers('mine'), node.count_subscribers('mine'))) == (0, 0)
            ),
            'closed',
        )

    def test_the_last_instance_that_unsubscribes_ends_the_subscription(self, bench: StateBench) -> None:
        class Leaving(Steps):
            def execute(self, state: Script) -> str:
                sub = ProxySubscriberCached({'shared': String}, inst_id='a')
                ProxySubscriberCached({'shared': String}, inst_id='b')
                sub.unsubscribe_topic('shared', inst_id='a')
                self.seen.append(sub.is_available('shared'))
                sub.unsubscribe_topic('shared', inst_id='b')
                self.seen.append(sub.is_available('shared'))
                return 'done'

        steps = Leaving()
        assert run(bench, steps).wait() == 'done'
        assert steps.seen == [True, False]

    def test_each_proxy_has_its_own_subscription_and_callback(self, bench: StateBench) -> None:
        """As in FlexBE 4; two states of one behavior may use the same topic."""

        heard: list[int] = []

        class Both(Steps):
            def start(self, state: Script) -> None:
                self.pub = ProxyPublisher({'shared': String})
                self.proxies: list[Any] = [ProxySubscriberCached(), ProxySubscriberCached(), state._sub]
                for number, proxy in enumerate(self.proxies):
                    proxy.subscribe('shared', String, callback=lambda _, number=number: heard.append(number))

            def execute(self, state: Script) -> str | None:
                if len(heard) < 3:
                    if self.pub.number_of_subscribers('shared'):
                        self.pub.publish('shared', String())
                    state.wake_at(state.clock.now() + 0.02)
                    return None
                for proxy in (*self.proxies[:2], state._sub):
                    self.seen.append(proxy.is_available('shared'))
                    proxy.unsubscribe_topic('shared')
                self.seen.append(self.proxies[0].is_available('shared'))
                return 'done'

        steps = Both()
        assert run(bench, steps).wait() == 'done'
        assert heard[:3] == [0, 1, 2]
        assert steps.seen == [True, True, True, False]

    def test_methods_may_be_called_on_the_class(self, bench: StateBench) -> None:
        class Classy(Steps):
            def execute(self, state: Script) -> str:
                subscribe: Any = ProxySubscriberCached.subscribe
                subscribe('classy', String)
                available: Any = ProxySubscriberCached.is_available
                self.seen.append(available('classy'))
                unsubscribe: Any = ProxySubscriberCached.unsubscribe_topic
                unsubscribe('classy')
                self.seen.append(available('classy'))
                create: Any = ProxyPublisher.create_publisher
                create('classy', String)
                self.seen.append(ProxyPublisher().is_available('classy'))
                return 'done'

        steps = Classy()
        assert run(bench, steps).wait() == 'done'
        assert steps.seen == [True, False, True]

    @pytest.mark.parametrize(
        ('use', 'words'),
        [
            (lambda: ProxyPublisher().publish('nowhere', String()), 'createPublisher'),
            (lambda: ProxyPublisher({'p': String}).publish('p', Int64()), 'String'),
            (lambda: (ProxyPublisher({'q': String}), ProxyPublisher({'q': Int64})), 'already'),
            (lambda: (ProxySubscriberCached({'r': String}), ProxySubscriberCached({'r': Int64})), 'already'),
            (lambda: ProxySubscriberCached({'s': 'std_msgs/msg/Strin'}), 'std_msgs/msg/Strin'),
            (lambda: ProxySubscriberCached({'t': int}), 'neither a message class'),
        ],
    )
    def test_differs_misuse_is_an_error_that_the_operator_sees(
        self, bench: StateBench, use: Callable[[], Any], words: str
    ) -> None:
        """FlexBE drops such messages with a line in the log."""

        class Misusing(Steps):
            def execute(self, state: Script) -> str:
                use()
                return 'done'

        going = run(bench, Misusing())
        assert going.wait() == 'failed'
        assert words in going.errors()


class TestServices:
    @staticmethod
    def serve(bench: StateBench, name: str, answer: Callable[[], None]) -> None:
        def callback(request: Any, response: Any) -> Any:
            answer()
            response.success, response.message = True, 'ok'
            return response

        # A node of its own: the bench's own thread must stay free.
        from flexbt_common.runtime.node_runtime import NodeRuntime

        runtime = NodeRuntime('service_server', args=())
        runtime.call(lambda: runtime.node.create_service(Trigger, name, callback))
        bench.closing.append(runtime.close)

    def test_a_request_is_answered_and_wakes_the_state(self, bench: StateBench) -> None:
        class Calling(Steps):
            def enter(self, state: Script) -> None:
                self.srv = ProxyServiceCaller({'ask': Trigger})
                self.srv.call_async('ask', Trigger.Request())

            def execute(self, state: Script) -> str | None:
                if not self.srv.done('ask'):
                    return None
                result = self.srv.result('ask')
                self.seen.append((result.success, result.message))
                return 'done'

        self.serve(bench, 'ask', lambda: None)
        steps = Calling()
        assert run(bench, steps).wait() == 'done'
        assert steps.seen == [(True, 'ok')]

    def test_a_service_that_is_not_there_is_not_waited_for(self, bench: StateBench) -> None:
        class Looking(Steps):
            def execute(self, state: Script) -> str:
                begin = uncontended_time()
                srv = ProxyServiceCaller({'missing': Trigger}, wait_duration=10)
                self.seen.append([srv.is_available('missing', wait_duration=10), srv.is_available('unknown')])
                self.seen.append(uncontended_time() - begin)
                return 'done'

        steps = Looking()
        assert run(bench, steps).wait() == 'done'
        assert steps.seen[0] == [False, False]
        assert steps.seen[1] < 1.0

    def test_a_blocking_call_has_a_deadline(self, bench: StateBench) -> None:
        class Blocking(Steps):
            def execute(self, state: Script) -> str:
                srv = ProxyServiceCaller({'late': Trigger})
                begin = uncontended_time()
                try:
                    srv.call('late', Trigger.Request(), wait_duration=0.1)
                except ProxyError as error:
                    self.seen.append(str(error))
                self.seen.append(uncontended_time() - begin)
                return 'done'

        steps = Blocking()
        assert run(bench, steps).wait() == 'done'
        assert "no service 'late'" in steps.seen[0]
        assert steps.seen[1] < 5

    def test_a_blocking_call_gives_the_response(self, bench: StateBench) -> None:
        class Blocking(Steps):
            def execute(self, state: Script) -> str:
                srv = ProxyServiceCaller({'now': Trigger})
                self.seen.append(srv.call('now', Trigger.Request()).message)
                return 'done'

        self.serve(bench, 'now', lambda: None)
        steps = Blocking()
        assert run(bench, steps).wait() == 'done'
        assert steps.seen == ['ok']

    def test_differs_a_request_without_an_answer_is_no_empty_response(self, bench: StateBench) -> None:
        class Hoping(Steps):
            def enter(self, state: Script) -> None:
                self.srv = ProxyServiceCaller({'nobody': Trigger})
                self.srv.call_async('nobody', Trigger.Request(), wait_duration=0.0)

            def execute(self, state: Script) -> str | None:
                return 'done' if self.srv.done('nobody') and self.srv.result('nobody').success else None

        going = run(bench, Hoping())
        assert going.wait() == 'failed'
        assert "no service 'nobody'" in going.errors()


class Sending(Steps):
    """Sends a goal when the state is entered, and takes what comes back; cancels on exit as FlexBE's states do."""

    topic = 'work'

    def start(self, state: Script) -> None:
        self.client = ProxyActionClient({self.topic: BtExecute})

    def enter(self, state: Script) -> None:
        self.seen.append(self.client.has_result(self.topic))
        self.client.send_goal(self.topic, Goal())

    def execute(self, state: Script) -> str | None:
        if not self.client.has_result(self.topic):
            return None
        self.seen.append(self.client.get_result(self.topic).message)
        return 'done'

    def exit(self, state: Script) -> None:
        if self.client.is_active(self.topic):
            self.client.cancel(self.topic)


class TestActions:
    def test_a_goal_gives_its_result_and_another_one_can_follow(self, bench: StateBench) -> None:
        class Twice(Sending):
            def execute(self, state: Script) -> str | None:
                if super().execute(state) is None:
                    return None
                self.seen.append((self.client.is_active(self.topic), self.client.get_status(self.topic)))
                self.seen.append(self.client.get_status_string(self.topic))
                self.client.get_result(self.topic, clear=True)
                if self.client.has_result(self.topic) or self.client.get_result(self.topic) is not None:
                    return 'failed'
                if len(self.seen) < 6:
                    self.client.send_goal(self.topic, Goal())
                    self.seen.append(self.client.verify_action_status(self.topic))
                    return None
                self.seen.append(self.client.verify_action_status(self.topic))
                return 'done'

        server = bench.serve(BtExecute, 'work', ends(GOOD))
        steps = Twice()
        assert run(bench, steps).wait() == 'done'
        ended = ['ok', (False, 4), 'SUCCEEDED']
        assert steps.seen == [False, *ended, (False, 0), *ended, (True, 4)]
        assert len(server.goals) == 2

    def test_a_client_that_was_removed_is_kept_no_longer(self, bench: StateBench) -> None:
        class Removing(Steps):
            def enter(self, state: Script) -> None:
                client = ProxyActionClient({'work': BtExecute, 'other': BtExecute})
                self.seen += [weakref.ref(client._clients[topic]) for topic in ('work', 'other')]
                client.remove_client('work')

            def execute(self, state: Script) -> str:
                gc.collect()
                self.seen = [one() is not None for one in self.seen]
                return 'done'

        steps = Removing()
        assert run(bench, steps).wait() == 'done'
        assert steps.seen == [False, True]  # the other one is that of the run

    def test_feedback_wakes_the_state(self, bench: StateBench) -> None:
        async def script(goal_handle: Any) -> Any:
            goal_handle.publish_feedback(BtExecute.Feedback(active_nodes=['Node']))
            await released
            goal_handle.succeed()
            return GOOD

        class Listening(Sending):
            def execute(self, state: Script) -> str | None:
                if self.client.has_feedback(self.topic) and len(self.seen) == 1:
                    self.seen.append(list(self.client.get_feedback(self.topic, clear=True).feedback.active_nodes))
                    assert not self.client.has_feedback(self.topic)
                    server.resolve(released)
                return super().execute(state)

        server = bench.serve(BtExecute, 'work', lambda handle: script(handle))
        released = server.future()
        steps = Listening()
        assert run(bench, steps).wait() == 'done'
        assert steps.seen == [False, ['Node'], 'ok']

    def test_feedback_on_a_goal_that_another_has_replaced_is_not_that_of_the_new_one(self, bench: StateBench) -> None:
        async def script(goal_handle: Any) -> Any:
            name = goal_handle.request.behavior_tree
            goal_handle.publish_feedback(BtExecute.Feedback(active_nodes=[name]))
            if name == 'old':
                await released
                goal_handle.publish_feedback(BtExecute.Feedback(active_nodes=['late']))
                goal_handle.abort()
                server.resolve(gone)
            else:
                await gone
                goal_handle.publish_feedback(BtExecute.Feedback(active_nodes=['last']))
                goal_handle.succeed()
            return GOOD

        class Replacing(Steps):
            topic = 'work'

            def start(self, state: Script) -> None:
                self.client = ProxyActionClient({self.topic: BtExecute})

            def enter(self, state: Script) -> None:
                self.client.send_goal(self.topic, Goal(behavior_tree='old'))

            def execute(self, state: Script) -> str | None:
                if self.client.has_feedback(self.topic):
                    feedback = self.client.get_feedback(self.topic, clear=True).feedback
                    self.seen += feedback.active_nodes
                    if self.seen == ['old']:
                        self.client.cancel(self.topic)
                        self.client.send_goal(self.topic, Goal(behavior_tree='new'))
                    elif self.seen == ['old', 'new']:
                        server.resolve(released)
                return 'done' if self.client.has_result(self.topic) else None

        server = bench.serve(BtExecute, 'work', lambda handle: script(handle))
        released, gone = server.future(), server.future()
        steps = Replacing()
        assert run(bench, steps).wait() == 'done'
        assert steps.seen[:2] == ['old', 'new'] and 'late' not in steps.seen

    def test_two_states_with_the_same_action_have_goals_of_their_own(self, bench: StateBench) -> None:
        """In FlexBE the second overwrites the result of the first."""

        class Crossed(Sending):
            def start(self, state: Script) -> None:
                super().start(state)
                self.other = ProxyActionClient({self.topic: BtExecute})

            def execute(self, state: Script) -> str | None:
                outcome = super().execute(state)
                if outcome == 'done':
                    self.seen.append((self.other.has_result(self.topic), self.other.is_active(self.topic)))
                return outcome

        bench.serve(BtExecute, 'work', ends(GOOD))
        steps = Crossed()
        assert run(bench, steps).wait() == 'done'
        assert steps.seen[-1] == (False, False)

    def test_a_result_is_forgotten_as_states_of_flexible_navigation_do(self, bench: StateBench) -> None:
        class Forgetting(Sending):
            def execute(self, state: Script) -> str | None:
                outcome = super().execute(state)
                if outcome == 'done':
                    other = ProxyActionClient({'other': BtExecute})
                    self.seen += ['work' in ProxyActionClient._result, 'other' in ProxyActionClient._result]
                    ProxyActionClient._result['work'] = ProxyActionClient._result['other'] = None
                    self.seen += [self.client.has_result('work'), other.has_result('other')]
                    with pytest.raises(ProxyError, match='only None may be written'):
                        ProxyActionClient._result['work'] = GOOD
                return outcome

        bench.serve(BtExecute, 'work', ends(GOOD))
        steps = Forgetting()
        assert run(bench, steps).wait() == 'done'
        assert steps.seen == [False, 'ok', True, False, False, False]

    def test_differs_a_goal_that_was_aborted_without_a_word_has_no_result(self, bench: StateBench) -> None:
        """FlexBE gives the zeros of the message, which mean success to many."""
        bench.serve(BtExecute, 'work', ends(Result(), 'abort'))
        going = run(bench, Sending())
        assert going.wait() == 'failed'
        assert "action 'work'" in going.errors() and 'aborted' in going.errors()

    def test_an_aborted_goal_that_says_why_has_a_result(self, bench: StateBench) -> None:
        bench.serve(BtExecute, 'work', ends(Result(code=Result.FAILURE, message='because'), 'abort'))
        steps = Sending()
        assert run(bench, steps).wait() == 'done'
        assert steps.seen == [False, 'because']

    def test_differs_a_rejected_goal_is_a_fault_and_not_a_result(self, bench: StateBench) -> None:
        bench.serve(BtExecute, 'work', ends(GOOD), accept=lambda _goal: False)
        going = run(bench, Sending())
        assert going.wait() == 'failed'
        assert 'rejected' in going.errors()

    def test_differs_a_server_that_is_not_there_ends_the_wait(self, bench: StateBench) -> None:
        going = run(bench, Sending())
        begin = uncontended_time()
        assert going.wait() == 'failed'
        assert uncontended_time() - begin < 6
        assert "no action server 'work'" in going.errors()

    def test_once_it_is_known_that_there_is_no_server_sending_says_so_as_in_flexbe(self, bench: StateBench) -> None:
        class Late(Sending):
            def enter(self, state: Script) -> None:
                state.wake_at(state.clock.now() + 2.1)

            def execute(self, state: Script) -> str | None:
                if state.clock.now() < self.begin + 2.1:
                    return None
                try:
                    self.client.send_goal(self.topic, Goal())
                except ValueError as error:
                    self.seen.append(str(error))
                return 'done'

            def start(self, state: Script) -> None:
                super().start(state)
                self.begin = state.clock.now()

        steps = Late()
        assert run(bench, steps).wait() == 'done'
        assert "no action server 'work'" in steps.seen[0]

    def test_a_stop_cancels_the_goal_and_waits_for_its_end(self, bench: StateBench) -> None:
        """FlexBE does not call on_exit when it is stopped, so that the goal goes on."""

        async def script(goal_handle: Any) -> Any:
            await canceled
            goal_handle.canceled()
            return Result()

        def on_cancel(_: Any) -> CancelResponse:
            threading.Timer(0.1, lambda: server.resolve(canceled)).start()
            return CancelResponse.ACCEPT

        class Forgetful(Sending):
            def exit(self, state: Script) -> None:
                self.seen.append('exit')

        server = bench.serve(BtExecute, 'work', lambda handle: script(handle), on_cancel=on_cancel)
        canceled = server.future()
        steps = Forgetful()
        going = run(bench, steps)
        wait_until(lambda: server.running, 'goal accepted')
        assert going.stop() == 'preempted'
        assert (len(server.running), server.cancels, going.message) == (0, 1, 'test')
        assert steps.seen[-1] == 'exit'

    def test_differs_a_second_goal_while_one_is_active_is_refused(self, bench: StateBench) -> None:
        class Greedy(Sending):
            def execute(self, state: Script) -> str | None:
                self.client.send_goal(self.topic, Goal())
                return None

        server = bench.serve(BtExecute, 'work', lambda handle: wait(handle))
        released = server.future()

        async def wait(handle: Any) -> Any:
            await released
            handle.canceled() if handle.is_cancel_requested else handle.succeed()
            return GOOD

        def on_cancel(_: Any) -> CancelResponse:
            server.resolve(released)
            return CancelResponse.ACCEPT

        server.on_cancel = on_cancel
        going = run(bench, Greedy())
        assert going.wait() == 'failed'
        assert 'still active' in going.errors()
        wait_until(lambda: not server.running, 'the goal has ended')

    @pytest.mark.parametrize(
        ('use', 'words'),
        [
            (lambda client: client.send_goal('unknown', Goal()), "'unknown' was not set up"),
            (lambda client: client.send_goal('work', Result()), 'Goal'),
            (lambda client: client.get_state('unknown'), "'unknown' was not set up"),
            (lambda client: client.setupClient('work', Trigger), 'already'),
        ],
    )
    def test_misuse_names_the_action(self, bench: StateBench, use: Callable[[Any], None], words: str) -> None:
        class Misusing(Sending):
            def enter(self, state: Script) -> None:
                use(self.client)

        going = run(bench, Misusing())
        assert going.wait() == 'failed'
        assert words in going.errors()

    def test_unknown_actions_have_nothing(self, bench: StateBench) -> None:
        class Asking(Sending):
            def enter(self, state: Script) -> None:
                client = self.client
                self.seen.append(
                    [
                        client.is_available('unknown'),
                        client.has_result('unknown'),
                        client.get_result('unknown'),
                        client.has_feedback('unknown'),
                        client.is_active('unknown'),
                        client.is_available('work'),
                    ]
                )
                client.cancel('unknown')

            def execute(self, state: Script) -> str:
                return 'done'

        steps = Asking()
        assert run(bench, steps).wait() == 'done'
        assert steps.seen == [[False, False, None, False, False, False]]


def test_proxies_belong_to_a_run() -> None:
    for make in (ProxyActionClient, ProxyPublisher, ProxyServiceCaller, ProxySubscriberCached):
        with pytest.raises(Exception, match='only where a behavior is built or run'):
            make()


def test_runs_on_two_nodes_of_a_process_do_not_meet(bench: StateBench) -> None:
    """FlexBE keeps node and proxies in class attributes: one behavior in each process."""

    class Node(Steps):
        def start(self, state: Script) -> None:
            self.pub = ProxyPublisher({'each': String})
            self.seen += [Script._node, state._node]

        def execute(self, state: Script) -> str:
            return 'done'

    other = StateBench()
    try:
        first, second = Node(), Node()
        runs = [run(bench, first), run(other, second)]
        assert [one.wait() for one in runs] == ['done', 'done']
        assert (first.seen, second.seen) == ([bench.runtime.node] * 2, [other.runtime.node] * 2)
    finally:
        other.close()

# SPDX-License-Identifier: BSD-3-Clause
"""The executor thread, its survival of faults, and the end of a process."""

from __future__ import annotations

import queue
import signal
import threading
import time
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from ament_index_python.packages import get_package_share_directory
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue, SetParametersResult
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.task import Future as Awaited
from std_msgs.msg import Empty, UInt8MultiArray

from flexbt_common.calls.service_call import ServiceLinks, service_outcome
from flexbt_common.errors import TopicTypeError, UnfitParameterError
from flexbt_common.lifecycle.managed_node import ExtendedLifecycleNode
from flexbt_common.middleware import rclpy_private
from flexbt_common.middleware.fastdds import FAST_DDS
from flexbt_common.middleware.implementation import implementation
from flexbt_common.runtime.node_executor import NodeExecutor
from flexbt_common.runtime.node_runtime import LargeQueueNode, NodeRuntime, run_node
from flexbt_common.runtime.parameters import ParameterDeclarer, unknown_parameters
from flexbt_testing.system.python_processes import PythonProcess, python_process
from flexbt_testing.waiting import DEADLINE, uncontended_time, wait_until

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)

PROGRAM = """
import sys
import time
from flexbt_common.runtime.node_runtime import run_node
from std_msgs.msg import UInt8MultiArray

def setup(runtime):
    if 'fail' in sys.argv:
        raise ValueError('no map given; set parameter map')
    if 'no_file' in sys.argv:
        open('missing.yaml')
    if 'stuck' in sys.argv:
        runtime.on_close(lambda: time.sleep(60))
    if 'fleet' in sys.argv:
        runtime.node.destroy_node = lambda: time.sleep(60)
    if 'failing' in sys.argv:
        runtime.fail('the disk is full')
    if 'raising' in sys.argv:
        runtime.on_close(lambda: 1 / 0)
    if 'exit' in sys.argv:
        runtime.node.create_timer(0.2, lambda: sys.exit(0))
    if 'interrupt' in sys.argv:
        def interrupt():
            raise KeyboardInterrupt('by a callback')
        runtime.post(interrupt)
    if 'shutdown' in sys.argv:
        runtime.post(runtime.node.context.shutdown)
    if 'abort' in sys.argv:
        runtime.abort('the world has come to its end')
    if 'telling' in sys.argv:
        report = runtime.node.create_publisher(UInt8MultiArray, 'report', 1)
        while not report.get_subscription_count():
            time.sleep(0.01)
        runtime.on_close(lambda: report.publish(UInt8MultiArray(data=bytes(2_000_000))))
    runtime.on_close(lambda: runtime.call(lambda: None))
    runtime.node.create_timer(0.01, lambda: None)
    runtime.node.declare_parameter('speed', 1.0)
    print('ready', runtime.node.get_fully_qualified_name(), runtime.node.get_parameter('speed').value, flush=True)

NOT_FOR_ROS = 'fail no_file stuck fleet telling failing raising exit interrupt shutdown abort'.split()
how = [word for word in sys.argv[1:] if word not in NOT_FOR_ROS]
sys.exit(run_node('program', setup, how, about='Drives the robot.'))
"""


@pytest.mark.dds('it is about Fast DDS')
@pytest.mark.skipif(implementation() != FAST_DDS, reason='needs Fast DDS')
def test_a_topic_of_another_type_is_refused_with_both_types() -> None:
    with NodeRuntime.open('clock', parameters={'use_sim_time': True}) as runtime:
        node, told = runtime.node, '/clock has the type rosgraph_msgs/msg/Clock .* std_msgs/msg/Empty'
        for create in (
            partial(node.create_subscription, Empty, '/clock', print, 1),
            partial(node.create_publisher, Empty, '/clock', 1),
        ):
            with pytest.raises(TopicTypeError, match=told):
                runtime.call(create)


def test_what_is_posted_for_later_is_not_run_when_it_is_cancelled_though_it_is_due() -> None:
    run: list[str] = []
    with NodeRuntime.open('posting') as runtime:

        def hold_up() -> None:
            runtime.post_in(0.05, lambda: run.append('kept'))
            timer = runtime.post_in(0.05, lambda: run.append('cancelled'))
            time.sleep(0.2)
            assert not run
            timer.cancel()

        runtime.call(hold_up)
        wait_until(lambda: run, 'what is not cancelled')
        runtime.call(lambda: None)
        assert run == ['kept']


def test_an_executor_that_waits_as_usual_is_not_woken_to_show_that_it_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[str] = []
    with NodeRuntime.open('resting') as runtime:
        post = runtime.post

        def note(fn: Callable[[], object]) -> None:
            seen.append('post')
            post(fn)

        monkeypatch.setattr(runtime, 'post', note)
        runtime.health.on_beat(lambda: seen.append('beat'))
        wait_until(lambda: ('beat', 'beat') in pairwise(seen), 'an answer without a call')
        monkeypatch.setattr(NodeExecutor, 'is_resting', False)  # its wait takes too long
        wait_until(lambda: seen[-2:] == ['post', 'beat'], 'an answer to a call')


def test_posted_work_runs_in_order_on_the_executor_thread() -> None:
    with NodeRuntime.open('order') as runtime:
        seen: list[int] = []
        threads: set[bool] = set()
        done = threading.Event()

        def note(number: int) -> None:
            seen.append(number)
            threads.add(runtime.on_executor_thread)

        for number in range(200):
            runtime.post(partial(note, number))
        runtime.post(done.set)
        assert done.wait(DEADLINE)
        assert seen == list(range(200))
        assert threads == {True}


def test_what_has_time_is_called_when_the_executor_is_awake_and_else_at_the_end_of_its_time() -> None:
    with NodeRuntime.open('patient') as runtime:
        now, called = runtime.steady.now(), queue.Queue[str]()
        runtime.call(lambda: runtime.call_near(now + 1e3, 2e3, partial(called.put, 'in a minute or two')))
        assert called.get(timeout=DEADLINE) == 'in a minute or two'  # this call has woken it
        runtime.call(lambda: runtime.call_near(now + 1e3, 10.0, partial(called.put, 'later')))
        runtime.call(lambda: runtime.call_near(now, 0.05, partial(called.put, 'soon')))
        runtime.run_or_post(lambda: runtime.call_near(now, 0.1, partial(called.put, 'lent')))  # on this thread
        assert {called.get(timeout=DEADLINE) for _ in range(2)} == {'soon', 'lent'}
        faults: list[BaseException] = []
        runtime.on_fault(faults.append)
        calls: list[int] = []

        def fail_again() -> None:
            calls.append(0)
            raise ZeroDivisionError

        runtime.call(lambda: runtime.repeat_near(1e-3, 0.0, fail_again))
        wait_until(lambda: len(calls) > 2, 'three calls')
        assert [type(fault) for fault in faults] == [ZeroDivisionError]  # the others are of the same kind


def test_what_may_run_on_the_thread_that_asks_comes_after_what_that_thread_has_posted() -> None:
    with NodeRuntime.open('ordered') as runtime:
        order: list[int] = []
        for number in range(0, 200, 2):
            runtime.post(partial(order.append, number))
            runtime.run_or_post(partial(order.append, number + 1))
        runtime.call(lambda: None)
        assert order == list(range(200))


def test_nothing_that_is_posted_gets_lost_with_the_ring_of_the_bell(monkeypatch: pytest.MonkeyPatch) -> None:
    runtime = NodeRuntime('deaf', args=[])
    trigger = runtime._doorbell.trigger
    other = runtime.call(lambda: runtime.node.create_guard_condition(lambda: None))

    def lose() -> None:
        # As rmw_fastrtps does now and then: the wait ends, for another reason, and the trigger is gone.
        if runtime.on_executor_thread:
            trigger()
        else:
            other.trigger()

    monkeypatch.setattr(runtime._doorbell, 'trigger', lose)
    for number in range(200):
        assert runtime.call(partial(int, number)) == number
    closing = threading.Thread(target=runtime.close, daemon=True)
    closing.start()
    closing.join(DEADLINE)
    assert not closing.is_alive()


GARBAGE = """
import gc
import weakref
from flexbt_common.runtime.node_runtime import NodeRuntime

class Link:
    def __init__(self):
        self.me = self

collected, links = [], []
with NodeRuntime.open('collecting') as runtime:
    gc.collect()
    gc.set_threshold(1)
    for _ in range(1000):
        links.append(weakref.finalize(Link(), runtime.post, lambda: collected.append(1)))
        links[-1].atexit = False
        runtime.post(lambda: None)
    while any(link.alive for link in links):  # none is collected here while another thread collects
        gc.collect()
    runtime.call(lambda: print(len(collected), flush=True))
"""


@pytest.mark.dds('another process takes part')
def test_what_is_collected_as_garbage_while_something_is_posted_may_post_too() -> None:
    with python_process(['-c', GARBAGE]) as process:
        out, err = process.communicate(timeout=DEADLINE)
    assert (out, process.returncode) == ('1000\n', 0), err


def test_call_gives_the_value_or_the_error_and_works_on_the_executor_thread_too() -> None:
    with NodeRuntime.open('caller') as runtime:
        assert runtime.call(lambda: 7) == 7
        assert runtime.call(lambda: runtime.call(lambda: 8)) == 8
        with pytest.raises(KeyError):
            runtime.call(lambda: dict[str, int]()['x'])
        release = threading.Event()
        runtime.post(lambda: release.wait(DEADLINE))
        with pytest.raises(TimeoutError, match=r'of node caller did not get to \S+\.<lambda> within 0\.'):
            runtime.call(lambda: 9, timeout=0.05)
        release.set()
    with pytest.raises(RuntimeError, match='closed'):
        runtime.call(lambda: 1)
    runtime.post(lambda: None)  # harmless


def test_a_caller_is_not_left_waiting_when_the_runtime_is_closed() -> None:
    runtime = NodeRuntime('closing', args=[])
    entered, release = threading.Event(), threading.Event()

    def block() -> None:
        entered.set()
        release.wait(DEADLINE)

    runtime.post(block)
    assert entered.wait(DEADLINE)
    results: list[object] = []

    def caller() -> None:
        try:
            results.append(runtime.call(lambda: 'ran', timeout=DEADLINE))
        except RuntimeError as error:
            results.append(error)

    waiting = threading.Thread(target=caller)
    waiting.start()
    closing = threading.Thread(target=runtime.close)
    closing.start()
    release.set()
    closing.join(DEADLINE)
    waiting.join(DEADLINE)
    assert len(results) == 1


def test_faults_of_callbacks_are_reported_and_the_executor_goes_on() -> None:
    with NodeRuntime.open('faulty') as runtime:
        faults: list[str] = []
        runtime.on_fault(lambda error: faults.append(str(error)))

        def raising(text: str) -> None:
            raise ValueError(text)

        arrived = threading.Event()

        def on_message(message: Empty) -> None:
            arrived.set()
            raise ValueError('message')

        def setup() -> None:
            runtime.node.create_subscription(Empty, 'topic', on_message, 1)
            publisher = runtime.node.create_publisher(Empty, 'topic', 1)
            runtime.node.create_timer(0.01, lambda: raising('timer'))
            runtime.node.create_timer(0.02, lambda: publisher.publish(Empty()))

        runtime.call(setup)
        runtime.post(lambda: raising('posted'))
        runtime.clock.call_at(runtime.clock.now(), lambda: raising('alarm'))
        runtime.steady.call_at(runtime.steady.now(), lambda: raising('steady'))
        assert arrived.wait(DEADLINE)
        wait_until(lambda: {'timer', 'posted', 'alarm', 'steady', 'message'} <= set(faults), lambda: faults)
        assert runtime.call(lambda: 'alive') == 'alive'


def test_components_are_closed_in_reverse_order_while_callbacks_run() -> None:
    closed: list[object] = []
    with NodeRuntime.open('components') as runtime:
        runtime.on_close(lambda: closed.append('first'))
        runtime.on_close(lambda: closed.append(runtime.call(lambda: 'second')))
        runtime.on_close(lambda: 1 / 0)
    assert closed == ['second', 'first']
    runtime.close()


def start(*arguments: str) -> PythonProcess:
    return python_process(['-c', PROGRAM, *arguments])


@pytest.mark.dds('another process takes part')
@pytest.mark.parametrize(
    'signals', [[signal.SIGINT], [signal.SIGTERM], [signal.SIGINT] * 3, [signal.SIGTERM, signal.SIGINT]]
)
def test_a_signal_ends_the_process_in_time_without_traceback(signals: list[signal.Signals]) -> None:
    with start() as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith('ready')
        began = uncontended_time()
        for number in signals:
            process.send_signal(number)
        out, err = process.communicate(timeout=DEADLINE)
        assert process.returncode == 0, err
        assert uncontended_time() - began < 2.0
        assert (out, err) == ('', '')


@pytest.mark.dds('another process takes part')
def test_a_component_that_does_not_end_cannot_keep_the_process() -> None:
    with start('stuck') as process:
        assert process.stdout is not None
        process.stdout.readline()
        began = uncontended_time()
        process.terminate()
        _, err = process.communicate(timeout=DEADLINE)
        assert process.returncode == 1
        assert uncontended_time() - began < 2.0
        assert 'did not come to an end' in err and 'Traceback' not in err


@pytest.mark.dds('another process takes part')
def test_a_process_with_too_many_nodes_to_take_back_leaves_in_time_and_in_order() -> None:
    with start('fleet') as process:
        assert process.stdout is not None
        process.stdout.readline()
        began = uncontended_time()
        process.terminate()
        _, err = process.communicate(timeout=DEADLINE)
        assert (process.returncode, err) == (0, '')
        assert uncontended_time() - began < 2.0


@pytest.mark.dds('another process takes part')
def test_what_a_node_tells_as_its_last_is_received_though_it_takes_many_packets() -> None:
    got: list[int] = []
    with NodeRuntime.open('reader') as reader:
        told = partial(
            reader.node.create_subscription, UInt8MultiArray, 'report', lambda one: got.append(len(one.data)), 1
        )
        reader.call(told)
        with start('telling') as process:
            assert process.stdout is not None
            process.stdout.readline()
            process.terminate()
            _, err = process.communicate(timeout=DEADLINE)
            assert (process.returncode, err) == (0, '')
        wait_until(lambda: got == [2_000_000], 'the last message of the node')


def test_runtimes_that_end_together_come_to_rest_before_any_of_them_is_gone() -> None:
    told: list[tuple[str, str]] = []
    with NodeRuntime.open('first') as first:
        first.further += [NodeRuntime('second', args=()), NodeRuntime('third', args=())]

        def tell(name: str) -> None:
            told.append((name, first.further[-1].call(lambda: 'there')))

        for runtime in (first, *first.further):
            runtime.on_close(partial(tell, runtime.name))
    assert told == [('third', 'there'), ('second', 'there'), ('first', 'there')]
    assert all(runtime.closed for runtime in first.further)


@pytest.mark.dds('another process takes part')
@pytest.mark.parametrize(('word', 'told'), [('failing', 'the disk is full'), ('raising', 'division by zero')])
def test_a_node_that_has_failed_or_not_ended_in_order_says_so_by_its_exit_code(word: str, told: str) -> None:
    with start(word) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.terminate()
        _, err = process.communicate(timeout=DEADLINE)
        assert process.returncode == 1
        assert told in err


@pytest.mark.dds('another process takes part')
@pytest.mark.parametrize(
    ('how', 'reason'),
    [
        ('exit', 'SystemExit'),
        ('interrupt', 'KeyboardInterrupt: by a callback'),
        ('shutdown', 'the ROS context was shut down'),
        ('abort', 'the world has come to its end'),
    ],
)
def test_a_node_that_cannot_go_on_ends_its_process_with_exit_code_1_and_the_reason(how: str, reason: str) -> None:
    with start(how) as process:
        _, err = process.communicate(timeout=DEADLINE)
        assert process.returncode == 1
        assert 'program: cannot ' in err and reason in err


@pytest.mark.dds('another process takes part')
@pytest.mark.parametrize(
    ('how', 'why'),
    [('fail', 'no map given; set parameter map'), ('no_file', 'missing.yaml: No such file or directory')],
)
def test_a_set_up_that_fails_gives_one_line_and_exit_code_1(how: str, why: str) -> None:
    with start(how) as process:
        _, err = process.communicate(timeout=DEADLINE)
        assert process.returncode == 1
        assert err == f'program: cannot start: {why}\n'


@pytest.mark.dds('another process takes part')
def test_arguments_namespaces_and_parameter_files_work_as_usual(tmp_path: Path) -> None:
    parameters = tmp_path / 'parameters.yaml'
    parameters.write_text('/**:\n  ros__parameters:\n    speed: 2.5\n    sped: 3.5\n')
    with start('--ros-args', '-r', '__ns:=/robot1', '--params-file', str(parameters)) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == 'ready /robot1/program 2.5\n'
        assert process.stderr is not None
        if rclpy_private.is_usable(rclpy_private.PARAMETERS):
            assert "there is no parameter 'sped', so it is ignored; did you mean 'speed'?" in process.stderr.readline()
        process.terminate()
        process.communicate(timeout=DEADLINE)
        assert process.returncode == 0


@pytest.mark.skipif(not rclpy_private.is_usable(rclpy_private.PARAMETERS), reason='what is given is not known')
def test_a_parameter_is_unknown_when_no_node_of_the_process_has_it() -> None:
    args = ['--ros-args', *(word for name in ('ours', 'theirs', 'thiers') for word in ('-p', f'{name}:=1'))]
    with NodeRuntime.open('one', args=args) as one, NodeRuntime.open('another', args=args) as another:
        one.node.declare_parameter('ours', 0)
        another.node.declare_parameter('theirs', 0)
        (line,) = unknown_parameters([one.node, another.node])
        assert line == "there is no parameter 'thiers', so it is ignored; did you mean 'theirs'?"


SHARE = get_package_share_directory('flexbt_common')

GIVEN: list[tuple[str, Callable[[ParameterDeclarer], Any], Any]] = [
    ('[]', lambda declare: declare.texts('given', (), ''), ()),
    ('[]', lambda declare: declare.texts('given', ('a', 'b'), ''), ()),
    ('[]', lambda declare: declare.reals('given', [1.0], ''), []),
    ("['', 'b']", lambda declare: declare.texts('given', (), ''), ('b',)),
    ('20', lambda declare: declare.real('given', 1.0, 0.0, 100.0, ''), 20.0),
    ('[1, 2]', lambda declare: declare.reals('given', [1.0], ''), [1.0, 2.0]),
    ('$(find-pkg-share flexbt_common)/x', lambda declare: declare.text('given', '', ''), f'{SHARE}/x'),
    ("['$(find-pkg-share flexbt_common)']", lambda declare: declare.texts('given', (), ''), (SHARE,)),
    ('$(echo a)', lambda declare: declare.text('given', '', ''), '$(echo a)'),
]


@pytest.mark.skipif(not rclpy_private.is_usable(rclpy_private.PARAMETERS), reason='what is given is not known')
@pytest.mark.parametrize(('text', 'declared', 'expected'), GIVEN)
@pytest.mark.parametrize('node_class', [LargeQueueNode, ExtendedLifecycleNode])
def test_a_value_of_a_parameter_file_is_what_it_means(
    tmp_path: Path,
    text: str,
    declared: Callable[[ParameterDeclarer], Any],
    expected: Any,
    node_class: type[LargeQueueNode],
) -> None:
    (tmp_path / 'file.yaml').write_text(f'/**/one:\n  ros__parameters:\n    given: {text}\n')
    args = ['--ros-args', '--params-file', str(tmp_path / 'file.yaml')]
    with NodeRuntime.open('one', args=args, node_class=node_class) as runtime:
        for _ in range(2):  # a managed node asks once more when it is configured anew
            assert runtime.call(lambda: declared(ParameterDeclarer(runtime.node))) == expected


REFUSED: list[tuple[str, Callable[[ParameterDeclarer], Any], str]] = [
    (
        '[]',
        lambda declare: declare.real('given', 1.0, 0.0, 2.0, 'm'),
        r'no value, or \[\].*; write given: 1.0; m; the d',
    ),
    (
        '"1.5"',
        lambda declare: declare.real('given', 1.0, 0.0, 2.0, 'm'),
        "'1.5' is of type string, not double.*: 1.5; m",
    ),
    ('"9"', lambda declare: declare.real('given', 1.0, 0.0, 2.0, 'm'), "'9' is of type string, not double.*: 1.0; m"),
    ('"True"', lambda declare: declare.flag('given', False, 'm'), "'True' is of type string, not bool; .*: true; m"),
    ('0', lambda declare: declare.flag('given', True, 'm'), '0 is of type integer, not bool; write given: false; m'),
    ('7', lambda declare: declare.flag('given', True, 'm'), '7 is of type integer, not bool; write given: true; m'),
    (
        '3',
        lambda declare: declare.real('given', 1.0, 0.0, 2.0, 'm'),
        '3.0 is out of range; write a value from 0.0 to 2.0, such as given: 1.0; m; the',
    ),
    ('.nan', lambda declare: declare.real('given', 1.0, 0.5, 2.0, 'm'), 'nan is out of range; .*: 1.0; m; the'),
    ('true', lambda declare: declare.real('given', 1.0, 0.0, 2.0, 'm'), 'true is of type bool, not double; .*: 1.0; m'),
    ('2.0', lambda declare: declare.integer('given', 1, 0, 2, 'm'), '2.0 is of type double, not integer; .*: 2; m'),
    (f'{2**53 + 1}', lambda declare: declare.real('given', 1.0, 0.0, 1e18, 'm'), 'integer, not double; write given: 9'),
    ('5', lambda declare: declare.text('given', '', 'm'), "5 is of type integer, not string; write given: '5'; m"),
    ('a', lambda declare: declare.texts('given', (), 'm'), r"'a' is of type string, not string array; .*: \['a'\]; m"),
    (
        '[1, 2]',
        lambda declare: declare.texts('given', (), 'm'),
        r"\[1, 2\] is .* not string array; .*: \['1', '2'\]; m",
    ),
    ('["a"]', lambda declare: declare.reals('given', [1.0], 'm'), r"\['a'\] is .*, not double array; .*: \[1.0\]; m"),
    ('$(find-pkg-share flexbt_comon)', lambda declare: declare.text('given', '', 'm'), "did you mean 'flexbt_common'"),
]


@pytest.mark.skipif(not rclpy_private.is_usable(rclpy_private.PARAMETERS), reason='what is given is not known')
@pytest.mark.parametrize(('text', 'declared', 'reason'), REFUSED)
@pytest.mark.parametrize('node_class', [LargeQueueNode, ExtendedLifecycleNode])
def test_a_value_of_a_parameter_file_is_refused_with_the_reason(
    tmp_path: Path,
    text: str,
    declared: Callable[[ParameterDeclarer], Any],
    reason: str,
    node_class: type[LargeQueueNode],
) -> None:
    (tmp_path / 'file.yaml').write_text(f'one:\n  ros__parameters:\n    given: {text}\n')
    args = ['--ros-args', '--params-file', str(tmp_path / 'file.yaml')]
    with NodeRuntime.open('one', args=args, node_class=node_class) as runtime:
        with pytest.raises(UnfitParameterError, match=reason):
            runtime.call(lambda: declared(ParameterDeclarer(runtime.node)))
        with pytest.raises(UnfitParameterError, match='m; the default is'):  # of a managed node that tries again
            runtime.call(lambda: declared(ParameterDeclarer(runtime.node)))


@pytest.mark.skipif(not rclpy_private.is_usable(rclpy_private.PARAMETERS), reason='what is given is not known')
@pytest.mark.parametrize(
    ('text', 'reason', 'meant'),
    [
        ('1', '1 is of type integer', 'true'),
        ('"True"', "'True' is of type string", 'true'),
        ('"off"', "'off' is of type string", 'false'),
        ('sure', "'sure' is of type string", 'false'),
        ('[true]', '[True] is of type bool array', 'false'),
    ],
)
@pytest.mark.parametrize('node_class', [LargeQueueNode, ExtendedLifecycleNode])
def test_what_is_no_bool_is_refused_for_use_sim_time_with_what_to_write(
    text: str, reason: str, meant: str, node_class: type[LargeQueueNode]
) -> None:
    with (
        pytest.raises(InvalidParameterTypeException) as refused,
        NodeRuntime.open('one', args=['--ros-args', '-p', f'use_sim_time:={text}'], node_class=node_class),
    ):
        pass
    assert str(refused.value) == f"parameter 'use_sim_time': {reason}, not bool; write use_sim_time: {meant}"


@pytest.mark.parametrize('node_class', [LargeQueueNode, ExtendedLifecycleNode])
def test_a_callback_that_awaits_holds_up_nothing_else_of_the_node(node_class: type[LargeQueueNode]) -> None:
    began, heard = threading.Event(), threading.Event()

    async def wait_for_ever(_: Empty) -> None:
        began.set()
        await Awaited()

    with NodeRuntime.open('one', node_class=node_class) as runtime, NodeRuntime.open('other') as other:
        runtime.call(lambda: runtime.node.create_subscription(Empty, 'awaits', wait_for_ever, LATCHED))
        other.call(lambda: other.node.create_publisher(Empty, 'awaits', LATCHED)).publish(Empty())
        assert began.wait(DEADLINE)
        runtime.call(lambda: runtime.node.create_subscription(Empty, 'stop', lambda _: heard.set(), LATCHED))
        other.call(lambda: other.node.create_publisher(Empty, 'stop', LATCHED)).publish(Empty())
        assert heard.wait(DEADLINE)


def test_many_runtimes_one_after_the_other_leave_nothing_behind() -> None:
    before = threading.active_count()
    for number in range(20):
        with NodeRuntime.open(f'node{number}') as runtime:
            runtime.steady.call_at(runtime.steady.now() + 100, lambda: None)
            runtime.clock.call_at(runtime.clock.now() + 100, lambda: None)
    assert threading.active_count() == before


@pytest.mark.dds('another process takes part')
@pytest.mark.parametrize(
    ('arguments', 'is_asked'),
    [(['-h'], True), (['--help', '--ros-args'], True), (['--ros-args', '-p', 'help:=1'], False)],
)
def test_help_is_told_instead_of_running_the_node(arguments: list[str], is_asked: bool) -> None:
    with start(*arguments) as process:
        assert process.stdout is not None
        first = process.stdout.readline()
        if is_asked:
            assert first.startswith('usage: program') and 'Drives the robot.' in process.stdout.read()
        else:
            assert first.startswith('ready')
            process.send_signal(signal.SIGINT)
        assert process.wait(DEADLINE) == 0


@pytest.mark.dds('another process takes part')
def test_arguments_that_are_not_for_ros_are_refused() -> None:
    with start('--map', 'here', '--ros-args', '-p', 'speed:=2.0') as process:
        out, err = process.communicate(timeout=DEADLINE)
        assert (process.returncode, out) == (2, '')
        assert "unknown argument '--map'" in err


def test_arguments_that_ros_refuses_are_told_without_a_trace(capfd: pytest.CaptureFixture[str]) -> None:
    assert run_node('program', lambda _: pytest.fail('not to be run'), ['--ros-args', '-r', '__ns:=/rob-1']) == 2
    told = capfd.readouterr().err
    assert "program: Failed to parse ROS arguments: Couldn't parse remap rule: '-r __ns:=/rob-1'" in told


@pytest.mark.parametrize('service_type', [SetParameters, SetParametersAtomically])
def test_a_value_that_does_not_fit_is_refused_in_words_when_it_is_set(service_type: Any) -> None:
    name = 'set_parameters' if service_type is SetParameters else 'set_parameters_atomically'
    wrong = ParameterMessage(name='speed', value=ParameterValue(type=255))
    with NodeRuntime.open('set') as runtime, NodeRuntime.open('client') as client:
        runtime.call(lambda: runtime.node.declare_parameter('speed', 1.0))
        runtime.call(lambda: runtime.node.declare_parameter('autostart', False))
        runtime.call(lambda: ParameterDeclarer(runtime.node).integer('most', 1, 0, 9, 'm'))
        right = Parameter('speed', value=2.0).to_parameter_msg()
        link = ServiceLinks(client).link(service_type, f'set/{name}')

        def results(*parameters: ParameterMessage) -> list[SetParametersResult]:
            response: Any = service_outcome(link, service_type.Request(parameters=parameters), DEADLINE).response
            return list(response.results) if hasattr(response, 'results') else [response.result]

        refused = results(right, wrong)
        assert len(refused) == (2 if service_type is SetParameters else 1)
        assert all("speed' is of type 255" in one.reason and not one.successful for one in refused)
        for name, value, reason in (
            ('speed', 2, "parameter 'speed': 2 is of type integer, not double; write speed: 2.0"),
            ('speed', None, "parameter 'speed': it cannot be without a value of type double; write speed: 1.0"),
            ('sped', 2.0, "there is no parameter 'sped'; did you mean 'speed'?"),
            ('autostart', 'on', "parameter 'autostart': 'on' is of type string, not bool; write autostart: true"),
            ('most', 10, "parameter 'most': 10 is out of range; write a value from 0 to 9, such as most: 1"),
            ('most', 8, "parameter 'most': it is read when the node starts; start the node with -p most:=8"),
        ):
            assert results(Parameter(name, value=value).to_parameter_msg())[0].reason == reason
        assert runtime.node.get_parameter('speed').value == 1.0
        assert [one.successful for one in results(right)] == [True]


@pytest.mark.parametrize(
    ('service_type', 'name', 'field', 'one'),
    [
        (DescribeParameters, 'describe_parameters', 'names', 'use_sim_time'),
        (GetParameters, 'get_parameters', 'names', 'use_sim_time'),
        (GetParameterTypes, 'get_parameter_types', 'names', 'use_sim_time'),
        (ListParameters, 'list_parameters', 'prefixes', 'shown'),
        (SetParameters, 'set_parameters', 'parameters', ParameterMessage(name='x')),
        (SetParametersAtomically, 'set_parameters_atomically', 'parameters', ParameterMessage(name='x')),
    ],
)
def test_a_request_for_too_many_parameters_is_refused_before_it_is_looked_at(
    service_type: Any, name: str, field: str, one: Any
) -> None:
    with NodeRuntime.open('asked') as runtime, NodeRuntime.open('client') as client:
        runtime.call(lambda: runtime.node.declare_parameter('shown.here', 1))
        link = ServiceLinks(client).link(service_type, f'{runtime.name}/{name}')

        def answer(count: int) -> Any:
            request = service_type.Request(**{field: [one] * count})
            return service_outcome(link, request, DEADLINE).response

        refused = answer(1_001)
        assert refused is not None
        if field == 'parameters':
            results = refused.results if service_type is SetParameters else [refused.result]
            assert {one.successful for one in results} == {False}
            assert '1001 parameters in one request, of at most 1000' in results[0].reason
        else:
            assert refused == service_type.Response()
        assert answer(1_000) != refused  # as many are served

# SPDX-License-Identifier: BSD-3-Clause
"""rclpy's default context in a process of ours: what users' code finds there, and how it ends."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest
import rclpy
from rclpy.exceptions import InvalidNodeNameException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions, get_current_signal_handlers_options

from flexbt_common.middleware.default_context import DefaultContext
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_testing.system.python_processes import python_process
from flexbt_testing.waiting import DEADLINE, uncontended_time

PROGRAM = """
import sys
import threading
import rclpy
from std_msgs.msg import Empty
from flexbt_common.runtime.node_runtime import run_node

def setup(runtime):
    runtime.default_context.open()
    node = runtime.kept = rclpy.create_node('helper')
    node.create_subscription(Empty, 'news', lambda _: None, 10)
    threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()
    stopped = threading.Event()

    def loop():
        while rclpy.ok():
            stopped.wait(0.01)
        stopped.set()

    threading.Thread(target=loop, daemon=True).start()
    destroy = node.destroy_node
    node.destroy_node = lambda: (print('destroying', flush=True), destroy())
    runtime.on_close(lambda: print('closing', rclpy.ok(), flush=True))
    times = [one.get_parameter('use_sim_time').value for one in (runtime.node, node)]
    print(runtime.node.get_fully_qualified_name(), node.get_fully_qualified_name(), *times, flush=True)

sys.exit(run_node('program', setup, sys.argv[1:]))
"""


@pytest.fixture(autouse=True)
def no_default_context() -> Iterator[None]:
    """Whatever a test leaves behind is not there for the next one."""
    yield
    rclpy.try_shutdown()


@pytest.mark.dds('another process takes part')
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_users_nodes_have_namespace_and_time_of_the_process_but_not_its_name_and_end_with_it(
    number: signal.Signals,
) -> None:
    arguments = ['--ros-args', '-r', '__node:=renamed', '--remap', '__ns:=/robot', '-p', 'use_sim_time:=true']
    with python_process(['-c', PROGRAM, *arguments]) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == '/robot/renamed /robot/helper True True\n'
        began = uncontended_time()
        process.send_signal(number)
        out, err = process.communicate(timeout=DEADLINE)
        assert process.returncode == 0, err
        assert uncontended_time() - began < 2.0
        assert (out, err) == ('closing True\ndestroying\n', '')


def test_the_time_is_that_of_the_node_wherever_it_was_said() -> None:
    with NodeRuntime.open('simulated', parameters={'use_sim_time': True}) as runtime:
        runtime.default_context.open()
        node = rclpy.create_node('helper')
        assert node.get_parameter('use_sim_time').value is True
        runtime.default_context.close()
        assert not rclpy.ok()


def test_a_context_that_somebody_else_has_opened_is_left_to_them() -> None:
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    with NodeRuntime.open('guest') as runtime:
        runtime.default_context.open()
    assert rclpy.ok()


def test_the_context_can_be_opened_again_after_users_code_has_shut_it_down() -> None:
    context = DefaultContext()
    for _ in range(2):
        context.open()
        assert rclpy.ok()
        rclpy.shutdown()
    context.open()
    context.close()
    assert not rclpy.ok()


@pytest.mark.dds('it is about signals')
def test_handlers_of_signals_that_users_code_has_installed_are_taken_off() -> None:
    context = DefaultContext()
    context.open()
    rclpy.shutdown()
    rclpy.init(args=[])
    assert get_current_signal_handlers_options() == SignalHandlerOptions.ALL
    context.open()
    assert get_current_signal_handlers_options() == SignalHandlerOptions.NO
    context.close()
    assert not rclpy.ok()


def test_nodes_of_users_that_cannot_be_destroyed_keep_nothing_from_its_end(capfd: pytest.CaptureFixture[str]) -> None:
    class Stubborn(Node):
        def destroy_node(self) -> None:
            raise ValueError('never')

    class Unmade(Node):
        def __init__(self) -> None:
            kept.append(self)
            raise ValueError('no such device')

    class PartlyMade(Node):
        def __init__(self) -> None:
            kept.append(self)
            super().__init__('not a name')

    kept: list[Node] = []
    with NodeRuntime.open('host') as runtime:
        runtime.default_context.open()
        kept.append(Stubborn('stubborn'))
        with pytest.raises(ValueError, match='no such device'):
            Unmade()
        with pytest.raises(InvalidNodeNameException):
            PartlyMade()
        rclpy.create_node('gone').destroy_node()
    assert runtime.is_at_rest and not rclpy.ok()
    told = capfd.readouterr().err
    assert "Stubborn was not destroyed: ValueError('never')" in told
    assert 'PartlyMade was not destroyed: AttributeError(' in told
    Node.destroy_node(kept[0])


def test_of_two_runtimes_one_has_the_context_for_both() -> None:
    with NodeRuntime.open('first') as first:
        with NodeRuntime.open('second') as second:
            first.default_context.open()
            second.default_context.open()
        assert rclpy.ok()
    assert not rclpy.ok()

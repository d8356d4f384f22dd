# SPDX-License-Identifier: BSD-3-Clause
"""Processes of installed executables: they, or a thread, are stopped and continue; they end in order, or are killed."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from flexbt_common.runtime.health import OUT_OF_REACH_SECONDS
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_msgs.msg import CommandResult, ExecutiveCommand, ExecutiveStatus
from flexbt_testing.nodes.operator import Operator
from flexbt_testing.system.hold_up import THREADS
from flexbt_testing.system.processes import Stack
from flexbt_testing.waiting import DEADLINE, wait_until

NAME = 'onboard_executive'
REAL_TIME = {'use_sim_time': 'false'}


@pytest.fixture
def stack(tmp_path: Path) -> Iterator[Stack]:
    with Stack(tmp_path, can_be_held_up=True) as stack:
        stack.start(NAME, REAL_TIME)
        yield stack


@pytest.fixture
def operator(stack: Stack) -> Iterator[Operator]:
    with NodeRuntime.open('operator') as runtime:
        operator = Operator(runtime)
        operator.wait_for(lambda status: status.state == ExecutiveStatus.IDLE, 'the executive')
        yield operator


def test_a_stopped_process_does_nothing_until_it_continues(stack: Stack, operator: Operator) -> None:
    stack.send_signal(NAME, signal.SIGSTOP)
    stopped = time.monotonic()
    sent = operator.send(ExecutiveCommand.AUTONOMY, autonomy=1)
    wait_until(lambda: time.monotonic() > stopped + 1.0, 'a second')
    assert not any(one.command_id == sent for one in operator.status.results)
    assert stack.running() == {NAME}
    stack.send_signal(NAME, signal.SIGCONT)
    assert operator.result(sent).code == CommandResult.APPLIED


def test_a_command_that_waits_while_its_process_is_stopped_for_long_has_no_effect(
    stack: Stack, operator: Operator
) -> None:
    operator.applied(ExecutiveCommand.AUTONOMY, autonomy=3)  # so each has found the other
    stack.send_signal(NAME, signal.SIGSTOP)
    stopped = time.monotonic()
    waiting = operator.send(ExecutiveCommand.AUTONOMY, autonomy=1)
    wait_until(lambda: time.monotonic() > stopped + 2.0 * OUT_OF_REACH_SECONDS, 'a long time')
    stack.send_signal(NAME, signal.SIGCONT)
    operator.logged('were dropped: they may have waited while the executive was stopped')
    operator.applied(ExecutiveCommand.AUTONOMY, autonomy=2)
    assert not any(one.command_id == waiting for one in operator.status.results)


def test_one_thread_hangs_for_a_time(stack: Stack, operator: Operator) -> None:
    stack.hold_up(NAME, THREADS[NAME]['executor'], 4 * operator.status.heartbeat_period)

    def was_silent() -> bool:
        limit = 3 * operator.status.heartbeat_period
        return any(after - before > limit for before, after in pairwise(operator.arrivals))

    wait_until(was_silent, 'a silence of the executive, and its end')
    assert stack.running() == {NAME}


def test_a_process_ends_by_a_signal_and_begins_anew_after_it_is_killed(stack: Stack, operator: Operator) -> None:
    first = operator.status.executive_id
    stack.kill(NAME)
    assert stack.running() == set()
    stack.start(NAME, REAL_TIME)
    operator.wait_for(lambda status: status.executive_id not in ('', first), 'another executive')
    ending = stack.end(NAME, signal.SIGTERM, DEADLINE)
    assert (ending.exit_code, stack.running()) == (0, set())

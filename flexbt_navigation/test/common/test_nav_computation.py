# SPDX-License-Identifier: BSD-3-Clause
"""Computations of servers: one after the other, each of the state of things when its turn comes."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterator
from typing import Any, cast

import pytest

from flexbt_common.calls.goal_server import ServedGoal
from flexbt_navigation.common.requests import Computation, follow
from flexbt_navigation.errors import GoalCanceled
from flexbt_testing.waiting import DEADLINE


class Executor:
    """An executor that the test turns, in place of that of a node."""

    def __init__(self) -> None:
        self._posted: queue.Queue[Callable[[], object]] = queue.Queue()
        self.closing: list[Callable[[], object]] = []
        self.post = self._posted.put
        self.on_close = self.closing.append

    def turn_until(self, is_over: Callable[[], object]) -> None:
        while not is_over():
            self._posted.get(timeout=DEADLINE)()


class Goal:
    """A goal that can be canceled."""

    def __init__(self) -> None:
        self.cancel_requested = False
        self._told: list[Callable[[], object]] = []
        self.on_cancel = self._told.append

    def cancel(self) -> None:
        self.cancel_requested = True
        for tell in self._told:
            tell()


class Bench:
    def __init__(self) -> None:
        self.executor = cast(Any, Executor())
        self.computation = Computation(self.executor, 'test')
        self.ends: dict[str, object] = {}
        self.begun: list[str] = []

    def run(self, name: str, compute: Callable[[], object], goal: Any = None) -> None:
        async def steps() -> None:
            def prepare() -> Callable[[], object]:
                self.begun.append(name)
                return compute

            served: ServedGoal | None = goal
            try:
                self.ends[name] = await self.computation.run(prepare, served)
            except Exception as error:
                self.ends[name] = error

        follow(steps())


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    for close in bench.executor.closing:
        close()


def test_what_a_computation_needs_is_taken_when_its_turn_comes(bench: Bench) -> None:
    held = threading.Event()
    bench.run('first', lambda: held.wait(DEADLINE))
    bench.run('second', lambda: 2)
    bench.run('third', lambda: 3)
    assert bench.begun == ['first']
    held.set()
    bench.executor.turn_until(lambda: 'third' in bench.ends)
    assert bench.begun == ['first', 'second', 'third']
    assert bench.ends == {'first': True, 'second': 2, 'third': 3}


def test_a_goal_that_is_canceled_while_it_waits_ends_at_once(bench: Bench) -> None:
    held, goal = threading.Event(), Goal()
    bench.run('first', lambda: held.wait(DEADLINE))
    bench.run('second', lambda: 2, goal)
    bench.run('third', lambda: 3)
    goal.cancel()
    assert isinstance(bench.ends['second'], GoalCanceled)
    held.set()
    bench.executor.turn_until(lambda: 'third' in bench.ends)
    assert bench.begun == ['first', 'third']


def test_one_that_fails_or_cannot_begin_holds_up_no_other(bench: Bench) -> None:
    def fail() -> object:
        raise ValueError('no')

    async def unprepared() -> None:
        with pytest.raises(ValueError, match='no'):
            await bench.computation.run(lambda: fail)
        with pytest.raises(ZeroDivisionError):
            await bench.computation.run(lambda: 1 // 0)  # type: ignore[arg-type, return-value]

    follow(unprepared())
    bench.run('last', lambda: 1)
    bench.executor.turn_until(lambda: 'last' in bench.ends)
    assert bench.ends == {'last': 1}

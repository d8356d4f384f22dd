# SPDX-License-Identifier: BSD-3-Clause
"""The userdata of a run as it is told from outside: all scopes, between two steps, whatever the values are."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent.futures import Future
from typing import Any

import pytest
from geometry_msgs.msg import Point

from flexbt_common import names
from flexbt_common.calls.action_call import ActionCall, ActionLinks
from flexbt_common.values.entries import from_entry
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_msgs.action import GetUserdata
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveLog
from flexbt_testing.nodes.executive_bench import ExecutiveBench, behavior_of
from flexbt_testing.waiting import wait_until

Result = GetUserdata.Result
GOAL = Point(x=1.0, y=-2.0)


class Unsendable:
    """A value that cannot even be shown."""

    def __repr__(self) -> str:
        raise ValueError('no')


class Worker(EventState):
    """Counts in its userdata, and is at work for as long as it may not go on."""

    def __init__(self, go_on: threading.Event) -> None:
        super().__init__(outcomes=['done'], input_keys=['given'], output_keys=['count'], desired_rate=100.0)
        self._go_on = go_on
        self.at_work = threading.Event()

    def on_enter(self, userdata: Any) -> None:
        userdata.count = userdata.given + 1

    def execute(self, userdata: Any) -> None:
        self.at_work.set()
        self._go_on.wait()


class UserdataBench(ExecutiveBench):
    """A machine in a machine, and a client that asks."""

    def __init__(self) -> None:
        self.go_on = threading.Event()
        self.go_on.set()
        self.worker = Worker(self.go_on)
        super().__init__(behavior_of(self._machine))
        self._link = ActionLinks(self.console).link(GetUserdata, names.GET_USERDATA)

    def _machine(self) -> OperatableStateMachine:
        inner = OperatableStateMachine(outcomes=['done'], input_keys=['given'], output_keys=['count'])
        inner.userdata.own = ['a', 'b']
        with inner:
            OperatableStateMachine.add('Work', self.worker, {'done': 'done'})
        machine = OperatableStateMachine(outcomes=['finished'])
        machine.userdata.start, machine.userdata.goal, machine.userdata.odd = 41, GOAL, Unsendable()
        with machine:
            OperatableStateMachine.add('Inner', inner, {'done': 'finished'}, remapping={'given': 'start'})
        return machine

    def ask(self, path: str = '', *keys: str) -> tuple[ActionCall, Future[Any]]:
        done: Future[Any] = Future()
        goal = GetUserdata.Goal(path=path, keys=list(keys))
        return ActionCall(self._link, goal, on_done=done.set_result, server_timeout=60.0), done

    def told(self, path: str = '', *keys: str) -> Any:
        result = self.ask(path, *keys)[1].result(60.0).result
        assert result is not None
        return result


@pytest.fixture
def bench() -> Iterator[UserdataBench]:
    made = UserdataBench()
    try:
        yield made
    finally:
        made.go_on.set()
        made.close()


def test_every_active_machine_tells_what_it_has(bench: UserdataBench) -> None:
    idle = bench.told()
    assert (idle.code, idle.message, idle.scopes) == (Result.FAILURE, 'no behavior is running', [])
    bench.start()
    bench.worker.at_work.wait(60.0)
    told = bench.told()
    assert (told.code, told.run_id) == (Result.SUCCESS, bench.run_id)
    assert [scope.path for scope in told.scopes] == ['/', '/Inner']
    root, inner = ({entry.key: entry for entry in scope.entries} for scope in told.scopes)
    assert list(root) == ['count', 'goal', 'odd', 'start'] and list(inner) == ['count', 'own']
    assert (from_entry(root['count']), from_entry(root['goal'])) == (42, GOAL)
    assert (root['odd'].type, root['odd'].text) == ('', 'a Unsendable that cannot be shown')
    assert inner['own'].text == '["a", "b"]'


def test_only_what_is_asked_for_is_told_and_what_is_missing_is_named(bench: UserdataBench) -> None:
    bench.start()
    bench.worker.at_work.wait(60.0)
    (scope,) = bench.told('/Inner', 'own').scopes
    assert (scope.path, [entry.key for entry in scope.entries]) == ('/Inner', ['own'])
    assert [scope.path for scope in bench.told('', 'count').scopes] == ['/', '/Inner']
    partly = bench.told('/', 'start', 'speed')
    assert partly.code == Result.FAILURE
    assert partly.message == "machine / has no value for 'speed'; there are: count, goal, odd, start"
    assert [entry.key for entry in partly.scopes[0].entries] == ['start']
    assert "'/Outer' is not an active machine; these are: /, /Inner" in bench.told('/Outer').message


def test_a_run_that_is_kept_busy_is_waited_for_and_the_question_can_be_withdrawn(bench: UserdataBench) -> None:
    bench.go_on.clear()
    bench.start()
    bench.worker.at_work.wait(60.0)
    call, withdrawn = bench.ask()
    _, patient = bench.ask()
    wait_until(lambda: call.accepted, 'acceptance')
    call.cancel(60.0)
    assert withdrawn.result(60.0).result.code == Result.CANCELED
    assert not patient.done()
    bench.go_on.set()
    assert patient.result(60.0).result.code == Result.SUCCESS


class Writes(EventState):
    """Waits for ever, and would write a goal."""

    def __init__(self) -> None:
        super().__init__(outcomes=['done'], output_keys=['goal'], desired_rate=None)


class Reads(EventState):
    """Reads a goal when it is executed, which it is not."""

    def __init__(self) -> None:
        super().__init__(outcomes=['done'], input_keys=['target'], desired_rate=None)


def test_who_forces_an_outcome_is_told_what_is_read_and_was_not_written() -> None:
    def machine() -> OperatableStateMachine:
        made = OperatableStateMachine(outcomes=['done'])
        with made:
            OperatableStateMachine.add('First', Writes(), {'done': 'Second'})
            OperatableStateMachine.add('Second', Reads(), {'done': 'First'}, remapping={'target': 'goal'})
        return made

    bench = ExecutiveBench(behavior_of(machine))
    try:
        bench.start()
        bench.wait_active('/First')
        bench.applied(ExecutiveCommand.FORCE, path='/First', outcome='done')
        told = bench.logged('/Second follows, and reads what nobody has written: goal')
        assert told.severity == ExecutiveLog.WARN and told.path == '/First'
        bench.applied(ExecutiveCommand.FORCE, path='/Second', outcome='done')
        bench.wait_active('/First')
        assert len([line for line in bench.logs if 'nobody has written' in line.text]) == 1
    finally:
        bench.close()


def test_each_value_has_the_state_that_has_written_it_in_every_machine_that_it_reaches(bench: UserdataBench) -> None:
    bench.start()
    wait_until(bench.worker.at_work.is_set)
    told = bench.told()
    assert told.code == Result.SUCCESS
    writers = {
        (scope.path, entry.key): (writer, written.sec)
        for scope in told.scopes
        for entry, writer, written in zip(scope.entries, scope.writers, scope.written, strict=True)
    }
    assert writers['/Inner', 'count'][0] == '/Inner/Work' and writers['/Inner', 'count'][1] > 0
    assert writers['/', 'count'] == writers['/Inner', 'count']  # it is an output
    assert writers['/', 'start'] == writers['/Inner', 'own'] == ('', 0)  # defaults

# SPDX-License-Identifier: BSD-3-Clause
"""Monitors find an engine, or states, that do wrong. That they let the sound ones alone, all tests of the engine show.

The defects are seeded into the engine: each takes one of its rules away.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import pytest

from flexbt_core.clock.clock import ManualClock
from flexbt_core.monitors.machine_monitor import MachineMonitor
from flexbt_core.monitors.properties import Property, Violation
from flexbt_core.monitors.requirements import After, Apart, AtMost, Before, IsA, Never, Requirement, Within
from flexbt_core.skills.skill import Skill
from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.engine import operator_commands
from flexbt_core.state_machine.engine.leaf import LeafRun
from flexbt_core.state_machine.engine.region import ContainerRun, Region
from flexbt_core.state_machine.engine.resume import switch_machine
from flexbt_core.state_machine.engine.run import MachineRun
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.definition import Child
from flexbt_testing.state_machines.bench import Scripted, machine


class Driving(Scripted):
    skill = Skill.of(resources=['base'])


class Watched:
    """A run with a monitor, and what that has found."""

    def __init__(
        self,
        made: OperatableStateMachine,
        requirements: Iterable[Requirement] = (),
        autonomy: int = Autonomy.Full,
    ) -> None:
        self.found: list[Violation] = []
        self.clock = ManualClock()
        definition = define(made)
        self.run = MachineRun(definition, self.clock, autonomy=autonomy)
        self.run.add_reader(MachineMonitor(self.run, self.found.append, requirements))
        self.run.start()
        self.run.step()

    def end(self, path: str, outcome: str) -> None:
        """Let a state that is active give an outcome."""
        (state,) = [leaf.state for leaf in self.run.active_states() if leaf.path == path]
        assert isinstance(state, Scripted)
        state.end(outcome)
        self.run.step()

    @property
    def properties(self) -> set[Property]:
        return {one.property for one in self.found}


def chain(requires: int = Autonomy.Off) -> OperatableStateMachine:
    """Return a machine of A, then B, then A again, or the end."""

    def once() -> Scripted:
        return Scripted('done', 'failed', do={'on_exit': lambda state, _: setattr(state, 'outcome', None)})

    levels = {'done': requires, 'failed': requires}
    return machine(
        Child('A', once(), {'done': 'B', 'failed': 'ended'}, levels),
        Child('B', once(), {'done': 'A', 'failed': 'ended'}, levels),
    )


def beside(one: Scripted, other: Scripted) -> OperatableStateMachine:
    """Two states that are active at once."""
    return machine(
        Child('One', one, {'done': 'ended'}, {'done': Autonomy.Full}),
        Child('Other', other, {'done': 'ended'}, {'done': Autonomy.Full}),
        conditions=[('ended', [('One', 'done'), ('Other', 'done')])],
    )


def test_on_exit_that_is_forgotten_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(LeafRun, 'leave', lambda self, reason: None)
    watched = Watched(chain())
    watched.end('/A', 'done')
    (wrong,) = watched.found
    assert wrong.property is Property.BALANCED and wrong.where == '/A' and 'on_exit was not called' in wrong.text


def test_an_outcome_that_counts_twice_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    watched = Watched(chain())
    passed = Region._pass_on

    def twice(self: Region, child: Any) -> bool:
        done = passed(self, child)
        self.child, self.is_leaving = child, True
        return passed(self, child) and done

    monkeypatch.setattr(Region, '_pass_on', twice)
    watched.end('/A', 'done')
    assert any('it was left before' in one.text for one in watched.found)


def test_a_transition_without_its_approval_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    watched = Watched(chain(Autonomy.Full), autonomy=Autonomy.Low)
    monkeypatch.setattr(Region, '_ask', lambda self, kind, child, outcome, *rest: self._leave_child(child, outcome))
    watched.end('/A', 'done')
    watched.run.step()
    assert watched.properties == {Property.APPROVAL} and 'nobody was asked' in watched.found[0].text


def test_an_approval_that_goes_to_another_request_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    watched = Watched(beside(Scripted(outcome='done'), Scripted(outcome='done')), autonomy=Autonomy.Low)
    first, second = watched.run.decisions
    deciding: Callable[..., Any] = operator_commands._deciding
    swapped = {first.id: second.id, second.id: first.id}
    monkeypatch.setattr(operator_commands, '_deciding', lambda run, wanted: deciding(run, swapped[wanted]))
    watched.run.command('', operator_commands.confirm, first.id)
    watched.run.step()
    (wrong,) = watched.found
    assert wrong.property is Property.APPROVAL and wrong.where == second.path


def test_an_approval_of_another_outcome_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    watched = Watched(chain(Autonomy.Full), autonomy=Autonomy.Low)
    watched.end('/A', 'done')
    (decision,) = watched.run.decisions
    monkeypatch.setattr(Region, 'approve', lambda self: self._leave_child(self.child, 'failed'))
    watched.run.controls.set_level(Autonomy.Off, '/')
    watched.run.command('', operator_commands.confirm, decision.id)
    watched.run.step()
    assert watched.properties == {Property.APPROVAL}
    assert "'failed', which needs the operator, and approved was 'done'" in watched.found[0].text


def test_what_is_entered_after_a_stop_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    watched = Watched(chain())
    leave = ContainerRun.leave

    def leave_and_begin(self: ContainerRun, reason: Any) -> None:
        leave(self, reason)
        self.children['B'].enter(self.scope)

    monkeypatch.setattr(ContainerRun, 'leave', leave_and_begin)
    watched.run.preempt('test')
    watched.run.step()
    assert watched.properties == {Property.STOP_STOPS, Property.BALANCED}
    assert any('/B was entered, and never left' in one.text for one in watched.found)


def test_an_end_that_comes_twice_is_found() -> None:
    watched = Watched(chain())
    watched.end('/A', 'failed')
    watched.run._finish('ended', '')
    assert watched.properties == {Property.BALANCED} and 'ends again' in watched.found[0].text


def test_two_owners_of_an_actuator_are_found_and_one_that_halts_counts() -> None:
    assert Watched(beside(Driving(), Driving())).properties == {Property.ONE_OWNER}
    assert not Watched(beside(Driving(), Scripted())).found
    halting = ['']
    slow = Driving(do={'halting': lambda state, _: halting[0] or None})
    ring = machine(Child('Slow', slow, {'done': 'Next'}, {}), Child('Next', Driving(), {'done': 'ended'}, {}))
    watched = Watched(ring)
    halting[0] = 'it rolls on'
    watched.end('/Slow', 'done')
    assert not watched.found  # the engine waits for the first
    halting[0] = ''
    watched.run.step()
    assert not watched.found and [leaf.path for leaf in watched.run.active_states()] == ['/Next']


REQUIREMENTS: list[tuple[Requirement, list[tuple[str, str]], str]] = [
    (Never('/B'), [('/A', 'done')], '/B happens'),
    (AtMost('/A', 1), [('/A', 'done'), ('/B', 'done')], '/A happens more than once'),
    (Before('/B', '/B > done'), [('/A', 'done')], '/B comes without /B > done'),
    (After('/A > done', ('=ended',)), [('/A', 'done')], '/B follows /A > done'),
    (Within('/A > done', '/A'), [('/A', 'done'), ('/B', 'failed')], 'it ends, and /A has not come'),
    (Within('/A', '/A'), [('/A', 'done'), ('/B', 'done'), ('/A', 'failed')], 'it ends, and /A has not come'),
]


@pytest.mark.parametrize(('required', 'way', 'text'), REQUIREMENTS, ids=[str(one) for one, *_ in REQUIREMENTS])
def test_a_requirement_is_watched(required: Requirement, way: list[tuple[str, str]], text: str) -> None:
    watched = Watched(chain(), [required])
    for path, outcome in way[:-1]:
        watched.end(path, outcome)
    assert not watched.found
    watched.end(*way[-1])
    assert [one.text.partition(';')[0][: len(text)] for one in watched.found] == [text]


@pytest.mark.parametrize('is_stopped', [False, True])
def test_a_machine_that_is_stopped_while_its_last_states_halt_does_not_end_by_its_outcome(is_stopped: bool) -> None:
    is_halting = True
    slow = Scripted(do={'halting': lambda state, _: 'it rolls on' if is_halting else None})
    made = machine(
        Child('Quick', Scripted()),
        Child('Slow', slow),
        conditions=[('ended', [('Quick', 'done')]), ('ended', [('Slow', 'done')])],
    )
    watched = Watched(made, [Never('=ended')])
    watched.end('/Quick', 'done')
    assert not watched.found
    if is_stopped:
        watched.run.preempt('test')
    is_halting = False
    watched.run.step()
    assert watched.run.outcome == ('preempted' if is_stopped else 'ended')
    assert [one.text.partition(';')[0] for one in watched.found] == ([] if is_stopped else ['=ended happens'])


def test_each_entry_of_a_machine_is_an_event() -> None:
    """Also of one that is entered as a part of another, beside others, or again."""
    first = machine(Child('B', machine(Child('C', Scripted(), {'done': 'ended'})), {'ended': 'ended'}))
    other = machine(
        Child('E', machine(Child('F', Scripted(), {'done': 'ended'}))), conditions=[('ended', [('E', 'ended')])]
    )
    made = machine(Child('A', first, {'ended': 'D'}), Child('D', other, {'ended': 'A'}), outcomes=['ended'])
    watched = Watched(made, [Never(path) for path in ('/A', '/A/B', '/D', '/D/E')])
    assert [one.where for one in watched.found] == ['/A', '/A/B']
    watched.end('/A/B/C', 'done')
    assert [one.where for one in watched.found[2:]] == ['/D', '/D/E']
    watched.run.command('', operator_commands.repeat, '/D')
    watched.run.step()
    assert [one.where for one in watched.found[4:]] == ['/D', '/D/E']


def test_a_machine_that_waits_for_something_with_priority_is_entered_after_it() -> None:
    urgent = machine(Child('S', Scripted(), {'done': 'ended'}), priority=True)
    beside = machine(Child('T', Scripted(), {'done': 'ended'}))
    ends = [('ended', [('A', 'ended'), ('B', 'ended')])]
    made = machine(Child('A', urgent), Child('B', beside), conditions=ends)
    watched = Watched(made, [Before('/B', '/A/S > done'), Never('/B')])
    assert not watched.found
    watched.end('/A/S', 'done')
    assert [one.text for one in watched.found] == ['/B happens; required is: never /B']


def test_a_machine_to_which_a_run_is_switched_has_to_be_as_required() -> None:
    watched = Watched(chain(), [IsA('/B', 'Scripted')])
    other = machine(
        Child('A', Scripted('done', 'failed'), {'done': 'B', 'failed': 'ended'}),
        Child('B', Driving(), {'done': 'ended'}),
    )
    watched.run.command('', switch_machine, define(other))
    watched.run.step()
    assert [one.text for one in watched.found] == ['/B is a Driving; required is: /B is a Scripted']


def test_states_that_are_to_be_apart_are_watched() -> None:
    assert Watched(beside(Scripted(), Scripted()), [Apart('/One', '/Other')]).properties == {Property.REQUIREMENT}


def test_a_deadline_that_begins_as_the_run_is_resumed_is_not_longer_by_the_pause() -> None:
    requirements = [Within('/A > done', '/C > done', 60.0), Within('/B', '/C > done', 5.0)]
    ways = {'A': 'X', 'X': 'B', 'B': 'C', 'C': 'ended'}
    watched = Watched(machine(*(Child(name, Scripted(), {'done': then}) for name, then in ways.items())), requirements)
    watched.end('/A', 'done')
    watched.run.command('', operator_commands.pause)
    watched.run.step()
    watched.clock.advance(10.0)
    watched.run.command('', operator_commands.resume)
    watched.end('/X', 'done')
    watched.clock.advance(5.1)
    watched.run.step()
    assert [violation.text for violation in watched.found] == [
        '/C > done has not come 5 s after /B; required is: after /B, /C > done within 5 s'
    ]


def test_a_deadline_is_told_when_it_is_over_and_stands_still_in_a_pause() -> None:
    watched = Watched(chain(), [Within('/A > done', '/B > done', 5.0)])
    watched.end('/A', 'done')
    watched.clock.advance(3.0)
    watched.run.command('', operator_commands.pause)
    watched.run.step()
    watched.clock.advance(60.0)
    watched.run.command('', operator_commands.resume)
    watched.run.step()
    assert not watched.found and watched.run.next_wake == pytest.approx(65.0)
    watched.clock.advance(2.0)
    watched.run.step()
    assert [one.text for one in watched.found] == [
        '/B > done has not come 5 s after /A > done; required is: after /A > done, /B > done within 5 s'
    ]


def test_a_deadline_that_passes_within_the_last_callback_of_the_run_is_told() -> None:
    def work(_: Scripted, userdata: object) -> str | None:
        watched.clock.advance(7.0)
        return 'done'

    watched = Watched(machine(Child('A', Scripted(), {'done': 'ended'})), [Within('/A', '/A', 5.0)])
    (leaf,) = watched.run.active_states()
    leaf.state.do['execute'] = work  # type: ignore[attr-defined]
    leaf.wake()
    watched.run.step()
    assert watched.run.outcome == 'ended'
    assert [one.text for one in watched.found] == ['/A has not come 5 s after /A; required is: after /A, /A within 5 s']

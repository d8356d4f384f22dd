# SPDX-License-Identifier: BSD-3-Clause
"""The monitor of a state machine's run: visits, approvals, resources and requirements."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Final

from flexbt_core.state_machine.engine.events import (
    DecisionAsked,
    DecisionTaken,
    MachineEntered,
    MachineSwitched,
    OutcomeForced,
    OutcomeTaken,
    RunEnded,
    RunEnding,
    RunEvent,
    RunReader,
    RunRested,
    RunStarted,
    StateEntered,
    StateExited,
    StateLeft,
)
from flexbt_core.state_machine.engine.run import MachineRun
from flexbt_core.state_machine.model.autonomy import Decision
from flexbt_core.state_machine.model.definition import (
    ERROR,
    PREEMPTED,
    MachineDefinition,
    StateDefinition,
    is_inside,
)
from flexbt_core.state_machine.model.event_state import state_skill

from .properties import Property, Violation, shared_actuators
from .requirement_text import machine_parts
from .requirements import Requirement, Requirements


def declared_resources(machine: MachineDefinition) -> dict[str, frozenset[str]]:
    """Return the resources in the skills of a machine's states, by path; states without resources are left out."""
    states = (node for node in machine.nodes() if isinstance(node, StateDefinition))
    return {one.path: found for one in states if (found := frozenset(state_skill(one.state).resources))}


class MachineMonitor(RunReader):
    """A reader that checks one run and calls ``found`` with each violation.

    It checks that each state is entered and left once; that a transition that needs the operator was approved for just
    this request; that an actuator has one owner; that no state is entered after a stop or active after the end; and
    that the run ends once. ``requirements`` are those of the mission.
    """

    def __init__(
        self, run: MachineRun, found: Callable[[Violation], None], requirements: Iterable[Requirement] = ()
    ) -> None:
        self._run = run
        self._resources = declared_resources(run.definition)
        self._found = found
        self._visits = Visits()
        self._approvals = Approvals()
        self._require(Requirements(requirements, run.clock.now, found))
        self._holders: set[str] = set()  # entered states with actuators; some may have been left
        self._is_ending = False
        self._outcome: str | None = None

    @property
    def not_left(self) -> list[str]:
        """States that were entered and whose on_exit was not called."""
        return self._visits.inside

    @contextmanager
    def requiring(self, requirements: Iterable[Requirement]) -> Iterator[None]:
        """Watch other requirements from now on, but the same as before if the run does not switch within the block.

        What came before causes no violation of them.
        """
        before, definition = self.requirements, self._run.definition
        self._require(Requirements(requirements, self._run.clock.now, self._found))
        self.requirements.resume()
        try:
            yield
        finally:
            if self._run.definition is definition:
                self._require(before)

    def _require(self, requirements: Requirements) -> None:
        self.requirements = requirements
        self._has_requirements = bool(requirements.requirements)

    def next_wake(self) -> float | None:
        return self.requirements.next_due()

    def methods(self) -> Mapping[type[RunEvent], Callable[[Any], None]]:
        return {
            RunStarted: self._started,
            MachineSwitched: self._switched,
            MachineEntered: self._machine_entered,
            StateEntered: self._entered,
            StateExited: self._exited,
            OutcomeTaken: self._outcome_taken,
            StateLeft: self._left,
            DecisionAsked: self._asked,
            DecisionTaken: self._confirmed,
            OutcomeForced: self._forced,
            RunRested: self._rested,
            RunEnding: self._ends,
            RunEnded: self._ended,
        }

    def _started(self, event: RunStarted) -> None:
        if event.is_resumed:
            self._visits.resume(event.active)
            self._approvals.resume(event.approved)
            self.requirements.resume()
        self._check_parts(self._run.definition)

    def _check_parts(self, machine: MachineDefinition) -> None:
        if self.requirements.are_about_parts:
            self.requirements.check_parts(machine_parts(machine))

    def _machine_entered(self, event: MachineEntered) -> None:
        self.requirements.event(event.path)

    def _entered(self, event: StateEntered) -> None:
        path = event.path
        if (wrong := self._visits.entered(path)) is not None:
            self._found(wrong)
        if self._is_ending:
            self._found(Violation(Property.STOP_STOPS, path, f'{path} was entered although the run ends'))
        if path in self._resources:
            self._holders.add(path)
        if self._has_requirements:
            self.requirements.event(path)

    def _left(self, event: StateLeft) -> None:
        path = event.path
        if (wrong := self._visits.passed_on(path)) is not None:
            self._found(wrong)
        self._holders.discard(path)
        if not self._has_requirements:
            return
        if event.outcome:
            left = f'{path} > {event.outcome}'
            self.requirements.follows(left, event.target)
            self.requirements.event(left)

    def _exited(self, event: StateExited) -> None:
        if (wrong := self._visits.exited(event.path)) is not None:
            self._found(wrong)

    def _outcome_taken(self, event: OutcomeTaken) -> None:
        may_pass = self._run.controls.may_pass(event.path, event.required)
        if (wrong := self._approvals.leaves(event.path, event.outcome, may_pass)) is not None:
            self._found(wrong)

    def _asked(self, event: DecisionAsked) -> None:
        self._approvals.asked(event.decision)

    def _confirmed(self, event: DecisionTaken) -> None:
        if (wrong := self._approvals.confirmed(event.decision_id)) is not None:
            self._found(wrong)

    def _forced(self, event: OutcomeForced) -> None:
        self._approvals.forced(event.path, event.outcome)

    def _switched(self, event: MachineSwitched) -> None:
        self._resources = declared_resources(event.definition)
        self._check_parts(event.definition)

    def _ends(self, _event: RunEnding) -> None:
        if not self._is_ending:
            if (outcome := self._run.root.outcome) is not None:  # else it was stopped, or has failed
                self.requirements.event(f'={outcome}')
            self.requirements.rests(self._run.is_paused)  # a callback may have taken longer than a deadline
        self._is_ending = True

    def _rested(self, _event: RunRested) -> None:
        run = self._run
        if len(self._holders) > 1:
            holds = run.pausing.holds
            active = [state for state in run.active_states() if state.path in self._resources]
            owners = [state for state in active if state.is_entered or state.halting() is not None]
            for wrong in shared_actuators(
                (state.path, self._resources[state.path]) for state in owners if not holds(state.path)
            ):
                self._found(wrong)
            self._holders = {state.path for state in owners}  # a paused state may resume while the other runs
        if self._has_requirements:
            self.requirements.rests(run.is_paused)
            if self.requirements.aparts:
                self.requirements.works([(path,) for path in self._visits.inside])

    def _ended(self, event: RunEnded) -> None:
        outcome = event.outcome
        if self._outcome is not None:
            text = f'the run has ended by {self._outcome!r} already, and ends again by {outcome!r}'
            self._found(Violation(Property.BALANCED, '/', text))
        self._outcome = outcome
        for wrong in self._visits.left_open():
            self._found(wrong)
        if outcome not in (PREEMPTED, ERROR):
            self.requirements.ended()


# The visits of states: each is entered, and left once, before its successor is entered.

_OUTSIDE: Final = 0
_ENTERED: Final = 1
_EXITED: Final = 2


class Visits:
    """The visit of each state: outside, entered, or exited without a transition yet."""

    def __init__(self) -> None:
        self._at: dict[str, int] = {}

    def resume(self, paths: Iterable[str]) -> None:
        """Record that these states were exited in an earlier run and have no transition yet."""
        self._at = dict.fromkeys(paths, _EXITED)

    def entered(self, path: str) -> Violation | None:
        """Record that a state is entered; return the violation, if any."""
        at = self._at
        was = at.get(path)
        at[path] = _ENTERED
        return _wrong(path, f'{path} was entered again without having been left') if was == _ENTERED else None

    def exited(self, path: str) -> Violation | None:
        """Record that ``on_exit`` of a state is called; return the violation, if any."""
        at = self._at
        was = at.get(path)
        at[path] = _EXITED
        return None if was == _ENTERED else _wrong(path, f'{path} was left without having been entered')

    def passed_on(self, path: str) -> Violation | None:
        """Record the transition out of a state; return the violation, if any."""
        at = self._at
        was = at.get(path)
        if was is None:  # a machine has no callbacks
            return None
        at[path] = _OUTSIDE
        if was == _EXITED:
            return None
        what = 'on_exit was not called' if was == _ENTERED else 'it was left before'
        return _wrong(path, f'{path} was left by an outcome, and {what}')

    def left_open(self) -> list[Violation]:
        """Return, at the end, a violation for each state that was entered and never left."""
        return [
            _wrong(path, f'{path} was entered, and never left: on_exit was not called')
            for path, was in self._at.items()
            if was == _ENTERED
        ]

    @property
    def inside(self) -> list[str]:
        """States that were entered and not left."""
        return [path for path, was in self._at.items() if was == _ENTERED]


def _wrong(path: str, text: str) -> Violation:
    return Violation(Property.BALANCED, path, text)


# Requests to the operator and their approvals: a transition that needs one must have it for just this request.


class Approvals:
    """The last request about each state or machine, and the approved outcomes."""

    def __init__(self) -> None:
        self._asked: dict[str, Decision] = {}
        self._given: dict[str, str] = {}

    def resume(self, given: Mapping[str, str]) -> None:
        """Keep the approvals of an earlier run, as outcomes by path."""
        self._asked.clear()
        self._given = dict(given)

    def asked(self, decision: Decision) -> None:
        """Record that the operator is asked; this replaces an older request about the same path."""
        self._asked[decision.path] = decision

    def confirmed(self, decision_id: str) -> Violation | None:
        """Record that the operator has confirmed a request; return the violation, if any."""
        for path, decision in self._asked.items():
            if decision.id == decision_id:
                self._given[path] = decision.outcome
                del self._asked[path]
                return None
        return Violation(Property.APPROVAL, '/', f'request {decision_id} was confirmed, and is not pending')

    def forced(self, path: str, outcome: str) -> None:
        """Record that the operator has forced an outcome of a state or machine."""
        self._given[path] = outcome
        self._asked.pop(path, None)

    def leaves(self, path: str, outcome: str, may_pass: bool) -> Violation | None:
        """Record that a state or machine is left by an outcome; return the violation, if any.

        ``may_pass``: the transition needs no approval.
        """
        asked = self._asked.pop(path, None) if self._asked else None
        given = self._given.pop(path, None) if self._given else None
        if self._given or self._asked:  # its descendants are left too
            for inner in [one for one in (*self._given, *self._asked) if is_inside(one, path)]:
                self._given.pop(inner, None)
                self._asked.pop(inner, None)
        if may_pass or given == outcome:
            return None
        if given is not None:
            why = f'approved was {given!r}'
        else:
            why = 'nobody was asked' if asked is None else f'request {asked.id} was not answered'
        return Violation(
            Property.APPROVAL, path, f'{path} was left by {outcome!r}, which needs the operator, and {why}'
        )

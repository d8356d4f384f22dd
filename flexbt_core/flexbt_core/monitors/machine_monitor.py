# SPDX-License-Identifier: BSD-3-Clause
"""What is watched in the run of a machine: a few bits for each state, and next to no time for each event."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from flexbt_core.state_machine import (
    ERROR,
    PREEMPTED,
    Decision,
    ExitReason,
    MachineDefinition,
    MonitoredRun,
    StateDefinition,
    state_skill,
)

from .approvals import Approvals
from .properties import Property, Violation, shared_actuators
from .requirement_text import machine_parts
from .requirements import Requirement, Requirements
from .visits import Visits

Resources = Mapping[str, frozenset[str]]
"""What the states of a machine have while they are active, by their paths; those that have nothing may be left out."""


def declared_resources(machine: MachineDefinition) -> Resources:
    """What the skills of the states of a machine declare."""
    states = (node for node in machine.nodes() if isinstance(node, StateDefinition))
    return {one.path: found for one in states if (found := frozenset(state_skill(one.state).resources))}


class MachineMonitor:
    """Watches one run, as :class:`flexbt_core.state_machine.RunMonitor`; ``found`` is told what is wrong.

    What is watched: each state is entered and left, once; what needs the operator was approved, by this very request;
    an actuator has one owner; nothing is entered after a stop, and nothing is active after the end; the run ends once.
    ``requirements`` are those of the mission.
    """

    def __init__(
        self,
        resources: Resources,
        found: Callable[[Violation], None],
        requirements: Iterable[Requirement] = (),
    ) -> None:
        self.resources = resources
        self._found = found
        self._visits = Visits()
        self._approvals = Approvals()
        self.requirements = Requirements(requirements, lambda: self._run.clock.now(), found)
        self._has_requirements = bool(self.requirements.requirements)
        self._holders: set[str] = set()  # states that were entered, and have actuators; some may have been left
        self._is_ending = False
        self._outcome: str | None = None
        self._run: MonitoredRun
        self._machine: MachineDefinition | None = None
        self._containers: frozenset[str] = frozenset()

    @property
    def not_left(self) -> list[str]:
        """The states that were entered, and whose on_exit was not called."""
        return self._visits.inside

    # -- what the run tells ------------------------------------------------------------------------------------------

    def begins(self, run: MonitoredRun, is_resumed: bool) -> None:
        self._run = run
        if is_resumed:
            self._visits.resume(state.path for state in run.active_states())
            self._approvals.resume(run.approved())
            self.requirements.resume()
        if self.requirements.are_about_parts:
            self.requirements.check_parts(machine_parts(run.definition))

    def entered(self, path: str) -> None:
        if (wrong := self._visits.entered(path)) is not None:
            self._found(wrong)
        if self._is_ending:
            self._found(Violation(Property.STOP_STOPS, path, f'{path} was entered although the run ends'))
        if path in self.resources:
            self._holders.add(path)
        if self._has_requirements:
            self.requirements.event(path)

    def exited(self, path: str) -> None:
        if (wrong := self._visits.exited(path)) is not None:
            self._found(wrong)

    def asked(self, decision: Decision) -> None:
        self._approvals.asked(decision)

    def confirmed(self, decision_id: str) -> None:
        if (wrong := self._approvals.confirmed(decision_id)) is not None:
            self._found(wrong)

    def forced(self, path: str, outcome: str) -> None:
        self._approvals.forced(path, outcome)

    def leaves(self, path: str, outcome: str, required: int) -> None:
        wrong = self._approvals.leaves(path, outcome, self._run.controls.may_pass(path, required))
        if wrong is not None:
            self._found(wrong)

    def transition(self, path: str, outcome: str, target: str, reason: ExitReason) -> None:
        if (wrong := self._visits.passed_on(path)) is not None:
            self._found(wrong)
        self._holders.discard(path)
        if self._has_requirements and outcome:
            left = f'{path} > {outcome}'
            self.requirements.follows(left, target)
            self.requirements.event(left)
            if (target.startswith('=') and path.count('/') == 1) or self._is_container(target):
                self.requirements.event(target)  # states are entered by themselves

    def rests(self) -> None:
        run = self._run
        if len(self._holders) > 1:
            holds = run.pausing.holds
            active = [state for state in run.active_states() if state.path in self.resources]
            owners = [state for state in active if state.is_entered or state.halting() is not None]
            for wrong in shared_actuators(
                (state.path, self.resources[state.path]) for state in owners if not holds(state.path)
            ):
                self._found(wrong)
            self._holders = {state.path for state in owners}  # one that stands still may go on beside the other
        if self._has_requirements:
            self.requirements.rests(run.pausing.is_paused)
            if self.requirements.aparts:
                self.requirements.works([(path,) for path in self._visits.inside])

    def next_wake(self) -> float | None:
        return self.requirements.next_due()

    def ends(self) -> None:
        self._is_ending = True

    def ended(self, outcome: str) -> None:
        if self._outcome is not None:
            text = f'the run has ended by {self._outcome!r} already, and ends again by {outcome!r}'
            self._found(Violation(Property.BALANCED, '/', text))
        self._outcome = outcome
        for wrong in self._visits.left_open():
            self._found(wrong)
        if outcome not in (PREEMPTED, ERROR):
            self.requirements.ended()

    def _is_container(self, path: str) -> bool:
        machine = self._run.definition
        if machine is not self._machine:
            self._machine = machine
            self._containers = frozenset(one.path for one in machine.nodes() if isinstance(one, MachineDefinition))
        return path in self._containers

# SPDX-License-Identifier: BSD-3-Clause
"""What is monitored in a run of a behavior, and what becomes of the findings."""

from __future__ import annotations

from collections.abc import Callable

from flexbt_core.monitors import (
    Findings,
    MachineMonitor,
    Monitoring,
    Property,
    Violation,
    declared_resources,
    machine_vocabulary,
    violation_text,
)
from flexbt_core.state_machine import ERROR, ROOT_PATH, MachineDefinition
from flexbt_msgs.msg import ExecutiveLog

from .run_observer import BehaviorRunObserver


class RunMonitors:
    """Used on the thread of the run. Each finding is a line for operators, and an event.

    ``on_first(text)`` gets the first one, ``stop(text)`` each that is to stop the run.
    """

    def __init__(
        self,
        monitoring: Monitoring,
        observer: BehaviorRunObserver,
        on_first: Callable[[str], None],
        stop: Callable[[str], None],
    ) -> None:
        self._monitoring = monitoring
        self._observer = observer
        self._on_first = on_first
        self._stop = stop
        self._findings = Findings(self._found)
        self._machine: MachineMonitor | None = None

    def monitor_for(self, behavior: str, definition: MachineDefinition) -> MachineMonitor | None:
        """The monitor of a machine that is about to begin; None when nothing is monitored."""
        if self._monitoring.is_on:
            for problem in self._monitoring.problems_of(behavior, machine_vocabulary(definition)):
                self._observer.log(ExecutiveLog.WARN, '', problem)
            requirements = self._monitoring.requirements_of(behavior)
            self._machine = MachineMonitor(declared_resources(definition), self._findings.add, requirements)
        return self._machine

    def switched(self, definition: MachineDefinition) -> None:
        """The run goes on with another machine."""
        if self._machine is not None:
            self._machine.resources = declared_resources(definition)

    def ended(self, outcome: str, has_goals: bool) -> None:
        """The machine has ended; ``has_goals``: a goal of it is not known to have ended."""
        if self._machine is not None and outcome != ERROR and has_goals:
            text = f'the run has ended by {outcome!r}, and a goal of it goes on'
            self._findings.add(Violation(Property.STOP_STOPS, ROOT_PATH, text))

    def _found(self, violation: Violation) -> None:
        text = violation_text(violation)
        self._observer.log(ExecutiveLog.ERROR, violation.where if violation.where.startswith('/') else '', text)
        self._observer.event('violation', {'property': violation.property.name, 'path': violation.where, 'text': text})
        if violation is self._findings.first:
            self._on_first(text)
        if self._monitoring.stops:
            self._stop(text)

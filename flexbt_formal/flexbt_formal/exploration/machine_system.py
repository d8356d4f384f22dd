# SPDX-License-Identifier: BSD-3-Clause
"""A state machine with its environment and its operator, as the executive runs it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, Final

from flexbt_core.clock.waiting import WakeEvent
from flexbt_core.monitors.machine_monitor import MachineMonitor
from flexbt_core.monitors.properties import Property, Violation, shared_keys
from flexbt_core.monitors.requirements import Requirement, Requirements, Written, violation_of
from flexbt_core.state_machine.authoring.data_flow import races
from flexbt_core.state_machine.authoring.wrappers import RetryingState, StateWrapper
from flexbt_core.state_machine.engine.engine import HaltTimeout, RunLimits
from flexbt_core.state_machine.engine.events import CommandDecided, Faulted, RunEvent, RunReader, StateLeft
from flexbt_core.state_machine.engine.leaf import LeafRun
from flexbt_core.state_machine.engine.operator_commands import confirm, force, pause, resume
from flexbt_core.state_machine.engine.region import ContainerRun, Region
from flexbt_core.state_machine.engine.run import MachineRun
from flexbt_core.state_machine.model.autonomy import AUTONOMY_NAMES, Autonomy, Decision, DecisionKind
from flexbt_core.state_machine.model.definition import (
    ERROR,
    PREEMPTED,
    MachineDefinition,
    StateDefinition,
    StateKind,
    is_inside,
)
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import Scope, UserData
from flexbt_core.values.text import pluralize

from .configuration import Configuration, Layout, StateSnapshotter
from .model import CONFIRMED, LAPSE, START, STOP, TIMER, EnvironmentChoices, Label, LabelEffect, System, servers_gone
from .state_models import (
    MachineEnvironment,
    ModelState,
    StateModels,
    interchangeable,
    modelled,
    parameters_of,
    plain_values,
    state_model,
)
from .virtual_time import VirtualClock, VirtualTimer

OUTCOME: Final = 'outcome'
IGNORED: Final = 'cancel ignored'
APPROVE: Final = 'operator approves'
CHOOSE: Final = 'operator chooses'
FORCE: Final = 'operator forces'
PAUSE: Final = 'operator pauses'
RESUME: Final = 'operator resumes'

_DEFAULT: Final = '(default)'
"""The value that a read of a key returns if nothing has written it."""
_TRANSITIONS: Final = 60
_WAKES: Final = 50


class Operator(Enum):
    """What the operator does: nothing; answer questions; or also force, pause and resume."""

    NONE = 'none'
    ANSWERS = 'answers'
    ALL = 'all'


@dataclass(frozen=True)
class MachineBounds:
    """The bounds of an exploration: the operator's commands, the number of forced outcomes and of ignored cancels."""

    operator: Operator = Operator.ANSWERS
    forces: int = 0
    faults: int = 1
    autonomy: int = Autonomy.Low
    stops: bool = True

    def __str__(self) -> str:
        people = {
            Operator.NONE: 'no operator',
            Operator.ANSWERS: 'an operator who answers what is asked',
            Operator.ALL: f'an operator who answers, pauses, and forces at most {self.forces}',
        }[self.operator]
        stops = ', a stop at any time' if self.stops else ''
        return (
            f'any outcome of each state at once, when a timer is due or just before, {people}{stops}, '
            f'at most {pluralize(self.faults, "ignored cancel")}, {servers_gone(self.faults)}, '
            f'autonomy {AUTONOMY_NAMES[self.autonomy]}'
        )


_CONSTANT: Final = {
    MachineRun: frozenset(('clock', 'readings', '_readers', 'services', '_steady', '_limits', '_wake_event', '_lock')),
    MachineEnvironment: frozenset(('choices', 'answers', 'begun', 'found')),
    MachineMonitor: frozenset(('_resources', '_found', '_run', '_has_requirements')),
    Requirements: frozenset(('requirements', 'whiles', 'aparts', '_now', '_found', '_by_event', 'happened')),
    ModelState: frozenset(('model', 'environment', 'own_path', '_type_name', '_made_with', 'skill')),
    LeafRun: frozenset(('_engine', 'definition', 'path', '_input_keys', '_output_keys')),
    ContainerRun: frozenset(
        (
            '_engine',
            'definition',
            'path',
            'around',
            'runs_while_blocked',
            'advance',
            '_only_region',
            '_inputs',
            '_outputs',
        )
    ),
    Region: frozenset(('_engine', 'path', 'container')),
    HaltTimeout: frozenset(('timeout', '_steady', '_wake')),
    Scope: frozenset(('_inputs', '_outputs')),
    UserData: frozenset(('_inputs', '_outputs', '_remap', '_owner')),
    EventState: frozenset(('outcomes', 'input_keys', 'output_keys', 'desired_rate')),
}
_IGNORED: Final = {
    MachineRun: frozenset(('decision_count', '_recent', '_transitions', 'message', 'calling')),
    LeafRun: frozenset(('entered_at',)),
    Scope: frozenset(('writers',)),
    # As long as there is no violation, the state of the run determines these.
    MachineMonitor: frozenset(('_visits', '_approvals', '_holders', '_is_ending', '_outcome')),
    VirtualClock: frozenset(('time',)),
}
_VIEWS: Final[Mapping[type[Any], Mapping[str, Callable[[Any], Any]]]] = {
    Decision: {'': lambda decision: (decision.kind.name, decision.path, decision.outcome)},
    # Times that are not read again.
    VirtualTimer: {'when': lambda timer: None if timer.callback is None else timer.when},
    RetryingState: {
        '_next_at': lambda state: None if state._failed_by is None else state._next_at,
        '_rest_until': lambda state: None if state._failed_by is None else state._rest_until,
    },
}


class _Counted:
    """The part of the bounds that is used up, and whether the run was started and stopped."""

    def __init__(self) -> None:
        self.is_started = False
        self.is_stopped = False
        self.forces = 0
        self.faults = 0


class MachineSystem(System, RunReader):
    """A machine with its own clock. ``models`` returns the model of a state; ``requirements`` are also checked.

    With ``reduces``, configurations after a stop differ only in the states that have not halted yet. Of interchangeable
    children of a container that are in the same situation, only one is explored; not if there are requirements, which
    could concern one of them.
    """

    def __init__(
        self,
        definition: MachineDefinition,
        models: StateModels = state_model,
        bounds: MachineBounds | None = None,
        requirements: Sequence[Requirement] = (),
        *,
        reduces: bool = True,
    ) -> None:
        super().__init__()
        self._bounds = bounds or MachineBounds()
        self._reduces = reduces
        self._environment = MachineEnvironment(self._note)
        self._written = [one for one in requirements if isinstance(one, Written)]
        defaults = dict.fromkeys((key for one in self._written for key in one.keys), _DEFAULT)
        shown = {key: defaults.get(key, value) for key, value in definition.defaults.items()}
        self._definition = modelled(replace(definition, defaults=shown), models, self._environment)
        self._parameters = {
            node.path: parameters_of(node.state) for node in definition.nodes() if isinstance(node, StateDefinition)
        }
        self._given_userdata = {
            node.path: values
            for node in definition.nodes()
            if isinstance(node, MachineDefinition) and (values := plain_values(node.defaults))
        }
        self._states = {node.path: node for node in self._definition.nodes() if isinstance(node, StateDefinition)}
        self._wake_event = WakeEvent()
        self._counted = _Counted()
        self._taken: set[str] = set()
        self._writes = _shared_writes(self._definition)
        given = {key: f'given:{key}' for key in definition.read_inputs}
        self.given = tuple(sorted(given))
        self.run = MachineRun(
            self._definition,
            self.clock,
            [self],
            autonomy=self._bounds.autonomy,
            userdata=given,
            limits=RunLimits(transitions=_TRANSITIONS),
            wake_event=self._wake_event,
        )
        self._monitor = MachineMonitor(self.run, self._note, requirements)
        self.requirements = self._monitor.requirements
        self.run.add_reader(self._monitor)
        self._at_work: set[str] = set()
        self._layout = Layout(
            constant=_CONSTANT,
            ignored=_IGNORED,
            views=_VIEWS,
            idle={LeafRun: self._idle_leaf, ContainerRun: self._idle_container},
        )
        roots = (self._counted, self.run, self.clock, self._environment, self._monitor)
        self._classes = {type(leaf.state.unwrapped) for leaf in self.run.root.leaves()}
        self._memory = StateSnapshotter(roots, self.clock, self._layout, self._classes)
        self._alike = interchangeable(self._definition) if reduces and not requirements else []
        self.lapses = _times_in(self._definition) + self._times_required > 1
        self._is_starting = False
        self._moved = ''
        """Subject of the label of the current step."""

    # -- interface of System -----------------------------------------------------------------------------------------

    def capture(self) -> Configuration:
        self._note_work()
        configuration = super().capture()
        is_over = self.run.outcome is not None or (self._reduces and self._counted.is_stopped)
        return configuration.known_by(self._rest()) if is_over else configuration

    def _note_work(self) -> None:
        self._at_work = {'/', *(node.path for node in self.run.root.active()), *self._environment.ending}
        self._at_work.update(one.coming.path for one in self.run.regions() if one.coming is not None)

    def _rest(self) -> Any:
        """Return the values that determine the behavior after a stop or an end. The run enters no more states: it
        halts those that it has left, or stops waiting for them. Then the end is checked."""
        run, environment, clock = self.run, self._environment, self.clock
        if run.outcome is not None:
            return run.outcome, sorted(environment.ending)
        waits = sorted(timer.when - clock.now() for timer in clock.timers if timer.callback is not None)
        halting = run.not_halted, sorted(environment.ending), sorted(environment.overdue), self._counted.faults, waits
        return halting, sorted(environment.active), sorted(self._monitor.not_left)

    @property
    def ended(self) -> str | None:
        return self.run.outcome

    @property
    def is_over(self) -> bool:
        return self.run.is_ending

    @property
    def waits(self) -> str:
        asked = ', '.join(decision.path for decision in self.run.decisions)
        return asked or ('the operator, who has paused it' if self.run.is_paused else '')

    @property
    def is_asking(self) -> bool:
        return bool(self.run.decisions)

    def labels(self) -> Sequence[Label]:
        run, counted, environment, bounds = self.run, self._counted, self._environment, self._bounds
        if not counted.is_started:
            return [Label(START)]
        if run.outcome is not None:
            return []
        labels = [Label(CONFIRMED, path) for path in environment.ending]
        due = self._next_due()
        if due is not None:
            if due < self._halts_due():
                labels.append(Label(TIMER))
            elif counted.faults < bounds.faults:
                labels.append(Label(IGNORED, ', '.join(environment.ending)))
        if run.is_ending:
            return labels
        if not run.is_paused:
            labels += [
                Label(OUTCOME, path, outcome)
                for path, state in environment.active.items()
                if state.result is None and not run.pausing.holds(path)
                for outcome in state.results
            ]
        if bounds.operator is not Operator.NONE:
            labels += self._commands()
        if not run.is_paused and any(one.kind != TIMER for one in labels):
            labels += self._lapse_labels()
        if bounds.stops:
            labels.append(Label(STOP))
        if not self._alike:
            return labels
        left_out = [path for _, *paths in self._same() for path in paths]
        return [one for one in labels if not any(is_inside(one.subject, path) for path in left_out)]

    def _same(self) -> Iterator[Sequence[str]]:
        """Yield groups of interchangeable children in the same situation, without those that are being canceled."""
        self._note_work()
        ending = self._environment.ending
        regions = {
            region.path: region
            for region in reversed(list(self.run.regions()))  # a machine shares the path of its region
            if not any(is_inside(path, region.path) for path in ending)
        }
        for group in self._alike:
            found: dict[bytes, list[str]] = {}
            for region in (regions[path] for path in group if path in regions):
                situation = StateSnapshotter((region,), self.clock, self._layout, self._classes).capture().key
                found.setdefault(situation, []).append(region.path)
            yield from (paths for paths in found.values() if len(paths) > 1)

    def _images(self, path: str) -> Iterator[str]:
        """Return a path and its mirror images in interchangeable children, which the same step would reach, even where
        they were omitted much earlier."""
        found = [(path, self._moved)]
        for group in self._alike:
            found += [
                (f'{other}{here[len(one) :]}', f'{other}{moved[len(one) :]}')
                for here, moved in found
                for one in group
                if is_inside(here, one) and is_inside(moved, one)
                for other in group
                if other != one
            ]
        return (here for here, _ in found)

    def answer(self, label: Label) -> LabelEffect | None:
        state = self._environment.active.get(label.subject) if label.kind == OUTCOME else None
        if state is None:
            return None
        model, is_caused = state.model, label.value not in state.model.canceled
        if not model.server and is_caused:
            return None
        return LabelEffect(model.server, label.value in model.successes, is_caused)

    def _commands(self) -> list[Label]:
        run, bounds = self.run, self._bounds
        labels = []
        if not run.is_paused:
            for decision in run.decisions:
                if decision.kind is DecisionKind.CHOICE:
                    labels += [Label(CHOOSE, decision.path, outcome) for outcome in decision.outcomes]
                else:
                    labels.append(Label(APPROVE, decision.path, decision.outcome))
        if bounds.operator is Operator.ALL:
            labels.append(Label(RESUME if run.is_paused else PAUSE))
            if self._counted.forces < bounds.forces and not run.is_paused:
                labels += [
                    Label(FORCE, leaf.path, outcome)
                    for leaf in run.active_states()
                    for outcome in leaf.definition.outcomes
                ]
        return labels

    def step(self, label: Label, choices: EnvironmentChoices) -> list[Violation]:
        run, environment = self.run, self._environment
        environment.choices = choices
        environment.answers = {}
        environment.begun = []
        self._found = []
        self._events.clear()
        self._moved = label.subject
        self._is_starting = label.kind == START
        self._happen(label)
        wakes = 0
        while True:
            self._wake_event.take()
            run.step()
            wakes += 1
            if not self._wake_event.take() or run.outcome is not None:
                break
            if wakes > _WAKES:
                text = f'it wakes itself over and over ({_WAKES} times in a row) and waits for nothing'
                self._found.append(Violation(Property.NO_LIVELOCK, self.position(), text))
                break
        self._taken.update(image for path in environment.begun for image in self._images(path))
        self._check()
        return self._found

    def _happen(self, label: Label) -> None:
        run, environment, counted = self.run, self._environment, self._counted
        kind, path, value = label
        if kind == START:
            counted.is_started = True
            run.start()
        elif kind == OUTCOME:
            environment.active[path].result = value
            environment.active[path].wake()
        elif kind == CONFIRMED:
            environment.ending[path].confirm()
        elif kind in (IGNORED, TIMER):
            if kind == IGNORED:
                counted.faults += 1
                environment.overdue.update(environment.ending)
            due = self._next_due()
            if due is not None:
                self.clock.go_to(due)
        elif kind == LAPSE:
            self.clock.lapse(self._next_due())
        elif kind == STOP:
            counted.is_stopped = True
            run.preempt('stopped')
        elif kind in (APPROVE, CHOOSE, FORCE):
            decision = next((one for one in run.decisions if one.path == path), None)
            if kind == APPROVE:
                assert decision is not None
                run.command('', confirm, decision.id)
            else:
                counted.forces += kind == FORCE
                run.command('', force, path, value, decision.id if decision is not None else '')
        elif kind == PAUSE:
            run.command('', pause)
        elif kind == RESUME:
            run.command('', resume)

    def position(self) -> str:
        run = self.run
        if run.outcome is not None:
            return f'the machine has ended: {run.outcome}'
        active = ', '.join(state.path for state in run.active_states()) or 'nothing is active'
        asked = ', '.join(f'{one.path} > {one.outcome or "?"}' for one in run.decisions)
        return f'active: {active}{f"; the operator is asked: {asked}" if asked else ""}'

    def paths(self) -> Sequence[str]:
        return [node.path for node in self._definition.nodes()]

    def begun(self) -> Sequence[tuple[str, tuple[str, ...]]]:
        """Return the paths of the states that began, with their types, remapped keys and parameters."""
        return [(path, self._described(self._states[path])) for path in self._environment.begun]

    def asked(self) -> Mapping[str, tuple[str, ...]]:
        """Return the default userdata of the machines if the step is the start, else nothing."""
        return self._given_userdata if self._is_starting else {}

    def _described(self, leaf: StateDefinition) -> tuple[str, ...]:
        keys = (*leaf.state.input_keys, *leaf.state.output_keys)
        remapped = (f'{key}={leaf.remap.get(key, key)}' for key in keys)
        return (leaf.state.type_name, *remapped, *self._parameters[leaf.path])

    def covered(self) -> frozenset[str]:
        return frozenset(self._taken)

    def coverable(self) -> frozenset[str]:
        return frozenset(f'{node.path} > {outcome}' for node in self._definition.nodes() for outcome in node.outcomes)

    def promised(self) -> frozenset[str]:
        """Return the outcomes of the machine, and its states; nothing without an operator to answer questions."""
        if self._bounds.operator is Operator.NONE:
            return frozenset()
        return frozenset((*(f'/ > {outcome}' for outcome in self._definition.outcomes), *self._states))

    # -- inactive nodes ---------------------------------------------------------------------------------------------

    def _idle_leaf(self, leaf: LeafRun) -> list[Any] | None:
        """Return the data to save of an inactive state, which resets when it is entered; None if it is active."""
        return None if leaf.path in self._at_work else _kept_of_leaf(leaf)

    def _idle_container(self, container: ContainerRun) -> list[Any] | None:
        return None if container.path in self._at_work else _kept_of_container(container)

    # -- the host ----------------------------------------------------------------------------------------------------

    def _next_due(self) -> float | None:
        times = [time for time in (self.run.next_wake, self.clock.next_timer()) if time is not None]
        return min(times, default=None)

    def _halts_due(self) -> float:
        """Return the next time at which a cancel counts as ignored, s; infinity without one."""
        ending = self._environment.ending
        if not ending:
            return math.inf
        halting = (state.next_wake() for state in self.run.active_states() if state.path in ending)
        times = (self.clock.next_timer(), *halting)
        return min((time for time in times if time is not None), default=math.inf)

    def _check(self) -> None:
        run, environment, found = self.run, self._environment, self._found
        if run.outcome is None:
            at_work = [path for path in environment.active if not run.pausing.holds(path)]
            found += shared_keys((path, self._writes[path]) for path in at_work)
            return
        if run.outcome == ERROR and not self._counted.faults:
            is_livelock = run.message.startswith('livelock')
            kind = Property.NO_LIVELOCK if is_livelock else Property.NO_FAULT
            if not any(one.property in (kind, Property.DATA, Property.NO_FAULT) for one in found):
                found.append(Violation(kind, self._definition.path, f'the run ends as an error: {run.message}'))
        elif run.outcome == PREEMPTED and not self._counted.is_stopped:
            found.append(Violation(Property.DECLARED, '/', 'the run ends as preempted although nobody has stopped it'))
        for path in environment.active:
            text = f'{path} still works after the run has ended by {run.outcome!r}'
            found.append(Violation(Property.STOP_STOPS, path, text))
        for path in environment.ending:
            if path not in environment.overdue:
                text = f'what {path} has begun has not ended, and the run has, by {run.outcome!r}'
                found.append(Violation(Property.STOP_STOPS, path, text))

    # -- events of the run ------------------------------------------------------------------------------------------

    def read(self, event: RunEvent) -> None:
        match event:
            case StateLeft():
                self._left(event.path, event.outcome, event.target)
            case Faulted():
                self._raised(event.path, event.text)
            case CommandDecided() if event.refusal is not None:
                self._events.append(f'refused: {event.refusal}')

    def _left(self, path: str, outcome: str, target: str) -> None:
        self._events.append(f'{path} > {outcome or "(again)"} -> {target or "nothing follows it"}')
        if outcome:
            self._taken.update(f'{one} > {outcome}' for one in self._images(path))
        if target.startswith('=') and path.count('/') == 1:
            self._taken.add(f'/ > {target[1:]}')
        for one in self._written:
            if one.event in (target, f'{path} > {outcome}'):
                self._check_written(one)

    def _check_written(self, required: Written) -> None:
        scope = self.run.scope
        for key in required.keys:
            if key not in scope or scope.get(key) == _DEFAULT:
                self._note(
                    violation_of(required, required.event, f'{required.event} comes, and nobody has written {key}')
                )

    def _raised(self, path: str, text: str) -> None:
        if self._counted.faults and 'halted' in text:
            self._events.append(f'{path}: {text}')
            return
        last = text.strip().splitlines()[-1]
        if 'transitions without waiting' in text:
            self._found.append(Violation(Property.NO_LIVELOCK, path, f'{path}: {last}'))
            return
        kind = Property.DATA if 'UserDataError' in last else Property.NO_FAULT
        self._found.append(Violation(kind, path, last.partition('Error: ')[2] or last))


def _times_in(node: StateDefinition | MachineDefinition) -> int:
    """Return for how many times a state, or what is active in a machine, may wait at once; of a state without a model:
    several."""
    if isinstance(node, MachineDefinition):
        below = [_times_in(child) for child in node.children.values()]
        return sum(below) if node.kind is StateKind.CONCURRENCY else max(below, default=0)
    state, times = node.state, 0
    while isinstance(state, StateWrapper):
        state, times = state.inner, times + 1
    return times if isinstance(state, ModelState) else 2


def _shared_writes(machine: MachineDefinition) -> dict[str, frozenset[str]]:
    """Return the userdata and blackboard keys that a state writes while parallel states may use them, by path."""
    states = {node.path: node.state.unwrapped for node in machine.nodes() if isinstance(node, StateDefinition)}
    found = {
        path: state.model.outputs if isinstance(state, ModelState) else frozenset() for path, state in states.items()
    }
    for race in races(machine):
        for path in race.states:
            found[path] |= {f'userdata key {race.name!r} of {race.path}'}
    return found


def _kept_of_leaf(leaf: LeafRun) -> list[Any]:
    kept = [vars(leaf), vars(leaf.clock), leaf._wake_times]
    state: Any = leaf.state
    while state is not None:
        kept.append(vars(state))
        state = getattr(state, 'inner', None)
    return kept


def _kept_of_container(container: ContainerRun) -> list[Any]:
    kept = [vars(container), container.ended, vars(container._halt_wait)]
    for region in container.regions:
        kept += [vars(region), vars(region._halt_wait)]
    for child in container.children.values():
        kept += _kept_of_leaf(child) if isinstance(child, LeafRun) else _kept_of_container(child)
    return kept

# SPDX-License-Identifier: BSD-3-Clause
"""A run of a state machine.

The host calls :meth:`MachineRun.step` on one thread, whenever ``on_wake`` asks for it and at the time ``next_wake``. A
step takes in the operator's commands, then goes on until nothing more can happen: a chain of instantaneous states is
one step. While nothing happens, nothing is called.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

from flexbt_common.clock import Clock

from .autonomy import NAMES, Autonomy
from .command_queue import Answer, CommandQueue
from .container import ContainerRun
from .decision import Decision, DecisionKind
from .definition import ERROR, PREEMPTED, ROOT_PATH, MachineDefinition
from .errors import StateMachineError
from .event_state import ExitReason, Severity
from .leaf import LeafRun
from .rest import RestWait
from .userdata import Scope

EXIT_TIMEOUT: Final = 3.0
"""How long a state that was left may take to come to rest, s."""

MAX_TRANSITIONS: Final = 1000
"""Transitions in one step, with nothing waited for, that count as a livelock."""

_LOOP_SHOWN: Final = 10


@dataclass(frozen=True, slots=True)
class _End:
    """How a run ends, and why its states are left by that."""

    outcome: str
    message: str
    reason: ExitReason


class RunObserver(Protocol):
    """Hears of a run, on the thread of the run; lines of states may come from any thread."""

    def changed(self) -> None:
        """Something that the operator is shown has changed."""

    def log(self, severity: Severity, path: str, text: str) -> None:
        """A line for the operator."""

    def fault(self, path: str, text: str) -> None:
        """A state raised, or did not come to rest."""

    def transition(self, path: str, outcome: str, target: str, reason: ExitReason) -> None:
        """A state or machine was left; ``target`` is a path, or ``=OUTCOME`` of the machine around it."""


class MachineRun:
    """One run of a machine. Its states belong to it: they cannot be part of another run at the same time.

    ``outcome`` is that of the root machine, 'preempted' after :meth:`preempt`, or 'error', with ``message``.
    ``clock`` is what states see, ``steady`` counts the time that they may take to come to rest (``exit_timeout``, s).
    More than ``max_transitions`` in one step count as a livelock, which ends the run.
    """

    def __init__(
        self,
        definition: MachineDefinition,
        clock: Clock,
        observer: RunObserver,
        *,
        autonomy: int = Autonomy.Low,
        userdata: Mapping[str, Any] | None = None,
        services: Any = None,
        steady: Clock | None = None,
        exit_timeout: float = EXIT_TIMEOUT,
        max_transitions: int = MAX_TRANSITIONS,
        on_wake: Callable[[], None] | None = None,
    ) -> None:
        if autonomy not in NAMES:
            raise StateMachineError(_no_level(autonomy))
        self.definition = definition
        self.clock = clock
        self.observer = observer
        self.services = services
        self.outcome: str | None = None
        self.message = ''
        self._steady = steady if steady is not None else clock
        self._exit_timeout = exit_timeout
        self._max_transitions = max_transitions
        self._on_wake = on_wake
        self._autonomy = {node.path: autonomy for node in definition.nodes()}
        self._root = ContainerRun(self, definition)
        self._scope = Scope(definition.defaults)
        for key, value in (userdata or {}).items():
            self._scope.set(key, value)
        self._commands = CommandQueue()
        self._decisions = 0
        self._transitions = 0
        self._recent: deque[str] = deque(maxlen=_LOOP_SHOWN)
        self._end: _End | None = None
        self._preempt_reason: str | None = None
        self._rest = self.new_rest_wait()
        self._is_started = False
        self._lock = threading.Lock()

    # -- life --------------------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Call on_start of every state and enter the first one. Once, on the thread of the run.

        Raises:
            StateMachineError: it was called before.
            StateError: a state is part of another run, which has not ended.
        """
        if self._is_started:
            raise StateMachineError('a run starts only once; make another MachineRun')
        self._is_started = True
        leaves = list(self._root.leaves())
        for leaf in leaves:
            leaf.bind()
        for leaf in leaves:
            leaf.start()
        if self._end is None and self._preempt_reason is None:
            self._root.begin(self._scope)
        self.changed()
        self.ring()

    def step(self) -> bool:
        """Do everything that can be done now. True while the run goes on."""
        if self.outcome is not None or not self._is_started:
            return self.outcome is None
        self._transitions = 0
        while self._end is None:
            if self._root.outcome is not None:
                self._end = _End(self._root.outcome, '', ExitReason.OUTCOME)
            elif self._preempt_reason is not None:
                self._end = _End(PREEMPTED, self._preempt_reason, ExitReason.PREEMPTED)
            else:
                is_commanded = self._commands.apply_next()
                if not self._root.advance() and not is_commanded and self._end is None:
                    return True
        self._commands.refuse('the run is ending')
        return not self._come_to_rest(self._end)

    @property
    def next_wake(self) -> float | None:
        """When a step is due if nothing rings before, on the run's clock; None when nothing is."""
        return self._root.next_wake() if self._end is None else None

    # -- what the operator sees --------------------------------------------------------------------------------------

    def active_states(self) -> list[LeafRun]:
        """The states that are active."""
        return [node for node in self._root.active() if isinstance(node, LeafRun)]

    @property
    def decisions(self) -> list[Decision]:
        """What waits for the operator."""
        return [machine.decision for machine in self._machines() if machine.decision is not None]

    def autonomy_of(self, path: str) -> int:
        """The level that holds for a state or machine: the one that was set last for it, or for what is around it."""
        return self._autonomy[path]

    # -- commands; from any thread -----------------------------------------------------------------------------------

    def confirm(self, decision_id: str, answer: Answer) -> None:
        """Let what a decision asks for happen."""
        self._command(lambda: self._confirm(decision_id), answer)

    def force(self, path: str, outcome: str, decision_id: str, answer: Answer) -> None:
        """Leave a state or machine by an outcome. ``decision_id`` is the decision that it overrides, or ''."""
        self._command(lambda: self._force(path, outcome, decision_id), answer)

    def set_autonomy(self, level: int, path: str, answer: Answer) -> None:
        """Change the level of the run, or of the sub-tree ``path`` ('' or '/' for all, sub-trees included)."""
        self._command(lambda: self._set_autonomy(level, path), answer)

    def preempt(self, reason: str = '') -> None:
        """Stop the run, whatever it is doing. It cannot be taken back."""
        with self._lock:
            if self._preempt_reason is None:
                self._preempt_reason = reason
        self.ring()

    def ring(self) -> None:
        """Ask the host for a step. From any thread."""
        if self._on_wake is not None:
            self._on_wake()

    # -- for the states and machines of the run ----------------------------------------------------------------------

    def changed(self) -> None:
        """Tell the observer."""
        self.observer.changed()

    def fault(self, path: str, text: str) -> None:
        """Tell the observer of a fault."""
        self.observer.fault(path, text)

    def abort(self, message: str) -> None:
        """End the run as an error: there is no way to go on."""
        if self._end is None:
            self._end = _End(ERROR, message, ExitReason.FAULT)

    def new_decision(
        self, kind: DecisionKind, path: str, outcome: str, outcomes: tuple[str, ...], required: int, prompt: str
    ) -> Decision:
        """A decision with an id of its own."""
        self._decisions += 1
        return Decision(str(self._decisions), kind, path, outcome, outcomes, required, prompt, self.clock.now())

    def new_rest_wait(self) -> RestWait:
        """Something to wait with for what is left; the run is rung when its time is over."""
        return RestWait(self._steady, self._exit_timeout, self.ring)

    def count_transition(self, path: str) -> None:
        """Watch for livelocks."""
        self._transitions += 1
        self._recent.append(path)
        if self._transitions > self._max_transitions:
            loop = ', '.join(dict.fromkeys(self._recent))
            text = f'{self._max_transitions} transitions without waiting for anything'
            self.fault(path, text)
            self.abort(f'livelock: {text}, the last of them from {loop}')

    # -- commands; on the thread of the run --------------------------------------------------------------------------

    def _command(self, apply: Callable[[], str | None], answer: Answer) -> None:
        self._commands.put(apply, answer)
        self.ring()

    def _confirm(self, decision_id: str) -> str | None:
        machine = self._deciding(decision_id)
        if machine is None:
            return self._no_decision(decision_id)
        decision = machine.decision
        if decision is not None and not decision.outcome:
            return f'decision {decision_id} suggests nothing: force one of {", ".join(decision.outcomes)}'
        machine.approve()
        return None

    def _force(self, path: str, outcome: str, decision_id: str) -> str | None:
        parent = next((machine for machine in self._machines() if machine.child and machine.child.path == path), None)
        if parent is None or parent.child is None:
            if path not in self._autonomy:
                return f'there is no state {path!r}'
            active = ', '.join(leaf.path for leaf in self.active_states()) or 'none'
            return f'{path} is not active (active: {active})'
        if decision_id and (parent.decision is None or parent.decision.id != decision_id):
            deciding = self._deciding(decision_id)
            if deciding is None or deciding.decision is None:
                return self._no_decision(decision_id)
            return f'decision {decision_id!r} is about {deciding.decision.path}, not about {path}'
        outcomes = parent.child.definition.outcomes
        if outcome not in outcomes:
            return f'{path} has no outcome {outcome!r}; its outcomes are {", ".join(outcomes)}'
        if parent.is_leaving or not parent.is_active:
            return f'{path} is being left already'
        parent.force(outcome)
        return None

    def _set_autonomy(self, level: int, path: str) -> str | None:
        top = path or ROOT_PATH
        if level not in NAMES:
            return _no_level(level)
        if top not in self._autonomy:
            return f'there is no state {path!r}'
        inside = f'{top.rstrip("/")}/'
        self._autonomy = {
            path: level if f'{path}/'.startswith(inside) else before for path, before in self._autonomy.items()
        }
        self.changed()
        return None

    def _no_decision(self, decision_id: str) -> str:
        pending = ', '.join(decision.id for decision in self.decisions) or 'none'
        return f'decision {decision_id!r} is not pending any more (pending: {pending})'

    def _deciding(self, decision_id: str) -> ContainerRun | None:
        return next((one for one in self._machines() if one.decision and one.decision.id == decision_id), None)

    def _machines(self) -> Iterator[ContainerRun]:
        yield self._root
        yield from (node for node in self._root.active() if isinstance(node, ContainerRun))

    # -- the end -----------------------------------------------------------------------------------------------------

    def _come_to_rest(self, end: _End) -> bool:
        """Leave everything, and finish when it is at rest or the time for that is over."""
        self._root.leave(end.reason)
        unsettled = self._root.unsettled()
        if not self._rest.is_over(unsettled):
            return False
        message = end.message
        if unsettled is not None:
            path = next((leaf.path for leaf in self.active_states()), ROOT_PATH)
            text = f'not confirmed to be at rest {self._rest.timeout:g} s after the stop: {unsettled}'
            self.fault(path, text)
            message = f'{message}; {path} is {text}' if message else f'{path} is {text}'
        self._finish(end.outcome, message)
        return True

    def _finish(self, outcome: str, message: str) -> None:
        self._root.child = None
        for leaf in self._root.leaves():
            leaf.stop()
        self.message = message
        self.outcome = outcome
        self._commands.close('the run has ended')
        self.changed()

    def userdata(self) -> dict[str, Any]:
        """The root machine's userdata."""
        return self._scope.values()


def _no_level(level: int) -> str:
    return f'autonomy {level} is none of the levels Off 0, Low 1, High 2, Full 3'

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
from typing import Any, Final

from flexbt_core.clock import Clock
from flexbt_core.state_machine.model.autonomy import NAMES, Autonomy
from flexbt_core.state_machine.model.decision import Decision, DecisionKind
from flexbt_core.state_machine.model.definition import ERROR, PREEMPTED, ROOT_PATH, MachineDefinition, is_inside
from flexbt_core.state_machine.model.errors import StateMachineError
from flexbt_core.state_machine.model.event_state import ExitReason
from flexbt_core.state_machine.model.userdata import Scope
from flexbt_core.state_machine.resume import restoring, switching
from flexbt_core.state_machine.resume.position import Position

from . import operator_commands as commands
from .command_queue import Answer, CommandQueue
from .container import ContainerRun
from .controls import Controls
from .holds import Holds
from .leaf import LeafRun
from .observer import RunObserver
from .region import HeldBack, Region
from .rest import EXIT_TIMEOUT, RestWait

MAX_TRANSITIONS: Final = 1000
"""Transitions in one step, with nothing waited for, that count as a livelock."""

_LOOP_SHOWN: Final = 10


@dataclass(frozen=True, slots=True)
class _End:
    """How a run ends, and why its states are left by that."""

    outcome: str
    message: str
    reason: ExitReason


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
            raise StateMachineError(commands.no_level(autonomy))
        self.definition = definition
        self.clock = clock
        self.observer = observer
        self.services = services
        self.outcome: str | None = None
        self.message = ''
        self.holds = Holds()
        self.controls = Controls(definition, autonomy)
        self._steady = steady if steady is not None else clock
        self._exit_timeout = exit_timeout
        self._max_transitions = max_transitions
        self._on_wake = on_wake
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

    def start(self, at: Position | None = None) -> None:
        """Call on_start of every state and enter the first one. Once, on the thread of the run.

        With ``at`` the run goes on where another one was: its states are entered again, with ``is_resumed`` set, each
        in a step of its own; what it had set for the operator holds again.

        Raises:
            StateMachineError: it was called before, or the machine cannot be ``at`` that position; with the reasons.
            StateError: a state is part of another run, which has not ended.
        """
        if self._is_started:
            raise StateMachineError('a run starts only once; make another MachineRun')
        if at is not None and (reasons := restoring.reasons_against(self.definition, at)):
            raise StateMachineError(f'the run cannot go on there: {"; ".join(reasons)}')
        self._is_started = True
        leaves = list(self._root.leaves())
        for leaf in leaves:
            leaf.check_free()
        for leaf in leaves:
            leaf.bind()
        for leaf in leaves:
            if leaf.start():
                self.abort(f'{leaf.path} raised in on_start')
        if self._end is None and self._preempt_reason is None:
            if at is not None:
                self._go_on_at(at)
            else:
                self._root.begin(self._scope)
        self.changed()
        self.ring()

    def _go_on_at(self, position: Position) -> None:
        self.holds.is_paused = position.is_paused
        self._decisions = position.decision_count
        self.controls.restore(position.levels, position.locked, position.breakpoints)
        restoring.restore(self._root, self._scope, position)

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
            elif not self._take_one_step() and self._end is None:
                return True
        self._commands.refuse('the run is ending')
        return not self._come_to_rest(self._end)

    def _take_one_step(self) -> bool:
        """Do the first thing that there is to do, and a command with what follows from it; whether there was one."""
        holds = self.holds
        if holds.are_news and self._pause_or_resume_one():
            return True
        is_commanded = self._commands.apply_next()
        if holds.is_paused or holds.are_news:  # states are told that they go on before anything else
            return is_commanded or holds.are_news
        return self._root.advance() or is_commanded

    @property
    def next_wake(self) -> float | None:
        """When a step is due if nothing rings before, on the run's clock; None when nothing is."""
        return self._root.next_wake() if self._end is None and not self.holds.is_paused else None

    # -- what the operator sees --------------------------------------------------------------------------------------

    def active_states(self) -> list[LeafRun]:
        """The states that are active."""
        return [node for node in self._root.active() if isinstance(node, LeafRun)]

    @property
    def is_paused(self) -> bool:
        """Whether the operator has paused the run."""
        return self.holds.is_paused

    @property
    def decisions(self) -> list[Decision]:
        """What waits for the operator, oldest first."""
        found = [region.decision for region in self.regions() if region.decision is not None]
        return sorted(found, key=lambda decision: int(decision.id)) if len(found) > 1 else found

    @property
    def held_back(self) -> list[HeldBack]:
        """What is not left since something is locked, outermost first."""
        if not self.controls.locked:
            return []
        return [region.held_back for region in self.regions() if region.held_back is not None]

    def autonomy_of(self, path: str) -> int:
        """The level that holds for a state or machine: the one that was set last for it, or for what is around it."""
        return self.controls.level(path)

    @property
    def autonomy_levels(self) -> dict[str, int]:
        """The level of the root by its path, and of each sub-tree that has another one than what is around it."""
        return self.controls.levels()

    @property
    def locked(self) -> list[str]:
        """Paths of the states and machines that are locked, sorted."""
        return sorted(self.controls.locked)

    @property
    def breakpoints(self) -> list[str]:
        """Paths of the states and machines with a breakpoint, sorted."""
        return sorted(self.controls.breakpoints)

    def position(self) -> Position:
        """Where the run is, for another run to :meth:`start` there. On its thread, in a call of the observer too."""
        return restoring.position_of(self._root, self.controls, self._decisions, is_paused=self.holds.is_paused)

    # -- commands; from any thread -----------------------------------------------------------------------------------

    def confirm(self, decision_id: str, answer: Answer) -> None:
        """Let what a decision asks for happen."""
        self._command(lambda: commands.confirm(self, decision_id), answer)

    def force(self, path: str, outcome: str, decision_id: str, answer: Answer) -> None:
        """Leave a state or machine by an outcome. ``decision_id`` is the decision that it overrides, or ''."""
        self._command(lambda: commands.force(self, path, outcome, decision_id), answer)

    def repeat(self, path: str, answer: Answer) -> None:
        """Leave an active state or machine, and enter it again when it is at rest."""
        self._command(lambda: commands.repeat(self, path), answer)

    def set_autonomy(self, level: int, path: str, answer: Answer) -> None:
        """Change the level of the run, or of the sub-tree ``path`` ('' or '/' for all, sub-trees included)."""
        self._command(lambda: commands.set_autonomy(self, level, path), answer)

    def lock(self, path: str, answer: Answer) -> None:
        """Hold back each transition that would leave a state or machine, also by leaving what is around it.

        What it wants to be left by is kept until then, forced outcomes too. A stop is not held back, and neither is
        :meth:`repeat` of the locked one itself. What is not active yet is locked in when it is entered.
        """
        self._command(lambda: commands.mark(self, self.controls.locked, path, 'is locked'), answer)

    def unlock(self, path: str, answer: Answer) -> None:
        """Undo :meth:`lock`: what was held back happens, if nothing else keeps it."""
        self._command(lambda: commands.unmark(self, self.controls.locked, path, 'is locked'), answer)

    def set_breakpoint(self, path: str, answer: Answer) -> None:
        """Let each transition out of a state or machine wait for the operator, whatever the autonomy."""
        self._command(lambda: commands.mark(self, self.controls.breakpoints, path, 'has a breakpoint'), answer)

    def clear_breakpoint(self, path: str, answer: Answer) -> None:
        """Undo :meth:`set_breakpoint`; the autonomy decides again, also of what waits."""
        self._command(lambda: commands.unmark(self, self.controls.breakpoints, path, 'has a breakpoint'), answer)

    def pause(self, answer: Answer) -> None:
        """Let the run stand still: no state is executed or left, and time does not pass for the active ones.

        They are told by on_pause. Commands that would leave something are refused until :meth:`resume`, others are not.
        A stop works as ever. What was left before goes on coming to rest, but nothing is entered after it.
        """
        self._command(lambda: self._set_paused(True, 'the run is paused already'), answer)

    def resume(self, answer: Answer) -> None:
        """Go on after :meth:`pause`."""
        self._command(lambda: self._set_paused(False, 'the run is not paused'), answer)

    def look(self, see: Callable[[Mapping[str, Mapping[str, Any]]], None], answer: Answer) -> None:
        """Have ``see`` called between two steps, with the userdata of each active machine by its path, outermost first.

        It gets the values themselves, and has to leave them as they are.
        """
        self._command(lambda: see(self.position().userdata), answer)

    def switch(self, definition: MachineDefinition, answer: Answer) -> None:
        """Go on with another machine, which has the active states at the same paths.

        These are not left and entered for it: the state objects that are active stay, with their userdata, until their
        visit is over. The refusal names each state that cannot stay. on_start and on_stop of all other states are
        called; what waited for the operator is asked again, since it may lead elsewhere now.
        """
        self._command(lambda: self._switch(definition), answer)

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

    def regions(self) -> Iterator[Region]:
        """The regions of everything that is active, outermost first."""
        return self._root.active_regions()

    def locked_inside(self, top: str) -> list[str]:
        """What is active and locked in a state or machine, itself included."""
        locked = [path for path in self.locked if is_inside(path, top)]
        active = {ROOT_PATH, *(node.path for node in self._root.active())} if locked else set()
        return [path for path in locked if path in active]

    def _pause_or_resume_one(self) -> bool:
        """Tell one state that it stands still or goes on; one in a step, so that a stop comes before the next."""
        for leaf in self.active_states():
            if leaf.is_entered and leaf.is_paused != self.holds.is_held(leaf.path):
                if leaf.is_paused:
                    leaf.resume()
                else:
                    leaf.pause()
                self.changed()
                return True
        self.holds.are_news = False
        return False

    # -- commands; on the thread of the run --------------------------------------------------------------------------

    def _command(self, apply: Callable[[], str | None], answer: Answer) -> None:
        self._commands.put(apply, answer)
        self.ring()

    def _set_paused(self, is_paused: bool, refusal: str) -> str | None:
        if self.holds.is_paused is is_paused:
            return refusal
        self.holds.set_paused(is_paused)
        self.changed()
        return None

    def _switch(self, definition: MachineDefinition) -> str | None:
        position = self.position()
        root = ContainerRun(self, definition)
        staying = {leaf.path: leaf for leaf in self.active_states()}
        refusal = switching.prepare(root, self._root, position)
        if refusal is not None:
            return refusal
        old, self._root, self.definition = self._root, root, definition
        self.controls.move_to(definition)
        self.holds.release(ROOT_PATH)
        self.holds.are_news = True
        self._scope = Scope(definition.defaults)
        switching.move(old, root, self._scope, position, staying)
        self.changed()
        return None

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
        self._root.clear()
        self.holds.release(ROOT_PATH)
        for leaf in self._root.leaves():
            leaf.stop()
        self.message = message
        self.outcome = outcome
        self._commands.close('the run has ended')
        self.changed()

    def userdata(self) -> dict[str, Any]:
        """The root machine's userdata."""
        return self._scope.values()

# SPDX-License-Identifier: BSD-3-Clause
"""A run of a state machine.

The host calls :meth:`MachineRun.step` on one thread, whenever ``on_wake`` asks for it and at the time ``next_wake``. A
step takes in the operator's commands, then goes on until nothing more can happen: a chain of instantaneous states is
one step. While nothing happens, nothing is called.
"""

from __future__ import annotations

import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from flexbt_core.clock.clock import Clock
from flexbt_core.state_machine.model.autonomy import AUTONOMY_NAMES, Autonomy, Decision, DecisionKind
from flexbt_core.state_machine.model.definition import ERROR, PREEMPTED, ROOT_PATH, MachineDefinition, is_inside
from flexbt_core.state_machine.model.event_state import EXIT_TIMEOUT, ExitReason
from flexbt_core.state_machine.model.userdata import Scope, StateMachineError

from . import operator_commands as commands
from .controls import Controls, Pausing
from .engine import HaltTimeout, RunningCallback
from .leaf import LeafRun
from .observer import LoggingObserver, RunMonitor, RunObserver
from .operator_commands import CommandQueue, CommandReply
from .region import BlockedTransition, ContainerRun, Region

STOP_TIMEOUT: Final = 30.0
"""How long the end of a run waits until it is confirmed that everything has halted, s."""

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
    ``clock`` is what states see, ``steady`` counts the time that they may take to halt (``exit_timeout``, s). A run
    that is stopped, or ends by a fault, has not ended before everything is confirmed to have halted; when that takes
    longer than ``stop_timeout`` (s), or after :meth:`abort`, it ends as 'error'. Without an ``observer`` the run is
    written to the log of Python; a ``monitor`` checks it. More than ``max_transitions`` in one step count as a
    livelock, which ends the run.
    """

    def __init__(
        self,
        definition: MachineDefinition,
        clock: Clock,
        observer: RunObserver | None = None,
        *,
        autonomy: int = Autonomy.Low,
        userdata: Mapping[str, Any] | None = None,
        services: Any = None,
        steady: Clock | None = None,
        exit_timeout: float = EXIT_TIMEOUT,
        stop_timeout: float = STOP_TIMEOUT,
        max_transitions: int = MAX_TRANSITIONS,
        on_wake: Callable[[], None] | None = None,
        monitor: RunMonitor | None = None,
    ) -> None:
        if autonomy not in AUTONOMY_NAMES:
            raise StateMachineError(commands.no_level(autonomy))
        self.clock = clock
        self.observer: RunObserver = observer if observer is not None else LoggingObserver()
        self.monitor = monitor
        self.services = services
        self.outcome: str | None = None
        self.message = ''
        self.not_halted = ''
        """While the run ends: what has not halted yet, after the path of its state."""
        self.calling: RunningCallback | None = None
        """The callback of a state that is being called; for other threads too."""
        self.pausing = Pausing()
        self.controls = Controls(definition, autonomy)
        self._steady = steady if steady is not None else clock
        self._exit_timeout = exit_timeout
        self._max_transitions = max_transitions
        self._on_wake = on_wake
        self.root = ContainerRun(self, definition)
        self.scope = Scope(definition.defaults)
        """The userdata of the root machine."""
        for key, value in (userdata or {}).items():
            self.scope.set(key, value)
        self.decision_count = 0
        """How many decisions the run has asked the operator for; the next one has the next number as its id."""
        self._commands = CommandQueue()
        self._transitions = 0
        self._recent: deque[str] = deque(maxlen=_LOOP_SHOWN)
        self._end: _End | None = None
        self._preempt_reason: str | None = None
        self._halt_wait = self.new_halt_wait()
        self._stop_timeout = stop_timeout
        self._stop_wait = HaltTimeout(self._steady, max(0.0, stop_timeout - exit_timeout), self.wake)
        self._is_overdue = False  # while it ends: something has not halted in its time, which was told
        self._abort_reason = ''
        self._is_started = False
        self._lock = threading.Lock()

    # -- life --------------------------------------------------------------------------------------------------------

    def start(self, enter: Callable[[], None] | None = None) -> None:
        """Call on_start of every state and enter the first one. Once, on the thread of the run.

        ``enter`` takes the place of entering the first one: :func:`start_at` goes on
        by it where another run was.

        Raises:
            StateMachineError: it was called before.
            StateError: a state is part of another run, which has not ended.
        """
        if self._is_started:
            raise StateMachineError('a run starts only once; make another MachineRun')
        self._is_started = True
        leaves = list(self.root.leaves())
        for leaf in leaves:
            leaf.check_free()
        for leaf in leaves:
            leaf.bind()
        for leaf in leaves:
            if leaf.start():
                self.fail(f'{leaf.path} raised in on_start')
        if self._end is None and self._preempt_reason is None:
            if enter is not None:
                enter()
            if self.monitor is not None:
                self.monitor.begins(self, enter is not None)
            if enter is None:
                self.root.begin(self.scope)
        self.changed()
        self.wake()

    def step(self) -> bool:
        """Do everything that can be done now. True while the run goes on."""
        if self.outcome is not None or not self._is_started:
            return self.outcome is None
        self._transitions = 0
        while self._end is None:
            if self.root.outcome is not None:
                self._end = _End(self.root.outcome, '', ExitReason.OUTCOME)
            elif self._preempt_reason is not None:
                self._end = _End(PREEMPTED, self._preempt_reason, ExitReason.PREEMPTED)
            elif not self._take_one_step() and self._end is None:
                if self.monitor is not None:
                    self.monitor.rests()
                return True
        self._commands.refuse('the run is ending')
        if self.monitor is not None:
            self.monitor.ends()
        return not self._await_halt(self._end)

    def _take_one_step(self) -> bool:
        """Do the first thing that there is to do, and a command with what follows from it; whether there was one."""
        pausing = self.pausing
        if pausing.has_changed and self._pause_or_resume_one():
            return True
        is_commanded = self._commands.apply_next()
        if pausing.is_paused or pausing.has_changed:  # states are told that they go on before anything else
            return is_commanded or pausing.has_changed
        return self.root.advance() or is_commanded

    @property
    def next_wake(self) -> float | None:
        """When a step is due if nothing wakes the run before, on its clock; None when nothing is."""
        if self._end is not None or self.pausing.is_paused:
            return None
        due = self.root.next_wake()
        if self.monitor is None or (checked := self.monitor.next_wake()) is None:
            return due
        return checked if due is None else min(due, checked)

    # -- what the operator sees --------------------------------------------------------------------------------------

    @property
    def definition(self) -> MachineDefinition:
        """The machine; another one after a switch."""
        return self.root.definition

    def active_states(self) -> list[LeafRun]:
        """Return the states that are active."""
        return [node for node in self.root.active() if isinstance(node, LeafRun)]

    def coming(self) -> list[str]:
        """Paths of what is entered as soon as nothing, such as a pause, keeps it from that."""
        return [region.coming.path for region in self.regions() if region.coming is not None]

    def approved(self) -> dict[str, str]:
        """Return what the operator has allowed and has not happened yet: outcomes, by the paths of what is left by
        them."""
        children = [region.child for region in self.regions() if region.is_approved]
        return {child.path: child.outcome for child in children if child is not None and child.outcome is not None}

    @property
    def is_paused(self) -> bool:
        """Whether the operator has paused the run."""
        return self.pausing.is_paused

    @property
    def decisions(self) -> list[Decision]:
        """What waits for the operator, oldest first."""
        found = [region.decision for region in self.regions() if region.decision is not None]
        return sorted(found, key=lambda decision: int(decision.id)) if len(found) > 1 else found

    def subject(self, decision: Decision) -> tuple[dict[str, Any], list[str]]:
        """Return the values that a pending decision is about, by key, and the input keys that have none.

        They are what the state declares as inputs and outputs, or all that its machine knows where it declares nothing.
        The values are those themselves, to be left as they are. On the thread of the run.
        """
        region = next(one for one in self.regions() if one.decision is decision)
        child = region.child
        inputs: tuple[str, ...] = ()
        if isinstance(child, ContainerRun):
            visible, outputs = child.scope.visible(), child.definition.output_keys
        else:
            assert isinstance(child, LeafRun)
            remap, state = child.definition.remap, child.state
            visible = region.container.scope.visible()
            inputs = tuple(remap.get(key, key) for key in state.input_keys)
            outputs = tuple(remap.get(key, key) for key in state.output_keys)
        declared = dict.fromkeys((*inputs, *outputs)) or visible
        return {key: visible[key] for key in declared if key in visible}, [key for key in inputs if key not in visible]

    @property
    def held_back(self) -> list[BlockedTransition]:
        """What is not left since something is locked, outermost first."""
        if not self.controls.locked:
            return []
        return [region.held_back for region in self.regions() if region.held_back is not None]

    def autonomy_of(self, path: str) -> int:
        """Return the level that holds for a state or machine: the one that was set last for it, or for what is around
        it."""
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

    # -- commands; from any thread -----------------------------------------------------------------------------------

    def confirm(self, decision_id: str, answer: CommandReply) -> None:
        """Let what a decision asks for happen."""
        self.command(lambda: commands.confirm(self, decision_id), answer)

    def force(self, path: str, outcome: str, decision_id: str, answer: CommandReply) -> None:
        """Leave a state or machine by an outcome. ``decision_id`` is the decision that it overrides, or ''."""
        self.command(lambda: commands.force(self, path, outcome, decision_id), answer)

    def repeat(self, path: str, answer: CommandReply) -> None:
        """Leave an active state or machine, and enter it again when it has halted."""
        self.command(lambda: commands.repeat(self, path), answer)

    def set_autonomy(self, level: int, path: str, answer: CommandReply) -> None:
        """Change the level of the run, or of the sub-tree ``path`` ('' or '/' for all, sub-trees included)."""
        self.command(lambda: commands.set_autonomy(self, level, path), answer)

    def lock(self, path: str, answer: CommandReply) -> None:
        """Hold back each transition that would leave a state or machine, also by leaving what is around it.

        What it wants to be left by is kept until then, forced outcomes too. A stop is not held back, and neither is
        :meth:`repeat` of the locked one itself. What is not active yet is locked in when it is entered.
        """
        self.command(lambda: commands.mark(self, self.controls.locked, path, 'is locked'), answer)

    def unlock(self, path: str, answer: CommandReply) -> None:
        """Undo :meth:`lock`: what was held back happens, if nothing else keeps it."""
        self.command(lambda: commands.unmark(self, self.controls.locked, path, 'is locked'), answer)

    def set_breakpoint(self, path: str, answer: CommandReply) -> None:
        """Let each transition out of a state or machine wait for the operator, whatever the autonomy."""
        self.command(lambda: commands.mark(self, self.controls.breakpoints, path, 'has a breakpoint'), answer)

    def clear_breakpoint(self, path: str, answer: CommandReply) -> None:
        """Undo :meth:`set_breakpoint`; the autonomy decides again, also of what waits."""
        self.command(lambda: commands.unmark(self, self.controls.breakpoints, path, 'has a breakpoint'), answer)

    def pause(self, answer: CommandReply) -> None:
        """Let the run stand still: no state is executed or left, and time does not pass for the active ones.

        They are told by on_pause. Commands that would leave something are refused until :meth:`resume`, others are not.
        A stop works as ever. What was left before goes on to halt, but nothing is entered after it.
        """
        self.command(lambda: commands.set_paused(self, True), answer)

    def resume(self, answer: CommandReply) -> None:
        """Go on after :meth:`pause`."""
        self.command(lambda: commands.set_paused(self, False), answer)

    def inspect(self, see: Callable[[Mapping[str, Mapping[str, Any]]], None], answer: CommandReply) -> None:
        """Have ``see`` called between two steps, with the userdata of each active machine by its path, outermost first.

        It gets the values themselves, and has to leave them as they are.
        """
        self.command(lambda: see(self._userdata_of_machines()), answer)

    def command(self, apply: Callable[[], str | None], answer: CommandReply) -> None:
        """Have ``apply`` called between two steps; it gives why it refuses, or None.

        When it raises, the command is refused with that, the observer is told of the fault, and the run goes on.
        """

        def applied() -> str | None:
            try:
                return apply()
            except Exception as error:
                self.fault(ROOT_PATH, f'a command raised; the run goes on:\n{traceback.format_exc().rstrip()}')
                return f'fault in the state machine: {type(error).__name__}: {error}'

        self._commands.put(applied, answer)
        self.wake()

    def preempt(self, reason: str = '') -> None:
        """Stop the run, whatever it is doing. It cannot be taken back."""
        with self._lock:
            if self._preempt_reason is None:
                self._preempt_reason = reason
        self.wake()

    def abort(self, reason: str) -> None:
        """End the run as 'error' although something has not halted. Before its time to halt is over nothing happens."""
        if self._is_overdue:
            self._abort_reason = reason
            self.wake()

    @property
    def is_ending(self) -> bool:
        """Whether it is being left for good, or has been."""
        return self._end is not None

    def close_commands(self, reason: str) -> None:
        """Refuse what was commanded and not applied, and whatever will be: the host does not go on with the run."""
        self._commands.close(reason)

    def wake(self) -> None:
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

    def fail(self, message: str) -> None:
        """End the run as an error: there is no way to go on."""
        if self._end is None:
            self._end = _End(ERROR, message, ExitReason.FAULT)

    def new_decision(
        self, kind: DecisionKind, path: str, outcome: str, outcomes: tuple[str, ...], required: int, prompt: str
    ) -> Decision:
        """Return a decision with an id of its own."""
        self.decision_count += 1
        number, now = str(self.decision_count), self.clock.now()
        decision = Decision(number, kind, path, outcome, outcomes, required, prompt, now)
        if self.monitor is not None:
            self.monitor.asked(decision)
        return decision

    def new_halt_wait(self) -> HaltTimeout:
        """Something to wait with for what is left; the run is woken when its time is over."""
        return HaltTimeout(self._steady, self._exit_timeout, self.wake)

    def count_transition(self, path: str) -> None:
        """Watch for livelocks."""
        self._transitions += 1
        self._recent.append(path)
        if self._transitions > self._max_transitions:
            loop = ', '.join(dict.fromkeys(self._recent))
            text = f'{self._max_transitions} transitions without waiting for anything'
            self.fault(path, text)
            self.fail(f'livelock: {text}, the last of them from {loop}')

    def regions(self) -> Iterator[Region]:
        """Return the regions of everything that is active, outermost first."""
        return self.root.active_regions()

    def locked_inside(self, top: str) -> list[str]:
        """Return what is active and locked in a state or machine, itself included."""
        locked = [path for path in self.locked if is_inside(path, top)]
        active = {ROOT_PATH, *(node.path for node in self.root.active())} if locked else set()
        return [path for path in locked if path in active]

    def go_on_with(self, root: ContainerRun) -> None:
        """Have another machine, of which nothing was entered yet, in the place of this one."""
        self.root = root
        self.controls.move_to(root.definition)
        self.pausing.release(ROOT_PATH)
        self.pausing.has_changed = True
        self.scope = Scope(root.definition.defaults)

    def unwritten(self, path: str) -> list[str]:
        """Return what a state or machine reads, of a machine that is active, and nobody has written. On the thread of
        the run.

        These are keys of the machine that it is in.
        """
        machines = [self.root, *(node for node in self.root.active() if isinstance(node, ContainerRun))]
        around, _, label = path.rpartition('/')
        machine = next((one for one in machines if one.path == (around or ROOT_PATH)), None)
        if machine is None:
            return []
        child = machine.definition.children[label]
        if isinstance(child, MachineDefinition):
            keys = [key for key in child.read_inputs if key not in child.defaults]
        else:
            keys = list(child.state.input_keys)
        return [name for key in keys if (name := child.remap.get(key, key)) not in machine.scope]

    def _userdata_of_machines(self) -> dict[str, dict[str, Any]]:
        machines = [self.root, *(node for node in self.root.active() if isinstance(node, ContainerRun))]
        return {machine.path: machine.scope.values() for machine in machines if machine.is_active}

    def _pause_or_resume_one(self) -> bool:
        """Tell one state that it stands still or goes on; one in a step, so that a stop comes before the next."""
        for leaf in self.active_states():
            if leaf.is_entered and leaf.is_paused != self.pausing.holds(leaf.path):
                if leaf.is_paused:
                    leaf.resume()
                else:
                    leaf.pause()
                self.changed()
                return True
        self.pausing.has_changed = False
        return False

    # -- the end -----------------------------------------------------------------------------------------------------

    def _await_halt(self, end: _End) -> bool:
        """Leave everything, and finish when it has halted, or nobody waits for that any more."""
        self.root.leave(end.reason)
        halting = {leaf.path: text for leaf in self.active_states() if (text := leaf.halting()) is not None}
        path, text = next(iter(halting.items()), ('', None))
        shown = '; '.join(f'{path}: {text}' for path, text in halting.items())
        if shown != self.not_halted:
            self.not_halted = shown
            self.changed()
        if not self._is_overdue:
            if not self._halt_wait.is_over(text):
                return False
            if text is not None:
                self._is_overdue = True
                self.fault(path, f'not confirmed to have halted {self._halt_wait.timeout:g} s after the stop: {text}')
        if text is not None and not self._abort_reason:
            if not self._stop_wait.is_over(text):
                return False
            self._abort_reason = f'aborted {self._stop_timeout:g} s after the stop'
        self._stop_wait.cancel()
        if text is None:
            self._finish(end.outcome, end.message)
        else:
            self._finish(ERROR, f'{end.message}; {self._abort_reason}, while {shown}'.removeprefix('; '))
        return True

    def _finish(self, outcome: str, message: str) -> None:
        self.root.clear()
        self.pausing.release(ROOT_PATH)
        for leaf in self.root.leaves():
            leaf.stop()
        self.message = message
        self.outcome = outcome
        if self.monitor is not None:
            self.monitor.ended(outcome)
        self._commands.close('the run has ended')
        self.changed()

    def userdata(self) -> dict[str, Any]:
        """Return the root machine's userdata."""
        return self.scope.values()

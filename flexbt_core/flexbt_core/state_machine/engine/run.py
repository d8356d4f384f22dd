# SPDX-License-Identifier: BSD-3-Clause
"""A run of a state machine.

The host calls :meth:`MachineRun.step` on one thread, whenever ``wake_event`` is set and at the time ``next_wake``. A
step applies the operator's commands, then continues until nothing more can happen: a chain of instantaneous states is
one step. An idle run calls nothing.
"""

from __future__ import annotations

import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Concatenate, Final, ParamSpec

from flexbt_core.clock.clock import Clock
from flexbt_core.clock.waiting import WakeEvent
from flexbt_core.state_machine.model.autonomy import AUTONOMY_NAMES, Autonomy, Decision, no_level
from flexbt_core.state_machine.model.definition import ERROR, PREEMPTED, ROOT_PATH, MachineDefinition, is_inside
from flexbt_core.state_machine.model.event_state import ExitReason
from flexbt_core.state_machine.model.userdata import Scope, StateMachineError

from .controls import Controls
from .engine import Engine, HaltTimeout, RunEnd, RunLimits
from .events import (
    CommandDecided,
    Faulted,
    HaltAwaited,
    LoggingReader,
    RunEnded,
    RunEnding,
    RunReader,
    RunRested,
    RunStarted,
    StatePaused,
    TransitionBlocked,
)
from .leaf import LeafRun
from .region import ContainerRun, Region

_Arguments = ParamSpec('_Arguments')

_RESTED: Final = RunRested()
_ENDING: Final = RunEnding()


_DEFAULT_LIMITS: Final = RunLimits()


class MachineRun(Engine):
    """One run of a machine. Its states cannot be part of another run at the same time.

    ``outcome`` is that of the root machine, 'preempted' after :meth:`preempt`, or 'error', with ``message``.
    ``clock`` is the clock of the states; ``steady`` measures their time to halt. A run that is stopped, or ends by a
    fault, ends only after everything is confirmed to have halted; if that takes too long, or after :meth:`abort`, it
    ends as 'error'. ``readers`` get the events of the run; without any, the run writes to Python's log.
    ``wake_event`` is set when a step is due.
    """

    def __init__(
        self,
        definition: MachineDefinition,
        clock: Clock,
        readers: Iterable[RunReader] | None = None,
        *,
        autonomy: int = Autonomy.Low,
        userdata: Mapping[str, Any] | None = None,
        services: Any = None,
        steady: Clock | None = None,
        limits: RunLimits = _DEFAULT_LIMITS,
        wake_event: WakeEvent | None = None,
    ) -> None:
        if autonomy not in AUTONOMY_NAMES:
            raise StateMachineError(no_level(autonomy))
        steady = steady if steady is not None else clock
        readers = [LoggingReader()] if readers is None else readers
        super().__init__(clock, steady, Controls(definition, autonomy), services, limits, wake_event, readers)
        self.outcome: str | None = None
        self.message = ''
        self.not_halted = ''
        """While the run ends: the work that has not halted yet, with the paths of its states."""
        self.root = ContainerRun(self, definition)
        self.scope = Scope(definition.defaults)
        self.scope.now = clock.now
        """The userdata of the root machine."""
        for key, value in (userdata or {}).items():
            self.scope.set(key, value)
        self._commands: deque[tuple[object, Callable[..., str | None], tuple[Any, ...], dict[str, Any]]] = deque()
        self._refusal: str | None = None
        self._preempt_reason: str | None = None
        self._halt_wait = self.new_halt_wait()
        stop_wait = max(0.0, limits.stop_timeout - limits.exit_timeout)
        self._stop_wait = HaltTimeout(self._steady, stop_wait, self.wake)
        self._is_overdue = False  # while it ends: a state has not halted in time, and the fault was reported
        self._abort_reason = ''
        self._is_started = False
        self._lock = threading.Lock()

    # -- life --------------------------------------------------------------------------------------------------------

    def start(self, enter: Callable[[], None] | None = None) -> None:
        """Call on_start of every state and enter the initial one. Call it once, on the thread of the run.

        ``enter`` is called instead of entering the initial state: :func:`start_at` uses it to continue at the position
        of another run.

        Raises:
            StateMachineError: it was called before.
            StateError: a state is part of another run that has not ended.
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
            active = tuple(leaf.path for leaf in self.active_states())
            self.tell(RunStarted(enter is not None, active, self.approved()))
            if enter is None:
                self.root.begin(self.scope)
        self.wake()

    def step(self) -> bool:
        """Do everything that can be done now. Return True until the run has ended."""
        if self.outcome is not None or not self._is_started:
            return self.outcome is None
        self._transitions = self._repetitions = 0
        while self._end is None:
            if self.root.outcome is not None:
                self._end = RunEnd(self.root.outcome, '', ExitReason.OUTCOME)
            elif self._preempt_reason is not None:
                self._end = RunEnd(PREEMPTED, self._preempt_reason, ExitReason.PREEMPTED)
            elif not self._take_one_step() and self._end is None:
                self.tell(_RESTED)
                return True
        self._refuse_commands('the run is ending')
        self.tell(_ENDING)
        return not self._await_halt(self._end)

    def _take_one_step(self) -> bool:
        """Do the first pending thing: notify a state, or apply a command and advance. Return whether it did any."""
        pausing = self.pausing
        if pausing.has_changed and self._pause_or_resume_one():
            return True
        is_commanded = bool(self._commands)
        if is_commanded:
            self._apply_next_command()
            if self._preempt_reason is not None:
                return True  # the command may have taken long, or may have caused the stop
        if pausing.is_paused or pausing.has_changed:  # states are resumed before anything else
            return is_commanded or pausing.has_changed
        return self.root.advance() or is_commanded

    def _apply_next_command(self) -> None:
        command_id, command, arguments, named = self._commands.popleft()
        try:
            refusal = command(self, *arguments, **named)
        except Exception as error:
            text = f'a command raised; the run continues:\n{traceback.format_exc().rstrip()}'
            self.tell(Faulted(ROOT_PATH, text))
            refusal = f'fault in the state machine: {type(error).__name__}: {error}'
        self.tell(CommandDecided(command_id, refusal))

    def _refuse_commands(self, reason: str) -> None:
        """Refuse the commands received so far; not those that readers add meanwhile, so that the loop ends."""
        for _ in range(len(self._commands)):
            self.tell(CommandDecided(self._commands.popleft()[0], reason))

    @property
    def next_wake(self) -> float | None:
        """Time of the next step on the run's clock unless something wakes the run earlier; None if no step is due."""
        if self._end is not None or self.pausing.is_paused:
            return None
        due = self.root.next_wake()
        for reader in self._readers:
            read = reader.next_wake()
            if read is not None and (due is None or read < due):
                due = read
        return due

    # -- state of the run, for the operator --------------------------------------------------------------------------

    @property
    def definition(self) -> MachineDefinition:
        """The machine; another one after a switch."""
        return self.root.definition

    def active_states(self) -> list[LeafRun]:
        """Return the states that are active."""
        return [node for node in self.root.active() if isinstance(node, LeafRun)]

    def coming(self) -> list[str]:
        """Return the paths of the nodes to enter as soon as nothing, such as a pause, prevents it."""
        return [region.coming.path for region in self.regions() if region.coming is not None]

    def approved(self) -> dict[str, str]:
        """Return the transitions that the operator has allowed and that have not happened yet, as outcomes by
        path."""
        children = [region.child for region in self.regions() if region.is_approved]
        return {child.path: child.outcome for child in children if child is not None and child.outcome is not None}

    @property
    def is_paused(self) -> bool:
        """True if the operator has paused the run."""
        return self.pausing.is_paused

    @property
    def decisions(self) -> list[Decision]:
        """Decisions that wait for the operator, oldest first."""
        found = [region.decision for region in self.regions() if region.decision is not None]
        return sorted(found, key=lambda decision: int(decision.id)) if len(found) > 1 else found

    def subject(self, decision: Decision) -> tuple[dict[str, Any], list[str]]:
        """Return the values that a pending decision is about, by key, and the input keys without a value.

        These are the declared inputs and outputs of the state, or all values of its machine if it declares none. Do not
        change the values: they are not copies. Call it on the thread of the run.
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
    def blocked(self) -> list[TransitionBlocked]:
        """Transitions that a lock blocks, outermost first."""
        if not self.controls.locked:
            return []
        return [region.blocked for region in self.regions() if region.blocked is not None]

    @property
    def locked(self) -> list[str]:
        """Paths of the states and machines that are locked, sorted."""
        return sorted(self.controls.locked)

    @property
    def breakpoints(self) -> list[str]:
        """Paths of the states and machines with a breakpoint, sorted."""
        return sorted(self.controls.breakpoints)

    # -- commands; from any thread -----------------------------------------------------------------------------------

    def command(
        self,
        command_id: object,
        command: Callable[Concatenate[MachineRun, _Arguments], str | None],
        *arguments: _Arguments.args,
        **named: _Arguments.kwargs,
    ) -> None:
        """Apply a command between two steps; one :class:`CommandDecided` follows, with ``command_id`` (any object).

        ``command`` is called with the run and the arguments. It returns the reason for a refusal, or None. The
        operator's commands are in :mod:`operator_commands`. If it raises, it is refused with the error, and the run
        continues.
        """
        with self._lock:
            refusal = self._refusal
            if refusal is None:
                self._commands.append((command_id, command, arguments, named))
        if refusal is not None:
            self.tell(CommandDecided(command_id, refusal))
        self.wake()

    def preempt(self, reason: str = '') -> None:
        """Stop the run, whatever it is doing. This cannot be undone."""
        with self._lock:
            if self._preempt_reason is None:
                self._preempt_reason = reason
        self.wake()

    def abort(self, reason: str) -> None:
        """End the run as 'error' although a state has not halted. Has no effect until its time to halt is over."""
        if self._is_overdue:
            self._abort_reason = reason
            self.wake()

    @property
    def is_ending(self) -> bool:
        """True if the run is ending or has ended."""
        return self._end is not None

    def close_commands(self, reason: str) -> None:
        """Refuse pending and future commands. For a host that stops stepping the run."""
        with self._lock:
            self._refusal = reason
        self._refuse_commands(reason)

    # -- for the states and machines of the run ----------------------------------------------------------------------

    def regions(self) -> Iterator[Region]:
        """Return the regions of all active machines, outermost first."""
        return self.root.active_regions()

    def locked_inside(self, top: str) -> list[str]:
        locked = [path for path in self.locked if is_inside(path, top)]
        if not locked:
            return []
        nodes = [one.child or (one.coming if one.is_resumed else None) for one in self.regions()]
        active = {ROOT_PATH, *(node.path for node in nodes if node is not None)}
        return [path for path in locked if path in active]

    def go_on_with(self, root: ContainerRun) -> None:
        """Replace the machine by another one, of which no state has been entered yet."""
        for region in self.regions():
            region.wait_no_longer()
        self.root = root
        self.controls.move_to(root.definition)
        self.pausing.release(ROOT_PATH)
        now, self.scope = self.scope.now, Scope(root.definition.defaults)
        self.scope.now = now

    def unwritten(self, path: str) -> list[str]:
        """Return the keys that a state or machine in an active machine reads and that have no value.

        The keys are named as in the parent machine. Call it on the thread of the run.
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

    def userdata_of_machines(self) -> dict[str, dict[str, Any]]:
        """Return the userdata of each active machine by path, outermost first. The values are not copies."""
        machines = [self.root, *(node for node in self.root.active() if isinstance(node, ContainerRun))]
        return {machine.path: machine.scope.values() for machine in machines if machine.is_active}

    def writers_of_machines(self) -> dict[str, dict[str, tuple[str, float]]]:
        """Return who has written the userdata of each active machine: the path of the state and the time, by key."""
        machines = [self.root, *(node for node in self.root.active() if isinstance(node, ContainerRun))]
        return {machine.path: dict(machine.scope.writers) for machine in machines if machine.is_active}

    def _pause_or_resume_one(self) -> bool:
        """Pause or resume one state, and return whether one needed it. One per step, so that a stop comes first."""
        for region in self.regions():
            leaf = region.child
            if isinstance(leaf, LeafRun) and leaf.is_entered and leaf.is_paused != self.pausing.holds(leaf.path):
                wanted = leaf.outcome
                if leaf.is_paused:
                    leaf.resume()
                else:
                    leaf.pause()
                if leaf.outcome != wanted:  # it raised; the operator has approved the outcome before that
                    region.is_approved = False
                self.tell(StatePaused(leaf.path, leaf.is_paused))
                return True
        self.pausing.has_changed = False
        return False

    # -- the end -----------------------------------------------------------------------------------------------------

    def _await_halt(self, end: RunEnd) -> bool:
        """Leave everything. Finish and return True once everything has halted or its time is over."""
        self.root.leave(end.reason)
        halting = {leaf.path: text for leaf in self.active_states() if (text := leaf.halting()) is not None}
        path, text = next(iter(halting.items()), ('', None))
        shown = '; '.join(f'{path}: {text}' for path, text in halting.items())
        if shown != self.not_halted:
            self.not_halted = shown
            self.tell(HaltAwaited(shown))
        if not self._is_overdue:
            if not self._halt_wait.is_over(text):
                return False
            if text is not None:
                self._is_overdue = True
                waited = f'not confirmed to have halted {self._halt_wait.timeout:g} s after the stop: {text}'
                self.tell(Faulted(path, waited))
        if text is not None and not self._abort_reason:
            if not self._stop_wait.is_over(text):
                return False
            self._abort_reason = f'aborted {self._limits.stop_timeout:g} s after the stop'
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
        self.tell(RunEnded(outcome, message))
        self.close_commands('the run has ended')

    def userdata(self) -> dict[str, Any]:
        """Return the root machine's userdata."""
        return self.scope.values()

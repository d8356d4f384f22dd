# SPDX-License-Identifier: BSD-3-Clause
"""One run of a tree on its own thread, and its outcome. A leaf that blocks delays only its own tree.

The thread sleeps until a leaf wakes the tree, until a time that a node has requested, or until the minimum tick rate
requires the next tick.
"""

from __future__ import annotations

import math
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Final, Generic, TypeVar

from flexbt_common.runtime.node_runtime import Runtime
from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.engine.observers import StatusLog
from flexbt_core.behavior_tree.engine.tick_control import TickCommand, TickControl
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.errors import BehaviorTreeError, NodeExecutionError, TickAbandoned
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.clock.rates import RepeatedReports
from flexbt_core.clock.waiting import WakeEvent
from flexbt_core.monitors.monitoring import Findings, violation_text
from flexbt_core.monitors.properties import Violation
from flexbt_core.monitors.tree_monitor import TreeMonitor
from flexbt_msgs.action import BtExecute
from flexbt_server.parameters import ServerParameters
from flexbt_server.trees.blackboards import NO_RECOVERIES, RECOVERIES_KEY, Value, write_all
from flexbt_server.trees.tree_store import FoundTree

from .run_events import (
    OfferRefused,
    PropertyViolated,
    RoundEnded,
    RunAdopted,
    RunEvents,
    RunOutcome,
    RunPaused,
    RunStarted,
    RunWarning,
    TreeExpanded,
)

_GRACE: Final = 0.2
"""Extra time after the time to halt in which the run itself can report nodes that have not halted, s."""

_HAS_ENDED: Final = 'the run has ended'
_NOT_HALTED: Final = 'not halted in time'
_ROUND_ENDED: Final = RoundEnded()

Client = TypeVar('Client')


class TreeRun(Generic[Client]):
    """A run of a tree for a client, until it completes or is stopped; another client may take it over meanwhile.

    The run emits its events to ``events``. :meth:`accept_offer` returns a client that was offered too late.

    A paused tree is not ticked, so it cannot end by itself. It can be stopped and taken over as usual.

    A leaf that does not return from its tick cannot be halted, and its thread cannot be ended. If such a leaf blocks a
    stopped run, the run ends as ERROR when its time to halt is over, on the thread of ``steady``. If the leaf returns
    later, the tree is halted and the thread ends.

    ``board`` is private to the run for the number of recoveries and for ``error_code_names``, as in Nav2, where one
    tree runs at a time. For all other keys it is the blackboard passed to the run.

    Its thread is part of the ``health`` of the process during the run, except while a breakpoint holds the tree.
    """

    def __init__(
        self,
        runtime: Runtime,
        parameters: ServerParameters,
        services: Any,
        found: FoundTree,
        board: Blackboard,
        client: Client,
        values: Sequence[Value],
        events: RunEvents,
    ) -> None:
        self.key = found.key
        self.tree: Tree | None = None
        self.board = board.with_own([RECOVERIES_KEY, *parameters.error_code_names])
        self._parameters = parameters
        self._library = found.library
        self._client = client
        self._values = values
        self._clock = runtime.clock
        self._steady = runtime.steady
        self._services = services
        self._events = events
        self._tick_period = 1.0 / parameters.tick_rate
        self._livelocks = RepeatedReports(1.0, self._steady.now)
        self._overruns = TickOverrunWarner(self.key.id, self._tick_period, self._steady.now)
        self._waited = 0.0
        self._findings = Findings(self._report_finding)
        self._monitor: TreeMonitor | None = None
        self._wake_event = WakeEvent()
        self._control = TickControl(self._wake_event.set, self._report_pause)
        self._loop = runtime.health.loop(f'the thread of tree {self.key.id!r}', self._is_where, self._has_callbacks)
        self._lock = threading.Lock()
        self._stop_reason: str | None = None
        self._rest_by = math.inf
        self._ended = False
        self._offer: tuple[Client, Sequence[Value]] | None = None
        self._thread = threading.Thread(target=self._run, name=f'tree {self.key.id}', daemon=True)

    def start(self) -> None:
        """Start ticking. The run ends as ERROR if the computer has no thread left."""
        try:
            self._thread.start()
        except RuntimeError as error:
            why = f'the tree cannot run: {error}; end something that runs on this computer, or raise its limits'
            self._end(RunOutcome(BtExecute.Result.ERROR, why))

    def stop(self, client: Client, reason: str, within: float | None = None) -> None:
        """Halt the tree; it ends as CANCELED. From any thread. The first reason and the earliest deadline count.

        ``within``: time for the tree to halt before the run ends as ERROR, s; by default the cancel timeout.
        No effect if the run works for another client by now.
        """
        with self._lock:
            if self._client is not client:
                return
            if self._stop_reason is None:
                self._stop_reason = reason
            rest_by = self._steady.now() + (self._parameters.cancel_timeout if within is None else within)
            sooner = rest_by < self._rest_by
            if sooner:
                self._rest_by = rest_by
        self._wake_event.set()
        if self.tree is not None:
            self.tree.callbacks.release()
        if sooner:
            self._steady.call_at(rest_by + _GRACE, self._abort)

    def offer(self, client: Client, values: Sequence[Value]) -> Client | None:
        """Offer the run to ``client``, with new values. Return the client whose offer this one replaces, or None."""
        with self._lock:
            replaced = self._offer
            self._offer = (client, values)
        self._wake_event.set()
        return replaced[0] if replaced is not None else None

    def remove_client(self, client: Client) -> bool:
        """Withdraw an offer. Return False if it is no longer open."""
        with self._lock:
            if self._offer is None or self._offer[0] is not client:
                return False
            self._offer = None
            return True

    def accept_offer(self) -> Client | None:
        """Close the open offer and return its client, or None."""
        with self._lock:
            offer, self._offer = self._offer, None
        return None if offer is None else offer[0]

    def wake(self) -> None:
        """Cause a tick soon, unless the tree is paused. From any thread."""
        self._wake_event.set()

    def control(self, command: TickCommand, answer: Callable[[str], None]) -> None:
        """Pause, resume or step; from any thread. See :class:`TickControl`."""
        self._control.command(command, answer)

    @property
    def not_paused(self) -> tuple[str, ...]:
        """Leaves that continue while the tree is paused, as 'path: why'."""
        return self._control.not_paused

    @property
    def not_ended(self) -> list[str]:
        """Canceled goals of leaves of any tree that continue, as text for people."""
        given_up = self.tree.unfinished if self._ended and self.tree is not None else ()
        return self._services.ending.overdue(given_up)

    def hold(self, reason: str) -> None:
        """Keep the tree paused for a reason of the host, or release it with ''. From any thread."""
        self._control.hold(reason)

    def join(self, timeout: float) -> None:
        """Wait until the run is over, at most ``timeout`` seconds."""
        self._thread.join(timeout)

    def _abort(self) -> None:
        """End the run as ERROR unless its thread has ended it."""
        if self._ended:
            return
        node = node_on_stack(self._thread)
        path = '' if node is None else node.path
        self._loop.close()  # it drives nothing any more
        if self.tree is not None:
            self.tree.abandon()
        self._end(RunOutcome(BtExecute.Result.ERROR, f'{self._stop_reason}; {_NOT_HALTED}: {_where(path)}', path))

    def _is_where(self) -> str:
        node = node_on_stack(self._thread)
        return _where('' if node is None else node.path)

    def _has_callbacks(self) -> bool:
        return self.tree is not None and self.tree.callbacks.active

    def _end(self, outcome: RunOutcome) -> None:
        with self._lock:
            if self._ended:
                return
            self._ended = True
        self._control.close(_HAS_ENDED)
        wrong = '' if self._findings.first is None else violation_text(self._findings.first)
        if wrong not in outcome.message:
            outcome = replace(outcome, message='; '.join(filter(None, [outcome.message, wrong])))
        self._events.end(replace(outcome, error_code=self._error_code()))

    def _error_code(self) -> int:
        codes = (self.board.get_or(name, 0) for name in self._parameters.error_code_names)
        return min((code for code in codes if isinstance(code, int) and code > 0), default=0)

    # -- on the thread of the run ------------------------------------------------------------------------------------

    def _run(self) -> None:
        with self._loop:
            executed = outcome_of(self._execute)
            self._end(outcome_of(lambda: self._await_halt(executed)))

    def _execute(self) -> RunOutcome:
        write_all(self.board, [*self._values, NO_RECOVERIES])
        log = self._events.log
        monitor = self._monitor = self._new_monitor()
        tree = self.tree = Tree(
            self._library,
            self.key.id,
            file=self.key.file,
            blackboard=self.board,
            clock=self._clock,
            services=self._services,
            on_wake=self.wake,
            substitute=None if monitor is None else monitor.watched,
        )
        tree.on_livelock = self._report_livelock
        tree.observe(
            *(() if log is None else (StatusLog(log),)),
            after_round=self._report_round,
            on_expanded=self._report_expansion,
        )
        if monitor is not None:
            monitor.begins(tree)
            for problem in self._parameters.monitoring.problems_of(self.key.id, monitor.vocabulary):
                self._events.emit(PropertyViolated(problem))
            monitor.check_parts()
        tree.context.resting = self._waiting_in_tick
        tree.empty_outputs({key.removeprefix('@') for key, *_ in self._values})
        self._events.emit(RunStarted(tree, self._control))
        due = -math.inf
        while True:
            self._adopt()
            if self._stop_reason is not None:
                return RunOutcome(BtExecute.Result.CANCELED, self._stop_reason)
            tree.take_wake()
            due = self._next_due(due)
            began, self._waited = self._steady.now(), 0.0
            try:
                status = self._control.tick(tree)
            except TickAbandoned:
                if not tree.callbacks.released:
                    raise
                continue
            if monitor is not None and status is not None:
                monitor.ticked(status)
            if not tree.callbacks.active:  # do not blame leaves for breakpoints
                self._warn(self._overruns.note(self._steady.now() - began - self._waited))
            if status is not None and status is not NodeStatus.RUNNING:
                return outcome_of_tree(tree, status)
            # A leaf that has waited ends the rounds of a tick; nodes that yield expect the next one at once.
            if not self._control.pending and not (tree.context.waited and tree.wake_pending):
                self._wait(tree, due)

    def _new_monitor(self) -> TreeMonitor | None:
        monitoring = self._parameters.monitoring
        if not monitoring.is_on:
            return None
        return TreeMonitor(self._findings.add, monitoring.requirements_of(self.key.id), is_woken_only=True)

    def _report_finding(self, violation: Violation) -> None:
        text = violation_text(violation)
        self._events.emit(PropertyViolated(f'tree [{self.key.id}]: {text}'))
        if self._parameters.monitoring.stops:
            self.stop(self._client, text)

    def _next_due(self, due: float) -> float:
        """Return the time of the next tick: a period after the last due time, if that tick was periodic and on time."""
        now = self._clock.now()
        period = self._tick_period
        return due + period if due <= now < due + period else now + period

    def _report_round(self) -> None:
        if not self._ended:  # it may have been aborted during the tick
            self._events.emit(_ROUND_ENDED)

    def _report_pause(self, is_paused: bool) -> None:
        if self._monitor is not None:
            self._monitor.paused(is_paused)
        self._events.emit(RunPaused(is_paused))

    def _report_expansion(self) -> None:
        if self.tree is not None and not self._ended:
            self._events.emit(TreeExpanded(self.tree))

    def _report_livelock(self, message: str) -> None:
        if self._livelocks.held_before() is not None:
            self._warn(message)

    def _warn(self, text: str) -> None:
        if text:
            self._events.emit(RunWarning(text))

    def _adopt(self) -> None:
        with self._lock:
            if self._offer is None or self._stop_reason is not None:
                return
            (client, values), self._offer = self._offer, None
            try:
                write_all(self.board, [*values, NO_RECOVERIES])
            except BehaviorTreeError as error:
                refusal = str(error)
            else:
                refusal = ''
                self._client = client
        self._events.emit(OfferRefused(client, refusal) if refusal else RunAdopted(client))

    @contextmanager
    def _waiting_in_tick(self) -> Iterator[None]:
        """Let a leaf wait for another thread. Meanwhile the run does not count as stuck, nor the leaf as blocking."""
        began = self._steady.now()
        with self._loop.resting():
            yield
        self._waited += self._steady.now() - began

    def _wait(self, tree: Tree, due: float) -> None:
        next_wake = tree.next_wake
        until = due if next_wake is None else min(due, next_wake)
        with self._loop.resting():
            self._wake_event.wait(self._clock, None if self._control.paused else until)

    def _await_halt(self, outcome: RunOutcome) -> RunOutcome:
        """Halt everything and wait until the leaves have confirmed it."""
        self._control.close(_HAS_ENDED)
        tree = self.tree
        if tree is None:
            return outcome
        outcome = outcome_after(tree.halt, outcome)
        if self._monitor is not None:
            self._monitor.halted()
        deadline = self._steady.now() + self._parameters.cancel_timeout
        while tree.unfinished and self._steady.now() < min(deadline, self._rest_by):
            with self._loop.resting():
                self._wake_event.wait(
                    self._steady, min(deadline, self._rest_by, self._steady.now() + self._tick_period)
                )
            outcome = outcome_after(tree.advance_unfinished, outcome)
        if tree.unfinished:
            message = f'{_NOT_HALTED}: {", ".join(tree.unfinished)}'
            outcome = replace(
                outcome,
                code=BtExecute.Result.ERROR,
                message=f'{outcome.message}; {message}' if outcome.message else message,
            )
        return outcome


def _where(path: str) -> str:
    return f'[{path}] does not return' if path else 'the run does not come to its end'


# The outcome of a run for its client, even if a tree or a leaf fails.


def outcome_of_tree(tree: Tree, status: NodeStatus) -> RunOutcome:
    """Return the outcome for the status with which a tree has completed."""
    if status is NodeStatus.SUCCESS:
        return RunOutcome(BtExecute.Result.SUCCESS)
    if status is NodeStatus.SKIPPED:
        return RunOutcome(BtExecute.Result.FAILURE, 'the tree was skipped: no node had anything to do')
    failure = tree.failure
    assert failure is not None  # the engine has one for every FAILURE
    return RunOutcome(BtExecute.Result.FAILURE, str(failure.steps[0]), failure.path, tuple(failure.lines()))


def outcome_after(step: Callable[[], None], outcome: RunOutcome) -> RunOutcome:
    """Run a step of halting and return the outcome. If a leaf raises, it is an ERROR with the leaf's error after the
    reason of the end. The failed node stays the first one.
    """
    try:
        step()
    except NodeExecutionError as error:
        halting = _error(error)
        return replace(
            outcome if outcome.failed_node else halting,
            code=BtExecute.Result.ERROR,
            message='; '.join(filter(None, (outcome.message, f'while halting: {halting.message}'))),
        )
    return outcome


def _error(error: NodeExecutionError) -> RunOutcome:
    message = '; '.join((str(error), *getattr(error, '__notes__', ())))
    return RunOutcome(BtExecute.Result.ERROR, message, error.node_path, tuple(error.trace.lines()))


def outcome_of(step: Callable[[], RunOutcome]) -> RunOutcome:
    """Return the outcome of a step of a run, or an ERROR if the step raises, since the client of the goal needs a
    result."""
    try:
        return step()
    except NodeExecutionError as error:
        return _error(error)
    except BehaviorTreeError as error:
        return RunOutcome(BtExecute.Result.ERROR, str(error))
    except BaseException:  # a fault of the server
        return RunOutcome(BtExecute.Result.ERROR, f'fault in the BT server: {traceback.format_exc()}')


class TickOverrunWarner:
    """A warning about ticks that take longer than the tick period, at most once a second."""

    def __init__(self, tree: str, period: float, now: Callable[[], float]) -> None:
        self._tree = tree
        self._period = period
        self._longest = 0.0
        self._reports = RepeatedReports(1.0, now)

    def note(self, took: float) -> str:
        """Record the duration of the last tick, s. Return a warning, or '' if none is due."""
        if took <= self._period:
            return ''
        self._longest = max(self._longest, took)
        held = self._reports.held_before()
        if held is None:
            return ''
        longest, self._longest = self._longest, 0.0
        return (
            f'tree [{self._tree}]: {held + 1} ticks took longer than the period of {self._period:.3f} s '
            f'(parameter tick_rate), the longest {longest:.3f} s; no leaf should block'
        )


# The node whose code a ticking thread is executing.


def node_on_stack(thread: threading.Thread) -> TreeNode | None:
    """Return the innermost node whose methods are on the stack of ``thread``, or None."""
    frame = sys._current_frames().get(thread.ident or 0)
    while frame is not None:
        owner = frame.f_locals.get('self')
        if isinstance(owner, TreeNode):
            return owner
        frame = frame.f_back
    return None

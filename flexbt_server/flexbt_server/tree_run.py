# SPDX-License-Identifier: BSD-3-Clause
"""One run of a tree, in a thread of its own: a leaf that blocks holds up its own tree and nothing else.

The thread sleeps until a leaf wakes the tree, until a time that a node has asked for, or until the next tick that the
least rate demands.
"""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from flexbt_common.bell import Bell
from flexbt_common.clock import Clock
from flexbt_msgs.action import BtExecute
from flexbt_server.behavior_tree import (
    BehaviorTreeError,
    Blackboard,
    NodeExecutionError,
    NodeStatus,
    Tree,
    TreeKey,
    TreeLibrary,
    TreeNode,
)
from flexbt_server.blackboards import NO_RECOVERIES, Value, write_all


@dataclass(frozen=True)
class RunOutcome:
    """How a run has ended; ``code`` is a constant of BtExecute.Result."""

    code: int
    message: str = ''
    failed_node: str = ''


class TreeObserver(Protocol):
    """Hears of a run, on the thread of the run."""

    def started(self, tree: Tree) -> None:
        """The nodes exist; the first tick is next."""

    def changed(self, node: TreeNode, before: NodeStatus, after: NodeStatus) -> None:
        """A node has another status."""

    def ticked(self) -> None:
        """A tick is over."""

    def ended(self) -> None:
        """Nothing follows."""


Client = TypeVar('Client')


class TreeRun(Generic[Client]):
    """Runs a tree for a client, until it completes or is stopped; another client may take it over meanwhile.

    The callbacks are called on the thread of the run: ``on_adopted(client)`` when the run works for another client,
    ``on_refused(client, reason)`` when it cannot because its values do not fit (the run goes on as before), and
    ``on_end(outcome)``. A client that was offered too late to be adopted is left to :meth:`take_offer`.
    """

    def __init__(
        self,
        library: TreeLibrary,
        key: TreeKey,
        board: Blackboard,
        client: Client,
        values: Sequence[Value],
        *,
        clock: Clock,
        steady: Clock,
        services: Any,
        observer: TreeObserver,
        tick_rate: float,
        cancel_timeout: float,
        on_adopted: Callable[[Client], None],
        on_refused: Callable[[Client, str], None],
        on_end: Callable[[RunOutcome], None],
    ) -> None:
        self.key = key
        self.tree: Tree | None = None
        self._library = library
        self._board = board
        self._client = client
        self._values = values
        self._clock = clock
        self._steady = steady
        self._services = services
        self._observer = observer
        self._tick_period = 1.0 / tick_rate
        self._cancel_timeout = cancel_timeout
        self._on_adopted = on_adopted
        self._on_refused = on_refused
        self._on_end = on_end
        self._bell = Bell()
        self._lock = threading.Lock()
        self._stop_reason: str | None = None
        self._offer: tuple[Client, Sequence[Value]] | None = None
        self._thread = threading.Thread(target=self._run, name=f'tree {key.id}', daemon=True)

    def start(self) -> None:
        """Begin to tick."""
        self._thread.start()

    def stop(self, client: Client, reason: str) -> None:
        """Halt the tree; it ends as CANCELED. From any thread; the first reason counts.

        Does nothing when the run works for another client by now.
        """
        with self._lock:
            if self._client is client and self._stop_reason is None:
                self._stop_reason = reason
        self._bell.ring()

    def offer(self, client: Client, values: Sequence[Value]) -> Client | None:
        """Let ``client`` take the run over, with new values. Gives the client whose offer this one replaces."""
        with self._lock:
            replaced = self._offer
            self._offer = (client, values)
        self._bell.ring()
        return replaced[0] if replaced is not None else None

    def withdraw(self, client: Client) -> bool:
        """Take an offer back; False when it is not open any more."""
        with self._lock:
            if self._offer is None or self._offer[0] is not client:
                return False
            self._offer = None
            return True

    def take_offer(self) -> Client | None:
        """The client whose offer is open, which is not any more."""
        with self._lock:
            offer, self._offer = self._offer, None
        return None if offer is None else offer[0]

    def wake(self) -> None:
        """Tick soon. From any thread."""
        self._bell.ring()

    def join(self, timeout: float) -> None:
        """Wait until the run is over, at most ``timeout`` seconds."""
        self._thread.join(timeout)

    # -- on the thread of the run ------------------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            outcome = self._execute()
        except BehaviorTreeError as error:
            failed_node = error.node_path if isinstance(error, NodeExecutionError) else ''
            outcome = RunOutcome(BtExecute.Result.ERROR, str(error), failed_node)
        except Exception:  # a fault of ours or of a node's code: it goes to whoever gave the goal
            outcome = RunOutcome(BtExecute.Result.ERROR, f'fault in the BT server: {traceback.format_exc()}')
        outcome = self._come_to_rest(outcome)
        try:
            self._observer.ended()
        finally:
            self._on_end(outcome)

    def _execute(self) -> RunOutcome:
        write_all(self._board, [*self._values, NO_RECOVERIES])
        tree = self.tree = Tree(
            self._library,
            self.key.id,
            file=self.key.file,
            blackboard=self._board,
            clock=self._clock,
            services=self._services,
            on_wake=self.wake,
        )
        tree.observe(self._observer.changed)
        self._observer.started(tree)
        while True:
            self._adopt()
            if self._stop_reason is not None:
                return RunOutcome(BtExecute.Result.CANCELED, self._stop_reason)
            tree.take_wake()
            status = tree.tick_once()
            self._observer.ticked()
            if status is not NodeStatus.RUNNING:
                return self._outcome(tree, status)
            self._wait(tree)

    def _adopt(self) -> None:
        with self._lock:
            if self._offer is None or self._stop_reason is not None:
                return
            (client, values), self._offer = self._offer, None
            try:
                write_all(self._board, [*values, NO_RECOVERIES])
            except BehaviorTreeError as error:
                refusal = str(error)
            else:
                refusal = ''
                self._client = client
        if refusal:
            self._on_refused(client, refusal)
        else:
            self._on_adopted(client)

    def _wait(self, tree: Tree) -> None:
        now = self._clock.now()
        until = now + self._tick_period
        if tree.next_wake is not None:
            until = min(until, tree.next_wake)
        self._bell.wait(self._clock, until)

    def _outcome(self, tree: Tree, status: NodeStatus) -> RunOutcome:
        if status is NodeStatus.SUCCESS:
            return RunOutcome(BtExecute.Result.SUCCESS)
        if status is NodeStatus.SKIPPED:
            return RunOutcome(BtExecute.Result.FAILURE, 'the tree was skipped: no node had anything to do')
        failure = tree.failure
        assert failure is not None  # the engine gives one for every FAILURE
        return RunOutcome(BtExecute.Result.FAILURE, f'{failure.path}: {failure.reason}', failure.path)

    def _come_to_rest(self, outcome: RunOutcome) -> RunOutcome:
        """Halt everything and wait until the leaves have confirmed it."""
        tree = self.tree
        if tree is None:
            return outcome
        outcome = _halting(tree.halt, outcome)
        deadline = self._steady.now() + self._cancel_timeout
        while tree.unfinished and self._steady.now() < deadline:
            self._bell.wait(self._steady, min(deadline, self._steady.now() + self._tick_period))
            outcome = _halting(tree.advance_unfinished, outcome)
        if tree.unfinished:
            what = ', '.join(tree.unfinished)
            message = f'not at rest {self._cancel_timeout:g} s after the halt: {what}'
            outcome = RunOutcome(
                BtExecute.Result.ERROR,
                f'{outcome.message}; {message}' if outcome.message else message,
                outcome.failed_node,
            )
        return outcome


def _halting(step: Callable[[], None], outcome: RunOutcome) -> RunOutcome:
    """Takes a step toward rest; gives the outcome, which an error of a leaf changes."""
    try:
        step()
    except NodeExecutionError as error:
        return RunOutcome(BtExecute.Result.ERROR, f'{outcome.message}; while halting: {error}', error.node_path)
    return outcome

# SPDX-License-Identifier: BSD-3-Clause
"""The goals of a server: each starts the run of a tree, or takes over the run of the same tree.

Everything here runs on the executor thread. Runs and file reading have separate threads and report back.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from geometry_msgs.msg import PoseStamped

from flexbt_common.calls.goal_server import ServedGoal
from flexbt_common.runtime.health import Hang
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_core.behavior_tree.engine.tick_control import TickCommand
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.definition import TreeKey
from flexbt_core.clock.clock import Timer
from flexbt_core.clock.work_thread import WorkThread
from flexbt_core.errors import FlexbtError
from flexbt_core.values.text import sanitize_for_message, short_repr
from flexbt_msgs.action import BtExecute
from flexbt_server.errors import UnknownRunError
from flexbt_server.leaves.leaf_services import LeafServices
from flexbt_server.leaves.topic_cache import SubscribedTopic
from flexbt_server.parameters import ServerParameters
from flexbt_server.runs.run_events import (
    OfferRefused,
    PropertyViolated,
    RunAdopted,
    RunEnded,
    RunEvent,
    RunEvents,
    RunOutcome,
    RunReader,
    RunWarning,
    RunWatcher,
)
from flexbt_server.runs.tree_run import TreeRun
from flexbt_server.trees.blackboards import Blackboards, Value
from flexbt_server.trees.tree_store import FoundTree, TreeStore

from .goal_owners import GoalOwners

ExecuteResult = BtExecute.Result

MESSAGE_LIMIT: Final = 10_000
"""Maximum number of characters of a message to a client."""

RETURN_SECONDS: Final = 3.5
"""Time for which trees are held after the process was stopped, s of wall time: until it has found the other nodes again
and received their requests. By default, Fast DDS resends messages lost in full queues after 3 s."""

_REPORT_SECONDS: Final = 0.3
"""Time beyond its time to halt after which a run reports that it has not halted, s."""

MOST_PAUSING: Final = 20
"""Maximum number of nodes that may hold one tree paused: each is watched."""

_BY_CLIENT: Final = 'canceled by the client'


class TreeGoals:
    """The goals of all actions of a server, and the trees that run for them."""

    def __init__(
        self,
        runtime: Runtime,
        parameters: ServerParameters,
        store: TreeStore,
        boards: Blackboards,
        services: LeafServices,
        reader: WorkThread,
        watchers: Sequence[RunWatcher] = (),
    ) -> None:
        self._runtime = runtime
        self._parameters = parameters
        self._store = store
        self._boards = boards
        self._services = services
        self._reader = reader
        self._watchers = watchers
        self._pose = services.topics.cache(SubscribedTopic(PoseStamped, parameters.pose_topic))  # like the leaves
        self.running = RunningTrees()
        self.owners = GoalOwners(runtime, parameters.peer_timeout)
        self._goals: dict[ServedGoal, TreeGoal] = {}  # goals of different actions may have the same ID
        self._no_goals = threading.Event()
        self._no_goals.set()
        self._returned = ''
        runtime.health.on_hang(self._after_hang)
        runtime.on_close(lambda: runtime.health.cancel_on_hang(self._after_hang))

    @property
    def pose(self) -> PoseStamped | None:
        """The latest pose of the robot; None before the first."""
        return self._pose.latest

    def _after_hang(self, hang: Hang) -> None:
        """Hold all trees after the process was stopped, until it has handled the pending messages. From any thread."""
        if hang.was_out_of_reach:
            returned = self._returned = f'{hang}: what was said meanwhile comes first'
            self._hold_all()
            self._runtime.post(lambda: self._come_back(returned, str(hang), hang.seconds))

    def _come_back(self, returned: str, hang: str, seconds: float) -> None:
        """Stop all goals after a stop of ``peer_timeout`` or more: other nodes count the process as gone by then."""
        if seconds >= self._parameters.peer_timeout:
            self.stop_each(f'{hang}: who waited for the tree has given it up')
        self._hold_all()  # also a tree that was about to begin
        self._runtime.post_in(RETURN_SECONDS, lambda: self._go_on(returned))

    def _go_on(self, returned: str) -> None:
        if self._returned is returned:  # not stopped again since
            self._returned = ''
            self._hold_all()

    def _hold_all(self) -> None:
        for running in self.running.all():
            running.run.hold(self._reason_to_hold(running.goal))

    def _reason_to_hold(self, goal: TreeGoal) -> str:
        return self._returned or self.owners.problem(goal.owner)

    def stop_each(self, reason: str, kind: type[TreeGoal] | None = None, within: float | None = None) -> None:
        """Stop the goals of a kind, by default all, also those whose trees are not read yet; see :meth:`stop`."""
        for goal in list(self._goals.values()):
            if kind is None or isinstance(goal, kind):
                self.stop(goal, reason, within)

    def wake(self, blackboard: str) -> None:
        """Tick the trees that run on a blackboard, since a client has changed its entries."""
        for running in self.running.on(blackboard):
            running.run.wake()

    def stop_all(self, reason: str, within: float) -> bool:
        """Stop every tree, and wait until all goals have their results. Not on the executor thread.

        Return False if that takes longer than ``within``, s of wall time.
        """

        halting = min(self._parameters.cancel_timeout, within - _REPORT_SECONDS)
        self._runtime.call(lambda: self.stop_each(reason, within=halting))
        return self._no_goals.wait(within)

    def control(
        self, run_id: str, command: TickCommand, owner: str, answer: Callable[[str], None]
    ) -> TreeRun[TreeGoal]:
        """Pause, resume or step the run that ``run_id`` names, on behalf of the node ``owner``; see
        :meth:`TreeRun.control` and :meth:`RunningTrees.find`. A pause also ends when all its owners are gone.

        Raises:
            FlexbtError: the run does not exist, or this node cannot own a pause.
        """
        running = self.running.find(run_id)
        if command is TickCommand.PAUSE:
            self._pause_for(running, owner)
        elif command is TickCommand.RESUME:
            self._forget_pauses(running)
        running.run.control(command, answer)
        return running.run

    def _pause_for(self, running: RunningTree, owner: str) -> None:
        if owner in running.paused_for:
            return
        if len(running.paused_for) >= MOST_PAUSING:
            raise FlexbtError(f'{MOST_PAUSING} nodes keep the tree paused already; RESUME it before another pauses it')
        if owner:
            self.owners.watch(owner, running, lambda _reason: self._end_pause(running, owner))
        running.paused_for.add(owner)

    def _end_pause(self, running: RunningTree, owner: str) -> None:
        self.owners.release(owner, running)
        running.paused_for.discard(owner)
        # The runs of an owner that is gone are being stopped and must not move again.
        if not running.paused_for and running.goal.owner != owner:
            self._runtime.node.get_logger().warning(
                f'{running.description} continues: {owner}, on whose behalf it was paused, is gone'
            )
            running.run.control(TickCommand.RESUME, lambda _refusal: None)

    def _forget_pauses(self, running: RunningTree) -> None:
        for owner in running.paused_for:
            self.owners.release(owner, running)
        running.paused_for.clear()

    # -- a goal ------------------------------------------------------------------------------------------------------

    def serve(self, goal: TreeGoal) -> None:
        """Work on a goal until it has its result. Goals start in the order of these calls."""
        self._goals[goal.served] = goal
        self._no_goals.clear()
        self.guard(goal, lambda: self._look_for_tree(goal))

    def _look_for_tree(self, goal: TreeGoal) -> None:
        def read() -> None:
            if not goal.served.active:
                return  # stopped before its turn
            try:
                values = goal.read()
                found = self._store.find(goal.tree)
            except FlexbtError as error:
                reason = str(error)
                self._runtime.post(lambda: self.end(goal, RunOutcome(ExecuteResult.ERROR, reason)))
            except BaseException as error:  # the client gets a fault of the server too
                fault = error
                self._runtime.post(lambda: self.end(goal, RunOutcome(ExecuteResult.ERROR, self._fault(goal, fault))))
            else:
                self._runtime.post(lambda: self.guard(goal, lambda: self._found(goal, found, values)))

        goal.leave_queue = self._reader.submit(read, f'tree {short_repr(goal.tree)} was not read')

    def guard(self, goal: TreeGoal, step: Callable[[], None]) -> None:
        """Run a step for a goal, and end the goal if it raises: the machine may be out of threads or files."""
        try:
            step()
        except FlexbtError as error:
            self.end(goal, RunOutcome(ExecuteResult.ERROR, str(error)))
        except Exception as error:
            self.end(goal, RunOutcome(ExecuteResult.ERROR, self._fault(goal, error)))

    def _fault(self, goal: TreeGoal, error: BaseException) -> str:
        """Report a fault of the server, and return the text for the client."""
        self._runtime.report_fault(error, f'goal of {goal.action}')
        return sanitize_for_message(f'fault in the BT server: {error!r}', MESSAGE_LIMIT)

    def _found(self, goal: TreeGoal, found: FoundTree, values: list[Value]) -> None:
        if not goal.served.active:
            return  # stopped while the file was read
        goal.found, goal.values, goal.notice = found, values, found.notice
        if goal.notice:
            self._runtime.node.get_logger().warning(f'tree {found.key.id!r}: {goal.notice}')
        goal.when_ready(lambda: self.guard(goal, lambda: self._begin(goal, found)))

    def _begin(self, goal: TreeGoal, found: FoundTree) -> None:
        if not goal.served.active:
            return
        if goal.owner:
            self.owners.watch(
                goal.owner,
                goal,
                lambda reason: self.stop(goal, reason),
                lambda: self._hold(goal),
                goal.owner_process,
            )
        running = self.running.get(found.key, goal.blackboard)
        if running is None:
            self._run(goal, found)
            return
        goal.running = running
        replaced = running.run.offer(goal, goal.values)
        if replaced is not None:
            self.end(replaced, _replaced())

    def _run(self, goal: TreeGoal, found: FoundTree) -> None:
        name = goal.blackboard
        board = self._boards.get(name)
        events = RunEvents(goal.served.id.hex(), name)
        for watcher in self._watchers:
            events.add(watcher.open(events))
        values = [*goal.fresh_values(), *goal.values]
        run = TreeRun(self._runtime, self._parameters, self._services, found, board, goal, values, events)
        running = goal.running = RunningTree(events.run_id, found.key, name, board, run, goal)
        events.add(_GoalReader(self._runtime, self, running))  # last: all else is sent before the result
        run.hold(self._reason_to_hold(goal))
        self._runtime.default_context.open()  # a leaf may have shut it down
        self.running.add(running)
        self._schedule_feedback(running)
        run.start()

    def note(self, running: RunningTree, event: RunAdopted | OfferRefused | RunEnded) -> None:
        """Handle the end of a run, or the adoption or refusal of a client that was offered to it."""
        match event:
            case RunAdopted(client):
                self._on_adopted(running, client)
            case OfferRefused(client, reason):
                why = f'the running tree does not take the new inputs: {reason}'
                self.end(client, RunOutcome(ExecuteResult.ERROR, why))
            case RunEnded(outcome):
                self._on_end(running, outcome)

    def _on_adopted(self, running: RunningTree, newer: TreeGoal) -> None:
        older = running.goal
        running.works_for(newer)
        running.run.hold(self._reason_to_hold(newer))
        self.end(older, _replaced())
        if newer.stop_reason is not None:
            running.run.stop(newer, newer.stop_reason, newer.stop_within)

    def _on_end(self, running: RunningTree, outcome: RunOutcome) -> None:
        self._forget_pauses(running)
        if running.feedback is not None:
            running.feedback.cancel()
        self.end(running.goal, outcome)  # a goal that begins by that is offered to this run
        self.running.remove(running)
        offered = running.run.accept_offer()
        if offered is not None and offered.found is not None and offered.served.active:
            # The goal arrived while the tree was ending. It gets a new run at once, before later goals.
            found = offered.found
            self.guard(offered, lambda: self._run(offered, found))

    # -- the end of a goal -------------------------------------------------------------------------------------------

    def cancel(self, served: ServedGoal) -> None:
        """Stop a goal that its client has canceled."""
        self.stop(self._goals[served], _BY_CLIENT)

    def stop(self, goal: TreeGoal, reason: str, within: float | None = None) -> None:
        """Stop the work for a goal within this many seconds of wall time, by default the cancel timeout."""
        if goal.stop_reason is None:
            goal.stop_reason = reason
        goal.stop_within = goal.stop_within if within is None else within
        if goal.running is None:  # the reader is looking for its tree, on a disk that may not answer
            self.end(goal, RunOutcome(ExecuteResult.CANCELED, reason))
        elif goal.running.goal is goal:
            goal.running.run.stop(goal, reason, within)
        elif goal.running.run.remove_client(goal):
            self.end(goal, RunOutcome(ExecuteResult.CANCELED, reason))

    def _hold(self, goal: TreeGoal) -> None:
        if goal.running is not None and goal.running.goal is goal:
            goal.running.run.hold(self._reason_to_hold(goal))

    def end(self, goal: TreeGoal, outcome: RunOutcome) -> None:
        """Give a goal its outcome; the first one counts."""
        if not goal.served.active:
            return
        try:
            code, result = goal.result(outcome, self._seconds(goal))
        except Exception as error:
            code, result = ExecuteResult.ERROR, goal.fault_result(self._fault(goal, error))
        if code == ExecuteResult.SUCCESS:
            goal.served.succeed(result)
        elif code == ExecuteResult.CANCELED:
            goal.served.canceled(result)
        else:
            goal.served.abort(result)
        goal.leave_queue()
        self.owners.release(goal.owner, goal)
        del self._goals[goal.served]
        if not self._goals:
            self._no_goals.set()
        goal.on_ended()

    # -- meanwhile ---------------------------------------------------------------------------------------------------

    def _schedule_feedback(self, running: RunningTree) -> None:
        period = 1.0 / self._parameters.feedback_rate
        running.feedback = self._runtime.post_in(period, lambda: self._feedback(running))

    def _feedback(self, running: RunningTree) -> None:
        if running not in self.running:
            return
        if running.run.tree is not None:
            goal = running.goal
            goal.served.publish_feedback(
                goal.feedback(running, running.run.tree, self.pose or PoseStamped(), self._seconds(goal))
            )
        self._schedule_feedback(running)

    def _seconds(self, goal: TreeGoal) -> float:
        return max(0.0, self._runtime.clock.now() - goal.accepted)


def _replaced() -> RunOutcome:
    return RunOutcome(ExecuteResult.CANCELED, 'a newer goal for the same tree has taken over')


# The running trees and their goals. Executor thread only.

_GOALS_REMEMBERED: Final = 100
"""Maximum number of goal IDs that identify a run."""


class TreeGoal(ABC):
    """A goal that the run of a tree serves. Executor thread only, except :meth:`read`.

    ``served`` is the goal of the action server, ``action`` the name of its action. ``tree`` is the requested tree, by
    ID or file, ``blackboard`` the blackboard of the run, ``owner`` the node that must stay alive meanwhile, or '', and
    ``owner_process`` its process, or '' for any.
    ``running`` is set once a tree runs for the goal or the goal is offered to a run, ``stop_reason`` once it must stop,
    and ``stop_within`` if the time for that is not the cancel timeout.
    ``leave_queue`` removes it from the queue of the reader thread. ``on_ended`` is called when the result was sent.
    """

    def __init__(
        self,
        served: ServedGoal,
        accepted: float,
        action: str,
        tree: str,
        blackboard: str,
        owner: str = '',
        owner_process: str = '',
    ) -> None:
        self.served = served
        self.accepted = accepted
        self.action = action
        self.tree = tree
        self.blackboard = blackboard
        self.owner = owner
        self.owner_process = owner_process
        self.leave_queue: Callable[[], None] = lambda: None
        self.on_ended: Callable[[], None] = lambda: None
        self.stop_reason: str | None = None
        self.stop_within: float | None = None
        self.notice = ''
        self.running: RunningTree | None = None
        self.found: FoundTree | None = None
        self.values: list[Value] = []

    @abstractmethod
    def read(self) -> list[Value]:
        """Return the values to write to the blackboard before the tree works for this goal; on the reader thread.

        Raises:
            FlexbtError: the goal cannot be served.
        """

    def fresh_values(self) -> list[Value]:
        """Return further values to write if a new run starts for this goal, but not if the goal takes a run over."""
        return []

    def when_ready(self, go_on: Callable[[], None]) -> None:
        """Call ``go_on`` to begin, now that tree and values are known, or end the goal."""
        go_on()

    @abstractmethod
    def feedback(self, running: RunningTree, tree: Tree, pose: PoseStamped, seconds: float) -> Any:
        """Return the feedback message. ``pose``: latest pose of the robot, without a frame before the first;
        ``seconds`` since the acceptance.
        """

    @abstractmethod
    def result(self, outcome: RunOutcome, seconds: float) -> tuple[int, Any]:
        """Return the outcome of the goal, a code of BtExecute.Result, and the result message."""

    @abstractmethod
    def fault_result(self, why: str) -> Any:
        """Return the result message when the server is at fault."""


@dataclass(eq=False)
class RunningTree:
    """The run of one tree on one blackboard, and its present goal. ``goal_ids`` are the IDs of its last goals: a client
    that has paused the run by one of them resumes it by the same ID. ``paused_for`` are the nodes that have requested a
    pause, '' for a request without an owner.
    """

    id: str
    key: TreeKey
    blackboard: str
    board: Blackboard
    """Blackboard of this name; holding it here keeps it."""
    run: TreeRun[TreeGoal]
    goal: TreeGoal
    feedback: Timer | None = None
    goal_ids: deque[str] = field(default_factory=lambda: deque(maxlen=_GOALS_REMEMBERED))
    paused_for: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.works_for(self.goal)

    def works_for(self, goal: TreeGoal) -> None:
        """Note the goal of a run that has begun or was taken over."""
        self.goal = goal
        self.goal_ids.append(goal.served.id.hex())

    @property
    def description(self) -> str:
        """Tree and blackboard, as text for people."""
        where = f'blackboard {self.blackboard!r}' if self.blackboard else 'the shared blackboard'
        return f'tree {self.key.id!r} on {where}'


class _GoalReader(RunReader):
    """A reader that passes events of goals to the executor thread, and logs events for people."""

    def __init__(self, runtime: Runtime, goals: TreeGoals, running: RunningTree) -> None:
        self._runtime = runtime
        self._goals = goals
        self._running = running

    def read(self, event: RunEvent) -> None:
        match event:
            case RunAdopted() | OfferRefused() | RunEnded():
                self._runtime.run_or_post(lambda: self._goals.note(self._running, event))
            case RunWarning(text):
                self._runtime.node.get_logger().warning(text)
            case PropertyViolated(text):
                self._runtime.node.get_logger().error(text)


class RunningTrees:
    """The running trees, at most one run for each tree on each blackboard."""

    def __init__(self) -> None:
        self._running: dict[tuple[TreeKey, str], RunningTree] = {}

    def get(self, key: TreeKey, blackboard: str) -> RunningTree | None:
        """Return the run of a tree on a blackboard, or None."""
        return self._running.get((key, blackboard))

    def __contains__(self, running: RunningTree) -> bool:
        return self.get(running.key, running.blackboard) is running

    def all(self) -> tuple[RunningTree, ...]:
        """Return all running trees."""
        return tuple(self._running.values())

    def on(self, blackboard: str) -> list[RunningTree]:
        """Return the trees that run on a blackboard."""
        return [running for running in self.all() if running.blackboard == blackboard]

    def add(self, running: RunningTree) -> None:
        """Add a run that has begun."""
        self._running[running.key, running.blackboard] = running

    def remove(self, running: RunningTree) -> None:
        """Remove a run that has ended."""
        del self._running[running.key, running.blackboard]

    def find(self, run_id: str) -> RunningTree:
        """Return the run with this ID (TreeStructure.run_id), the run that serves or has served the goal with this ID,
        or the only run for ''.

        Raises:
            UnknownRunError: no run, or more than one, matches; the text lists them.
        """
        runs = self.all()
        found = [running for running in runs if not run_id or run_id == running.id or run_id in running.goal_ids]
        if len(found) == 1:
            return found[0]
        known = '; '.join(f'{running.id} ({running.description})' for running in runs)
        if not known:
            raise UnknownRunError('no tree is running')
        asked = f'no run has the ID {run_id!r}' if run_id else 'several trees are running; say which by run_id'
        raise UnknownRunError(f'{asked}: {known}')

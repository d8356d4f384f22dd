# SPDX-License-Identifier: BSD-3-Clause
"""The action ``bt_executor``: goals become runs of trees.

All of this happens on the executor thread; runs and file reading have threads of their own and report back.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

from flexbt_common import names
from flexbt_common.calls import GoalAdmission, GoalServer, ServedGoal
from flexbt_common.runtime import NodeRuntime
from flexbt_core.behavior_tree import Blackboard, TreeKey, TreeLibrary
from flexbt_core.clock import Timer
from flexbt_core.errors import FlexbtError
from flexbt_core.values import sendable
from flexbt_msgs.action import BtExecute
from flexbt_server.errors import UnknownRunError
from flexbt_server.leaves.leaf_services import LeafServices
from flexbt_server.leaves.ros_ports import POSE_STAMPED, POSES
from flexbt_server.node.parameters import ServerParameters
from flexbt_server.runs.robot_pose import RobotPose
from flexbt_server.runs.run_watchers import RunWatcher, watched_by
from flexbt_server.runs.tree_run import RunOutcome, TreeRun
from flexbt_server.runs.tree_stream import NoStream, TreeStream
from flexbt_server.trees.blackboards import Blackboards, Value, read_values
from flexbt_server.trees.tree_store import FoundTree, TreeStore

from .goal_owners import GoalOwners
from .run_messages import MESSAGE_LIMIT, feedback_of, result_of, take_error_code

Result = BtExecute.Result

_REPORT_SECONDS = 0.3
"""A run that is not at rest in time says so a little later, s."""


@dataclass(eq=False)
class _Goal:
    """A goal that is being served. ``run`` is set once a run works for it, or is asked to."""

    served: ServedGoal
    accepted: float
    on_end: Callable[[_Goal, RunOutcome], None]
    stop_reason: str | None = None
    notice: str = ''
    run: TreeRun[_Goal] | None = None
    slot: _Slot | None = None
    found: tuple[TreeLibrary, TreeKey, list[Value]] | None = None
    """Its tree and its values, once they are known."""

    @property
    def request(self) -> Any:
        """The goal message."""
        return self.served.request

    def end(self, outcome: RunOutcome) -> None:
        """Give the goal its outcome; the first one counts."""
        if self.served.active:
            self.on_end(self, outcome)


@dataclass(eq=False)
class _Slot:
    """The run of one tree on one blackboard, and the goal that it works for."""

    id: str
    key: TreeKey
    blackboard: str
    board: Blackboard
    run: TreeRun[_Goal]
    goal: _Goal
    feedback: Timer | None = None

    @property
    def description(self) -> str:
        """Tree and blackboard, for people."""
        where = f'blackboard {self.blackboard!r}' if self.blackboard else 'the shared blackboard'
        return f'tree {self.key.id!r} on {where}'


_BY_CLIENT = 'canceled by the client'


class ExecuteServer:
    """Serves BtExecute."""

    def __init__(
        self,
        runtime: NodeRuntime,
        parameters: ServerParameters,
        store: TreeStore,
        boards: Blackboards,
        services: LeafServices,
        reader: ThreadPoolExecutor,
        admission: GoalAdmission,
        watchers: Sequence[RunWatcher] = (),
    ) -> None:
        self._runtime = runtime
        self._parameters = parameters
        self._store = store
        self._boards = boards
        self._services = services
        self._reader = reader
        self._watchers = watchers
        self._stream = TreeStream(runtime) if parameters.publish_statuses else NoStream()
        self._pose = RobotPose(services.topics, parameters.pose_topic)
        self._slots: dict[tuple[TreeKey, str], _Slot] = {}
        self._goals: dict[bytes, _Goal] = {}
        self._owners = GoalOwners(runtime)
        self._no_goals = threading.Event()
        self._no_goals.set()
        serve = admission.guard(self._serve, lambda why: Result(code=Result.ERROR, message=why))
        server = GoalServer(runtime, BtExecute, names.BT_EXECUTOR, serve, self._on_cancel)
        runtime.on_close(lambda: runtime.call(server.close))

    def wake(self, blackboard: str) -> None:
        """Tick the trees that run on a blackboard: its entries were changed from outside."""
        for slot in self._slots.values():
            if slot.blackboard == blackboard:
                slot.run.wake()

    def stop_all(self, reason: str, within: float) -> bool:
        """Stop every tree, and wait until all goals have their results. Not on the executor thread.

        Gives whether they have, within so many seconds of wall time.
        """

        halting = min(self._parameters.cancel_timeout, within - _REPORT_SECONDS)

        def stop() -> None:
            for goal in list(self._goals.values()):
                self._stop(goal, reason, halting)

        self._runtime.call(stop)
        return self._no_goals.wait(within)

    def find_run(self, run_id: str) -> TreeRun[_Goal]:
        """The run of this ID (TreeStructure.run_id), or that of the goal of this ID; the only one there is for ''.

        Raises:
            UnknownRunError: there is none, or there are several; says which.
        """
        runs = {slot.id: slot for slot in self._slots.values()}
        by_goal = {slot.goal.served.id.hex(): slot for slot in self._slots.values()}
        only = next(iter(runs.values())) if len(runs) == 1 else None
        slot = (runs | by_goal).get(run_id) if run_id else only
        if slot is not None:
            return slot.run
        known = '; '.join(f'{slot.id} ({slot.description})' for slot in runs.values())
        if not known:
            raise UnknownRunError('no tree is running')
        asked = f'no run has the ID {run_id!r}' if run_id else 'several trees are running; say which by run_id'
        raise UnknownRunError(f'{asked}: {known}')

    # -- a goal ------------------------------------------------------------------------------------------------------

    def _serve(self, served: ServedGoal) -> None:
        goal = self._goals[served.id] = _Goal(served, self._runtime.clock.now(), self._finish)
        self._no_goals.clear()
        self._guard(goal, lambda: self._start(goal))

    def _start(self, goal: _Goal) -> None:
        """Look for the tree of a goal. Goals come out of this in the order in which they were accepted."""
        name = goal.request.behavior_tree or self._parameters.default_tree

        def read() -> None:
            try:
                if not name:
                    raise FlexbtError("the goal names no behavior tree, and the parameter 'default_tree' is not set")
                values = read_values(goal.request.inputs)
                found = self._store.find(name)
            except FlexbtError as error:
                reason = str(error)
                self._runtime.post(lambda: goal.end(RunOutcome(Result.ERROR, reason)))
            except Exception as error:  # a fault of ours goes to the client as well
                fault = error
                self._runtime.post(lambda: goal.end(RunOutcome(Result.ERROR, self._fault(fault))))
            else:
                self._runtime.post(lambda: self._guard(goal, lambda: self._found(goal, found, values)))

        self._reader.submit(read)

    def _guard(self, goal: _Goal, step: Callable[[], None]) -> None:
        """Take a step with a goal; when it raises, the goal ends: the machine may be out of threads or files."""
        try:
            step()
        except FlexbtError as error:
            goal.end(RunOutcome(Result.ERROR, str(error)))
        except Exception as error:
            goal.end(RunOutcome(Result.ERROR, self._fault(error)))

    def _fault(self, error: Exception) -> str:
        """Report a fault of ours; gives what the client is told."""
        self._runtime.report_fault(error, f'goal of {names.BT_EXECUTOR}')
        return sendable(f'fault in the BT server: {error!r}', MESSAGE_LIMIT)

    def _found(self, goal: _Goal, found: FoundTree, values: list[Value]) -> None:
        request = goal.request
        library, key, goal.notice = found
        if goal.notice:
            self._runtime.node.get_logger().warning(f'tree {key.id!r}: {goal.notice}')
        if len(request.goals) == 1:
            values.append(('goal', request.goals[0], POSE_STAMPED))
        elif request.goals:
            values.append(('goals', list(request.goals), POSES))
        if goal.stop_reason is not None:  # canceled while the file was read
            goal.end(RunOutcome(Result.CANCELED, goal.stop_reason))
            return
        if request.owner:
            self._owners.watch(request.owner, goal, lambda reason: self._stop(goal, reason))
        goal.found = (library, key, values)
        slot = self._slots.get((key, request.blackboard))
        if slot is None:
            self._run(goal, *goal.found)
            return
        goal.run, goal.slot = slot.run, slot
        replaced = slot.run.offer(goal, values)
        if replaced is not None:
            replaced.end(_replaced())

    def _run(self, goal: _Goal, library: TreeLibrary, key: TreeKey, values: Sequence[Value]) -> None:
        name = goal.request.blackboard
        board = self._boards.get(name)
        place = (key, name)
        run_id = goal.served.id.hex()
        run: TreeRun[_Goal] = TreeRun(
            library,
            key,
            board,
            goal,
            values,
            clock=self._runtime.clock,
            steady=self._runtime.steady,
            services=self._services,
            observer=watched_by(self._stream.open(run_id, name), run_id, self._watchers),
            tick_rate=self._parameters.tick_rate,
            cancel_timeout=self._parameters.cancel_timeout,
            on_adopted=lambda newer: self._runtime.post(lambda: self._on_adopted(place, newer)),
            on_refused=lambda newer, reason: self._runtime.post(
                lambda: newer.end(RunOutcome(Result.ERROR, f'the running tree does not take the new inputs: {reason}'))
            ),
            on_end=lambda outcome: self._runtime.post(lambda: self._on_end(place, outcome)),
            on_overrun=self._runtime.node.get_logger().warning,
        )
        run.start()
        slot = self._slots[place] = _Slot(run_id, key, name, board, run, goal)
        goal.run, goal.slot = run, slot
        self._schedule_feedback(slot)

    def _on_adopted(self, place: tuple[TreeKey, str], newer: _Goal) -> None:
        slot = self._slots[place]
        older, slot.goal = slot.goal, newer
        older.end(_replaced())
        if newer.stop_reason is not None:
            slot.run.stop(newer, newer.stop_reason)

    def _on_end(self, place: tuple[TreeKey, str], outcome: RunOutcome) -> None:
        slot = self._slots.pop(place)
        if slot.feedback is not None:
            slot.feedback.cancel()
        slot.goal.end(outcome)
        offered = slot.run.take_offer()
        if offered is not None and offered.found is not None and offered.served.active:
            # It came while the tree was ending. It gets a run of its own, and at once: before goals that came later.
            found = offered.found
            self._guard(offered, lambda: self._run(offered, *found))

    # -- the end of a goal -------------------------------------------------------------------------------------------

    def _on_cancel(self, served: ServedGoal) -> None:
        self._stop(self._goals[served.id], _BY_CLIENT)

    def _stop(self, goal: _Goal, reason: str, within: float | None = None) -> None:
        if goal.stop_reason is None:
            goal.stop_reason = reason
        if goal.run is None or goal.slot is None:
            return  # its tree is being looked for; see _start
        if goal.slot.goal is goal:
            goal.run.stop(goal, reason, within)
        elif goal.run.withdraw(goal):
            goal.end(RunOutcome(Result.CANCELED, reason))

    def _finish(self, goal: _Goal, outcome: RunOutcome) -> None:
        try:
            result = self._result(goal, outcome)
        except Exception as error:
            result = Result(code=Result.ERROR, message=self._fault(error))
        if result.code == Result.SUCCESS:
            goal.served.succeed(result)
        elif result.code == Result.CANCELED:
            goal.served.canceled(result)
        else:
            goal.served.abort(result)
        self._owners.release(goal.request.owner, goal)
        del self._goals[goal.served.id]
        if not self._goals:
            self._no_goals.set()

    def _result(self, goal: _Goal, outcome: RunOutcome) -> Any:
        board = self._boards.get(goal.request.blackboard)
        error_code = 0 if goal.slot is None else take_error_code(board, self._parameters.error_code_names)
        return result_of(goal.request, outcome, board, error_code, goal.notice, self._seconds(goal))

    # -- meanwhile ---------------------------------------------------------------------------------------------------

    def _schedule_feedback(self, slot: _Slot) -> None:
        steady = self._runtime.steady
        slot.feedback = steady.call_at(
            steady.now() + 1.0 / self._parameters.feedback_rate,
            lambda: self._runtime.post(lambda: self._feedback(slot)),
        )

    def _feedback(self, slot: _Slot) -> None:
        if self._slots.get((slot.key, slot.blackboard)) is not slot:
            return
        tree = slot.run.tree
        if tree is not None:
            feedback = feedback_of(tree, slot.board, self._pose.latest, self._seconds(slot.goal))
            slot.goal.served.publish_feedback(feedback)
        self._schedule_feedback(slot)

    def _seconds(self, goal: _Goal) -> float:
        return self._runtime.clock.now() - goal.accepted


def _replaced() -> RunOutcome:
    return RunOutcome(Result.CANCELED, 'a newer goal for the same tree has taken over')

# SPDX-License-Identifier: BSD-3-Clause
"""The action ``bt_executor``: goals become runs of trees.

All of this happens on the executor thread; runs and file reading have threads of their own and report back.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Final, Protocol

from geometry_msgs.msg import PoseStamped

from flexbt_common import names
from flexbt_common.calls import GoalAdmission, GoalServer, ServedGoal
from flexbt_common.runtime import Hang, NodeRuntime
from flexbt_core.behavior_tree import TreeKey, TreeLibrary
from flexbt_core.errors import FlexbtError
from flexbt_core.values import sendable
from flexbt_msgs.action import BtExecute
from flexbt_server.leaves import LeafServices
from flexbt_server.runs import NoStream, RunOutcome, RunWatcher, TreeRun, TreeStream, watched_by
from flexbt_server.trees import POSE_STAMPED, POSES, Blackboards, FoundTree, TreeStore, Value

from .goal_owners import GoalOwners
from .run_messages import MESSAGE_LIMIT, feedback_of, result_of
from .running_trees import RunningTree, RunningTrees, TreeGoal

Result = BtExecute.Result

RETURN_SECONDS: Final = 2.0
"""How long trees are held after the process was stopped, s of wall time: until it has found the others again, and they
have said what they want."""

_REPORT_SECONDS: Final = 0.3
"""A run that has not halted in time says so a little later, s."""

MOST_RUNS: Final = 200
"""Goals that are worked on at a time: each tree that runs has a thread."""

_BY_CLIENT: Final = 'canceled by the client'


class ExecuteParameters(Protocol):
    """The parameters of the server that runs need; :class:`flexbt_server.node.ServerParameters` tells what they are."""

    @property
    def default_tree(self) -> str: ...

    @property
    def tick_rate(self) -> float: ...

    @property
    def feedback_rate(self) -> float: ...

    @property
    def cancel_timeout(self) -> float: ...

    @property
    def peer_timeout(self) -> float: ...

    @property
    def pose_topic(self) -> str: ...

    @property
    def error_code_names(self) -> tuple[str, ...]: ...

    @property
    def publish_statuses(self) -> bool: ...


class ExecuteServer:
    """Serves BtExecute."""

    def __init__(
        self,
        runtime: NodeRuntime,
        parameters: ExecuteParameters,
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
        self._pose = services.topics.cache(PoseStamped, parameters.pose_topic, 1)  # as the leaves do
        self._running = RunningTrees()
        self._goals: dict[bytes, TreeGoal] = {}
        self._owners = GoalOwners(runtime, parameters.peer_timeout)
        self._no_goals = threading.Event()
        self._no_goals.set()
        server = GoalServer(
            runtime,
            BtExecute,
            names.BT_EXECUTOR,
            self._serve,
            self._on_cancel,
            refused=_refused,
            most=MOST_RUNS,
            admission=admission,
        )
        runtime.on_close(lambda: runtime.call(server.close))
        self._returned = ''
        runtime.health.on_hang(self._after_hang)

    def _after_hang(self, hang: Hang) -> None:
        """Called on any thread."""
        if hang.was_out_of_reach:
            self._runtime.post(lambda: self._come_back(str(hang), hang.seconds))

    def _come_back(self, told: str, seconds: float) -> None:
        """The process was stopped: what was said to it meanwhile comes before its trees go on. After ``peer_timeout``
        others have taken it for gone, and given up what it was to do.
        """
        if seconds >= self._parameters.peer_timeout:
            self._stop_goals(f'{told}: who waited for the tree has given it up')
            return
        self._returned = f'{told}: what was said meanwhile comes first'
        self._hold_all()
        steady = self._runtime.steady
        steady.call_at(steady.now() + RETURN_SECONDS, lambda: self._runtime.post(self._go_on))

    def _go_on(self) -> None:
        self._returned = ''
        self._hold_all()

    def _hold_all(self) -> None:
        for running in self._running.all():
            running.run.hold(self._reason_to_hold(running.goal))

    def _reason_to_hold(self, goal: TreeGoal) -> str:
        return self._returned or self._owners.problem(goal.request.owner)

    def _stop_goals(self, reason: str, halting: float | None = None) -> None:
        for goal in list(self._goals.values()):
            self._stop(goal, reason, halting)

    def wake(self, blackboard: str) -> None:
        """Tick the trees that run on a blackboard: its entries were changed from outside."""
        for running in self._running.on(blackboard):
            running.run.wake()

    def stop_all(self, reason: str, within: float) -> bool:
        """Stop every tree, and wait until all goals have their results. Not on the executor thread.

        Gives whether they have, within so many seconds of wall time.
        """

        halting = min(self._parameters.cancel_timeout, within - _REPORT_SECONDS)
        self._runtime.call(lambda: self._stop_goals(reason, halting))
        return self._no_goals.wait(within)

    def find_run(self, run_id: str) -> TreeRun[TreeGoal]:
        """The run that ``run_id`` names; see :meth:`RunningTrees.find`."""
        return self._running.find(run_id).run

    # -- a goal ------------------------------------------------------------------------------------------------------

    def _serve(self, served: ServedGoal) -> None:
        goal = self._goals[served.id] = TreeGoal(served, self._runtime.clock.now(), self._finish)
        self._no_goals.clear()
        self._guard(goal, lambda: self._start(goal))

    def _start(self, goal: TreeGoal) -> None:
        """Look for the tree of a goal. Goals come out of this in the order in which they were accepted."""
        name = goal.request.behavior_tree or self._parameters.default_tree

        def read() -> None:
            try:
                if not name:
                    raise FlexbtError("the goal names no behavior tree, and the parameter 'default_tree' is not set")
                found = self._store.find(name)
                values = self._boards.receive(goal.request.blackboard, goal.request.inputs)
            except FlexbtError as error:
                reason = str(error)
                self._runtime.post(lambda: goal.end(RunOutcome(Result.ERROR, reason)))
            except Exception as error:  # a fault of ours goes to the client as well
                fault = error
                self._runtime.post(lambda: goal.end(RunOutcome(Result.ERROR, self._fault(fault))))
            else:
                self._runtime.post(lambda: self._guard(goal, lambda: self._found(goal, found, values)))

        self._reader.submit(read)

    def _guard(self, goal: TreeGoal, step: Callable[[], None]) -> None:
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

    def _found(self, goal: TreeGoal, found: FoundTree, values: list[Value]) -> None:
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
            self._owners.watch(request.owner, goal, lambda reason: self._stop(goal, reason), lambda: self._hold(goal))
        goal.found = (library, key, values)
        running = self._running.get(key, request.blackboard)
        if running is None:
            self._run(goal, *goal.found)
            return
        goal.running = running
        replaced = running.run.offer(goal, values)
        if replaced is not None:
            replaced.end(_replaced())

    def _run(self, goal: TreeGoal, library: TreeLibrary, key: TreeKey, values: Sequence[Value]) -> None:
        name = goal.request.blackboard
        board = self._boards.get(name)
        run_id = goal.served.id.hex()
        run: TreeRun[TreeGoal] = TreeRun(
            library,
            key,
            board,
            goal,
            values,
            clock=self._runtime.clock,
            steady=self._runtime.steady,
            health=self._runtime.health,
            services=self._services,
            observer=watched_by(self._stream.open(run_id, name), run_id, self._watchers),
            error_code_names=self._parameters.error_code_names,
            tick_rate=self._parameters.tick_rate,
            cancel_timeout=self._parameters.cancel_timeout,
            on_adopted=lambda newer: self._runtime.post(lambda: self._on_adopted(running, newer)),
            on_refused=lambda newer, reason: self._runtime.post(
                lambda: newer.end(RunOutcome(Result.ERROR, f'the running tree does not take the new inputs: {reason}'))
            ),
            on_end=lambda outcome: self._runtime.post(lambda: self._on_end(running, outcome)),
            on_overrun=self._runtime.node.get_logger().warning,
        )
        running = goal.running = RunningTree(run_id, key, name, board, run, goal)
        run.hold(self._reason_to_hold(goal))
        run.start()
        self._running.add(running)
        self._schedule_feedback(running)

    def _on_adopted(self, running: RunningTree, newer: TreeGoal) -> None:
        older, running.goal = running.goal, newer
        running.run.hold(self._reason_to_hold(newer))
        older.end(_replaced())
        if newer.stop_reason is not None:
            running.run.stop(newer, newer.stop_reason)

    def _on_end(self, running: RunningTree, outcome: RunOutcome) -> None:
        self._running.remove(running)
        if running.feedback is not None:
            running.feedback.cancel()
        running.goal.end(outcome)
        offered = running.run.take_offer()
        if offered is not None and offered.found is not None and offered.served.active:
            # It came while the tree was ending. It gets a run of its own, and at once: before goals that came later.
            found = offered.found
            self._guard(offered, lambda: self._run(offered, *found))

    # -- the end of a goal -------------------------------------------------------------------------------------------

    def _on_cancel(self, served: ServedGoal) -> None:
        self._stop(self._goals[served.id], _BY_CLIENT)

    def _stop(self, goal: TreeGoal, reason: str, within: float | None = None) -> None:
        if goal.stop_reason is None:
            goal.stop_reason = reason
        if goal.running is None:
            return  # its tree is being looked for; see _start
        if goal.running.goal is goal:
            goal.running.run.stop(goal, reason, within)
        elif goal.running.run.withdraw(goal):
            goal.end(RunOutcome(Result.CANCELED, reason))

    def _hold(self, goal: TreeGoal) -> None:
        if goal.running is not None and goal.running.goal is goal:
            goal.running.run.hold(self._reason_to_hold(goal))

    def _finish(self, goal: TreeGoal, outcome: RunOutcome) -> None:
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

    def _result(self, goal: TreeGoal, outcome: RunOutcome) -> Any:
        running = goal.running
        board = self._boards.find(goal.request.blackboard) if running is None else running.run.board
        return result_of(goal.request, outcome, board, goal.notice, self._seconds(goal))

    # -- meanwhile ---------------------------------------------------------------------------------------------------

    def _schedule_feedback(self, running: RunningTree) -> None:
        steady = self._runtime.steady
        running.feedback = steady.call_at(
            steady.now() + 1.0 / self._parameters.feedback_rate,
            lambda: self._runtime.post(lambda: self._feedback(running)),
        )

    def _feedback(self, running: RunningTree) -> None:
        if running not in self._running:
            return
        tree = running.run.tree
        if tree is not None:
            pose = self._pose.latest or PoseStamped()
            running.goal.served.publish_feedback(
                feedback_of(tree, running.run.board, pose, self._seconds(running.goal))
            )
        self._schedule_feedback(running)

    def _seconds(self, goal: TreeGoal) -> float:
        return self._runtime.clock.now() - goal.accepted


def _refused(why: str) -> Any:
    return Result(code=Result.ERROR, message=why)


def _replaced() -> RunOutcome:
    return RunOutcome(Result.CANCELED, 'a newer goal for the same tree has taken over')

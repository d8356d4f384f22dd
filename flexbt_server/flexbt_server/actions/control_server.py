# SPDX-License-Identifier: BSD-3-Clause
"""The services that control running trees (pause, step, breakpoints), and that show their blackboards."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from rclpy.task import Future

from flexbt_common import names
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.values.fields import constants_of
from flexbt_common.values.limits import check_limits
from flexbt_core.behavior_tree.engine.tick_control import TickCommand
from flexbt_core.clock.work_thread import WorkThread
from flexbt_core.errors import FlexbtError
from flexbt_core.values.text import did_you_mean, sanitize_for_message, short_repr
from flexbt_msgs.msg import TreeBreakpoint, TreeHold
from flexbt_msgs.srv import ControlTree, GetTreeBlackboard
from flexbt_server.errors import BreakpointError
from flexbt_server.runs.tree_debugger import DebuggedRun, NodesOfTree, TreeDebugger, blackboard_writes
from flexbt_server.trees.tree_store import TreeStore

from .tree_goals import MESSAGE_LIMIT, RunningTree, TreeGoals

Request = ControlTree.Request

_TICKS: Final = {
    Request.PAUSE: TickCommand.PAUSE,
    Request.RESUME: TickCommand.RESUME,
    Request.STEP: TickCommand.STEP,
    Request.CONTINUE: TickCommand.RESUME,
}

_POINTS: Final = {
    Request.BREAK: TreeBreakpoint.BREAK,
    Request.RUN_TO: TreeBreakpoint.BREAK,
    Request.FORCE: TreeBreakpoint.FORCE,
    Request.DUMMY: TreeBreakpoint.DUMMY,
    Request.RECORD: TreeBreakpoint.RECORD,
}
"""The commands that set something at a tree."""


class ControlServer:
    """The servers of ControlTree and GetTreeBlackboard, for any number of clients.

    It answers a request when the command has taken effect, or can no longer take effect.
    """

    def __init__(
        self, runtime: Runtime, goals: TreeGoals, debugger: TreeDebugger, store: TreeStore, reader: WorkThread
    ) -> None:
        self._runtime = runtime
        self._goals = goals
        self._debugger = debugger
        self._store = store
        self._reader = reader
        runtime.node.create_service(ControlTree, names.CONTROL_TREE, self._serve)
        runtime.node.create_service(GetTreeBlackboard, names.GET_TREE_BLACKBOARD, self._show)

    async def _serve(self, request: Any, response: Any) -> Any:
        try:
            check_limits(request)
            response.message = await self._obey(request, response)
        except Exception as error:
            response.message = self._reason_of(error)
        response.success = not response.message
        return response

    def _reason_of(self, error: Exception) -> str:
        """Return why a request has failed. The client gets a fault of the server too, which is reported."""
        if isinstance(error, FlexbtError):
            return sanitize_for_message(str(error))
        self._runtime.report_fault(error, f'a request to {names.CONTROL_TREE} or {names.GET_TREE_BLACKBOARD}')
        return sanitize_for_message(f'fault in the BT server: {error!r}', MESSAGE_LIMIT)

    async def _obey(self, request: Any, response: Any) -> str:
        """Execute the command. Return '' when it has taken effect, otherwise the reason why not.

        Raises FlexbtError: likewise.
        """
        command = request.command
        if command in _POINTS:
            if command == Request.RUN_TO:
                request.behavior_tree = self._held(request.run_id).key.id
            tree = await self._tree(request)
            point = TreeBreakpoint(
                kind=_POINTS[command],
                path=request.node,
                condition=request.condition,
                status=request.status,
                operator_id=request.operator_id,
                once=command == Request.RUN_TO,
            )
            self._debugger.place(point, tree)
            if command != Request.RUN_TO:
                return ''
            request.command = command = Request.CONTINUE
        elif command == Request.CLEAR:
            self._debugger.clear(self._tree_to_clear(request), request.node)
            return ''
        if command == Request.SET:
            running = self._held(request.run_id)
            self._debugger.run(running.id).assign(request.node, request.condition, request.operator_id)
            return ''
        if command not in _TICKS:
            constants = sorted((value, name) for name, value in constants_of(Request).items() if value)
            known = ', '.join(f'{value} ({name})' for value, name in constants)
            return f'command {command} is unknown; known commands: {known}'
        return await self._tick(request, response)

    async def _tick(self, request: Any, response: Any) -> str:
        command = _TICKS[request.command]
        running, debugged = self._find(request.run_id)
        if request.command == Request.CONTINUE:
            self._held(request.run_id)
        is_held = debugged.is_held_in_tick
        if is_held and command is TickCommand.STEP:
            command = TickCommand.PAUSE  # after the tick that is under way
        if command is TickCommand.PAUSE:
            debugged.paused_by = sanitize_for_message(request.operator_id or request.owner)
        answered = Future(executor=self._runtime.node.executor)
        run = self._goals.control(
            running.id,
            command,
            request.owner,
            lambda reason: self._runtime.post(lambda: answered.set_result(reason)),
        )
        if is_held and request.command in (Request.STEP, Request.CONTINUE):
            debugged.go_on()
        refusal = str(await answered)
        if command is not TickCommand.RESUME and not refusal:
            response.not_paused = [sanitize_for_message(line) for line in run.not_paused]
        return refusal

    def _find(self, run_id: str) -> tuple[RunningTree, DebuggedRun]:
        """Return a run and its part in the debugger. Raises FlexbtError: there is none, or not this hold of it."""
        run_id, _, since = run_id.partition('@')
        running = self._goals.running.find(run_id)
        debugged = self._debugger.run(running.id)
        if since and (debugged.hold is None or not since.isdecimal() or abs(int(since) - _since(debugged.hold)) > 1):
            raise BreakpointError(f'{running.description} has gone on meanwhile from where it was held')
        return running, debugged

    def _held(self, run_id: str) -> RunningTree:
        """Return a run that is held or paused. Raises FlexbtError: it is not."""
        running, debugged = self._find(run_id)
        if debugged.hold is None:
            raise BreakpointError(f'{running.description} is neither held at a breakpoint nor paused')
        return running

    async def _tree(self, request: Any) -> NodesOfTree:
        """Return the tree at which the request sets something: one that runs, or the tree of a file."""
        named = request.behavior_tree
        for running in self._goals.running.all() if named else [self._goals.running.find(request.run_id)]:
            if not named or running.key.id == named:
                return self._debugger.run(running.id).nodes
        return NodesOfTree.of_definition(await self._read(lambda: self._store.find(named)))

    async def _read(self, read: Callable[[], Any]) -> Any:
        """Return what ``read`` returns on the thread that reads files. Raises its exception."""
        done = Future(executor=self._runtime.node.executor)

        def work() -> None:
            try:
                found = read()
            except Exception as error:
                fault = error
                self._runtime.post(lambda: done.set_exception(fault))
            else:
                self._runtime.post(lambda: done.set_result(found))

        self._reader.submit(work, 'a tree was not read for a breakpoint')
        return await done

    def _tree_to_clear(self, request: Any) -> str:
        trees = self._debugger.trees()
        if request.behavior_tree or request.run_id:
            named = request.behavior_tree or self._goals.running.find(request.run_id).key.id
            return str(named)
        if len(trees) != 1:
            which = f'name the tree: {", ".join(sorted(trees))}' if trees else 'nothing is set at any tree'
            raise BreakpointError(which)
        return next(iter(trees))

    def _show(self, request: Any, response: Any) -> Any:
        try:
            check_limits(request)
            running, debugged = self._find(request.run_id)
            tree = debugged.tree
            response.run_id, response.behavior_tree = running.id, running.key.id
            response.recorded = self._debugger.watch.is_watching(debugged)
            entries = blackboard_writes(debugged, self._debugger.watch, request.keys)
            response.entries = entries[:MOST_ENTRIES]
            known = {entry.key for entry in entries}
            missing = [key for key in request.keys if key not in known]
            if missing:
                keys = {key for subtree in tree.subtrees for key in subtree.blackboard}
                response.message = f'there is no entry {short_repr(missing[0])}{did_you_mean(missing[0], keys)}'
            elif len(entries) > MOST_ENTRIES:
                response.message = f'there are {len(entries)} entries; name keys: {MOST_ENTRIES} are shown at most'
        except Exception as error:
            response.message = self._reason_of(error)
        response.success = not response.message
        return response


def _since(hold: TreeHold) -> int:
    """Return when a hold began, in µs."""
    return int(hold.since.sec) * 10**6 + int(hold.since.nanosec) // 1000


MOST_ENTRIES: Final = 1000
"""Maximum number of entries of blackboards in a response."""

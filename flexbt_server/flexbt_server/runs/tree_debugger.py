# SPDX-License-Identifier: BSD-3-Clause
"""The debugger of trees: breakpoints, forced results, dummies, and the trees that are held.

What is set belongs to a node of a tree, not to a run: each run of the tree has it, until it is cleared or the server
ends. All of it is state, which the latched topic ``tree_debugging`` shows with who has set it. A tree without
breakpoints has no callbacks, and ticks as fast as if there were no debugger.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final

from flexbt_common import names
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.values.message_fields import time_message
from flexbt_core.behavior_tree.engine.blackboard_watch import BlackboardWatch
from flexbt_core.behavior_tree.engine.node import TreeNode, node_path
from flexbt_core.behavior_tree.engine.tick_control import TickControl
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import EMPTY
from flexbt_core.behavior_tree.model.definition import RunnableScript, ScriptFactory
from flexbt_core.behavior_tree.model.errors import ScriptError, TickAbandoned
from flexbt_core.behavior_tree.model.status import SKIPPED, NodeStatus
from flexbt_core.behavior_tree.script.parser import is_assigning
from flexbt_core.clock.waiting import WakeEvent
from flexbt_core.values.text import did_you_mean, sanitize_for_message, short_repr
from flexbt_msgs import msg
from flexbt_msgs.msg import TreeBreakpoint, TreeHold
from flexbt_server.errors import BreakpointError
from flexbt_server.trees.tree_store import FoundTree

from .run_events import RunEnded, RunEvent, RunEvents, RunPaused, RunReader, RunStarted, TreeExpanded

MOST_BREAKPOINTS: Final = 100
"""Maximum number of breakpoints of a server: every status of an executive lists them."""

MOST_HOLDS: Final = 20
"""Maximum number of held trees that are shown."""

PATH_LENGTH: Final = 4000
"""Maximum characters of the path of a node with a breakpoint."""

_REASON_LENGTH: Final = 500
_UID: Final = re.compile(r'::\d+(?=/|$)')

BREAK, FORCE, DUMMY, RECORD = (getattr(TreeBreakpoint, name) for name in ('BREAK', 'FORCE', 'DUMMY', 'RECORD'))
_RESULTS: Final = {int(status): status for status in (NodeStatus.SUCCESS, NodeStatus.FAILURE)}


class TreeDebugger:
    """What was set to debug the trees of a server. From any thread."""

    def __init__(self, runtime: Runtime) -> None:
        self.watch = BlackboardWatch(runtime.clock.now)
        """The writers of the blackboards of trees at which something was set."""
        self._runtime = runtime
        self._points: dict[tuple[str, str, int], TreeBreakpoint] = {}
        self._runs: dict[str, DebuggedRun] = {}
        self._lock = threading.RLock()
        self._publisher: Any = runtime.node.create_publisher(
            msg.TreeDebugging, names.TREE_DEBUGGING, names.transient_local_qos()
        )
        self.changed()

    def open(self, events: RunEvents) -> RunReader:
        """Return the reader that debugs one run."""
        with self._lock:
            run = self._runs[events.run_id] = DebuggedRun(self, events.run_id, self._runtime)
        return run

    def run(self, run_id: str) -> DebuggedRun:
        """Return a run that has not ended."""
        with self._lock:
            if run_id not in self._runs:
                raise BreakpointError('the run has ended')
            return self._runs[run_id]

    def place(self, point: TreeBreakpoint, tree: NodesOfTree) -> None:
        """Set a breakpoint at the node that ``point.path`` names; it replaces one of the same kind.

        Raises BreakpointError: there is no such node, its condition or result is wrong, or there are too many.
        """
        point.behavior_tree = tree.id
        if point.kind != RECORD:
            point.path = tree.node(point.path)
        if point.kind in (FORCE, DUMMY) and point.status not in _RESULTS:
            raise BreakpointError(f'status {point.status} cannot be given to a node; use SUCCESS (2) or FAILURE (3)')
        _check_condition(point.condition, tree.scripts)
        point.operator_id = sanitize_for_message(point.operator_id)
        point.stamp = self._runtime.clock.stamp()
        key = (point.behavior_tree, point.path, point.kind)
        with self._lock:
            known = self._points.get(key)
            if point.once and known is not None and not known.once:
                return  # it is reached anyway
            if known is None and len(self._points) >= MOST_BREAKPOINTS:
                raise BreakpointError(f'{MOST_BREAKPOINTS} breakpoints are set already; clear one first')
            self._points[key] = point
            self._attach(point.behavior_tree)
        self.changed()

    def clear(self, tree: str, node: str) -> None:
        """Clear what was set at a node, or with '' at the tree. A tree that is held there goes on only when told.

        Raises BreakpointError: nothing is set there.
        """
        with self._lock:
            paths = [path for id, path, _ in self._points if id == tree]
            path = _named(node, paths, f'tree {tree!r} has nothing set at') if node else ''
            cleared = [key for key in self._points if key[0] == tree and (not node or key[1] == path)]
            if not cleared:
                raise BreakpointError(f'nothing is set at tree {tree!r}' + did_you_mean(tree, self.trees(), ''))
            for key in cleared:
                del self._points[key]
            self._attach(tree)
        self.changed()

    def trees(self) -> set[str]:
        """Return the identifiers of the trees at which something is set."""
        with self._lock:
            return {tree for tree, _, _ in self._points}

    # -- for the runs --------------------------------------------------------------------------------------------------

    def begin(self, run: DebuggedRun) -> None:
        """Set the breakpoints of its tree in a run whose nodes are new."""
        with self._lock:
            found = self._attach(run.tree_id)
        if found:
            self.changed()

    def end(self, run: DebuggedRun) -> None:
        """Forget a run that has ended."""
        with self._lock:
            known = self._runs.pop(run.run_id, None)
            self.watch.leave(run)
        if known is not None and known.hold is not None:
            self.changed()

    def at(self, tree: str, path: str, kind: int) -> TreeBreakpoint | None:
        """Return what is set at a node."""
        return self._points.get((tree, path, kind))

    def drop(self, point: TreeBreakpoint) -> None:
        """Clear a breakpoint that was for one time, unless another one has taken its place."""
        tree = str(point.behavior_tree)
        key = (tree, point.path, point.kind)
        with self._lock:
            if self._points.get(key) is point:
                del self._points[key]
                self._attach(tree)
        self.changed()

    def changed(self) -> None:
        """Publish everything."""
        with self._lock:
            holds = [run.hold for run in self._runs.values() if run.hold is not None]
            message = msg.TreeDebugging(
                server=self._runtime.node.get_fully_qualified_name(),
                breakpoints=[point for _, point in sorted(self._points.items())],
                holds=sorted(holds, key=lambda hold: (hold.since.sec, hold.since.nanosec))[:MOST_HOLDS],
            )
            try:
                self._publisher.publish(message)
            except Exception as error:
                self._runtime.report_fault(error, f'the topic {names.TREE_DEBUGGING}')

    def _attach(self, tree: str) -> bool:
        """Let the runs of a tree have its breakpoints. Return whether there are any."""
        points = [point for (id, _, _), point in self._points.items() if id == tree]
        for run in self._runs.values():
            if run.tree_id == tree:
                run.attach(points)
        return bool(points)


class DebuggedRun(RunReader):
    """One run of a tree with the breakpoints of its tree. ``hold`` is set while it is held or paused."""

    def __init__(self, debugger: TreeDebugger, run_id: str, runtime: Runtime) -> None:
        self.run_id = run_id
        self.tree_id = ''
        self.hold: TreeHold | None = None
        self.paused_by = ''
        """The operator who has paused it last."""
        self.is_held_in_tick = False
        self._debugger = debugger
        self._runtime = runtime
        self._going = WakeEvent()
        self._nodes: dict[str, TreeNode] = {}
        self._attached: dict[str, TreeNode] = {}
        self._scripts: dict[str, tuple[TreeBreakpoint, RunnableScript]] = {}

    def read(self, event: RunEvent) -> None:
        """See :class:`RunReader`."""
        match event:
            case RunStarted(tree, TickControl() as control):
                self._tree, self._control, self.tree_id = tree, control, tree.key.id
                self._take_nodes()
            case TreeExpanded():
                self._take_nodes()
            case RunPaused(is_paused):
                self._paused(is_paused)
            case RunEnded():
                self._debugger.end(self)

    @property
    def nodes(self) -> NodesOfTree:
        """The nodes that the run has now. Raises BreakpointError: as :attr:`tree`."""
        return NodesOfTree(self.tree_id, tuple(self._nodes), self.tree.context.scripts)

    @property
    def tree(self) -> Tree:
        """The running tree. Raises BreakpointError: it has not begun yet."""
        if not self._nodes:
            raise BreakpointError('the tree is being started; try again')
        return self._tree

    def assign(self, name: str, script: str, operator: str) -> None:
        """Run a script on the blackboard of a node, by default the root's. The tree must be held or paused.

        Raises BreakpointError: there is no such node, or the script cannot be run; what it has assigned before stays.
        """
        node = self._nodes[self.nodes.node(name)] if name else self.tree.root
        watch = self._debugger.watch
        watch.outside = f'operator {sanitize_for_message(operator)}'
        try:
            self._tree.context.scripts.script(script).bind(node.blackboard).run()
        except ScriptError as error:
            raise BreakpointError(f'the script {short_repr(script)} cannot be run: {error.reason}') from error
        finally:
            watch.outside = ''

    def go_on(self) -> None:
        """Release the tree from the breakpoint that holds it."""
        self._going.set()

    def attach(self, points: Iterable[TreeBreakpoint]) -> None:
        """Have these breakpoints from now on."""
        points = list(points)
        wanted = {point.path: self._nodes[point.path] for point in points if point.path in self._nodes}
        for path, node in self._attached.items():
            if wanted.get(path) is not node:
                self._tree.callbacks.set_pre_tick(node, None, self)
        for path, node in wanted.items():
            if self._attached.get(path) is not node:
                self._tree.callbacks.set_pre_tick(node, self._reached, self)
        self._attached = wanted
        if points:
            self._debugger.watch.watch(self, [subtree.blackboard for subtree in self._tree.subtrees])
        else:
            self._debugger.watch.leave(self)
        for point in points:
            if point.path and point.path not in self._nodes:
                point.problem = f'run {self.run_id} has no such node'
                point.problem += did_you_mean(_last(point.path), [_last(path) for path in self._nodes], '')
            elif point.problem.startswith('run '):
                point.problem = ''

    def _take_nodes(self) -> None:
        self._nodes = {node.path: node for node in self._tree.nodes}
        self._debugger.begin(self)

    def _paused(self, is_paused: bool) -> None:
        if self.is_held_in_tick:
            return  # it is shown as held at a node
        if is_paused:
            operator = self.paused_by if self._control.is_paused_by_command else ''
            self._hold('', operator, self._control.reason or 'paused')
        else:
            self.hold, self.paused_by = None, ''
            self._debugger.changed()

    def _hold(self, path: str, operator: str, reason: str) -> None:
        is_paused_since = self.hold.since if self.hold is not None and not (path or self.hold.path) else None
        self.hold = TreeHold(
            run_id=self.run_id,
            behavior_tree=self.tree_id,
            path=sanitize_for_message(path),
            operator_id=operator,
            since=is_paused_since or self._runtime.clock.stamp(),
            reason=sanitize_for_message(reason, _REASON_LENGTH),
            not_paused=[sanitize_for_message(line, _REASON_LENGTH) for line in self._control.not_paused],
        )
        self._debugger.changed()

    # -- on the ticking thread -----------------------------------------------------------------------------------------

    def _reached(self, node: TreeNode) -> NodeStatus:
        """Hold the tree before the tick of a node, and return the result that replaces the tick; SKIPPED for none."""
        path = node.path
        point = self._debugger.at(self.tree_id, path, BREAK)
        if point is not None and (reason := self._why_held(point, node)):
            self._hold_at(point, node, reason)
        for kind in (FORCE, DUMMY):
            point = self._debugger.at(self.tree_id, path, kind)
            if point is not None:
                point.hits += 1
                if kind == FORCE:
                    self._debugger.drop(point)
                return _RESULTS[point.status]
        return SKIPPED

    def _why_held(self, point: TreeBreakpoint, node: TreeNode) -> str:
        """Return why the breakpoint holds the tree now; '' if it does not. A condition that raises holds it, too."""
        if not point.condition:
            return 'breakpoint'
        known, script = self._scripts.get(node.path, (None, None))
        try:
            if known is not point or script is None:
                script = self._tree.context.scripts.script(point.condition).bind(node.blackboard, condition=True)
                self._scripts[node.path] = point, script
            is_true, problem = script.run(), ''
        except ScriptError as error:
            is_true, problem = True, f'its condition {short_repr(point.condition)} cannot be evaluated: {error.reason}'
        before, point.problem = point.problem, sanitize_for_message(problem, _REASON_LENGTH)
        if before and not problem:
            self._debugger.changed()
        return '' if not is_true else f'breakpoint; {problem}' if problem else f'breakpoint if {point.condition}'

    def _hold_at(self, point: TreeBreakpoint, node: TreeNode, reason: str) -> None:
        context = self._tree.context
        self._going.take()
        self.is_held_in_tick = True
        before = self.hold
        point.hits += 1
        if point.once:
            self._debugger.drop(point)
        try:
            with self._control.held_in_tick(self._tree):
                self._hold(node.path, point.operator_id, reason)
                if not context.stop_requested:
                    context.wait(self._going, self._runtime.steady, None)
                if context.stop_requested:
                    raise TickAbandoned(node.path, node.id, 'the tree was stopped while a breakpoint held it here')
        finally:
            self.is_held_in_tick = False
            self.hold = before  # it may be a step of a paused tree
            self._debugger.changed()


# The nodes of a tree by name, running or not.


@dataclass(frozen=True)
class NodesOfTree:
    """The paths of the nodes of a tree, and what makes scripts for it."""

    id: str
    paths: tuple[str, ...]
    scripts: ScriptFactory

    @classmethod
    def of_definition(cls, found: FoundTree) -> NodesOfTree:
        """Return the nodes that a run of the tree will begin with."""
        return cls(found.key.id, tuple(_defined_paths(found)), found.library.documents[found.key.file].scripts)

    def node(self, name: str) -> str:
        """Return the path of a node, from its path or the last part of it. Raises BreakpointError: it is not one."""
        path = _named(name, self.paths, f'tree {self.id!r} has no node')
        if len(path) > PATH_LENGTH:
            raise BreakpointError(f'the path of the node has {len(path)} characters, and may have {PATH_LENGTH}')
        return path


def _defined_paths(found: FoundTree) -> Iterator[str]:
    """Yield the paths of nodes in the order of their uids, as ``tree_builder`` makes them."""
    library, pending, uid = found.library, [(found.library.definition(found.key).root, found.key.file, '')], 0
    while pending:
        definition, file, scope = pending.pop()
        uid += 1
        path = node_path(scope, definition.tree_id or definition.manifest.id, definition.name, uid)
        yield path
        if definition.tree_id is None:
            pending.extend((child, file, scope) for child in reversed(definition.children))
        elif (key := library.find(definition.tree_id, file)) is not None:
            pending.append((library.definition(key).root, key.file, path))


def _last(path: str) -> str:
    return _UID.sub('', path.rpartition('/')[2])


def _named(name: str, paths: Iterable[str], missing: str) -> str:
    """Return the path that equals ``name``, or the only one that ends with it, or does so without the uids in it.

    Raises BreakpointError, with the text ``missing`` before the quoted name, or with the paths that fit.
    """
    known = tuple(dict.fromkeys(paths))
    if name in known:
        return name
    ends = [path for path in known if f'/{path}'.endswith(f'/{name}')]
    found = ends or [path for path in known if f'/{_UID.sub("", path)}'.endswith(f'/{name}')]
    if len(found) == 1 and name:
        return found[0]
    if found and name:
        shown = ', '.join(found[:10]) + (f', and {len(found) - 10} more' if len(found) > 10 else '')
        raise BreakpointError(f'several nodes are called {short_repr(name)}; name one by its path: {shown}')
    raise BreakpointError(f'{missing} {short_repr(name)}' + did_you_mean(name, {_last(path) for path in known}))


def _check_condition(text: str, scripts: ScriptFactory) -> None:
    """Raise BreakpointError: the text is no script, or a script that changes the blackboard."""
    if not text:
        return
    try:
        scripts.script(text)
    except ScriptError as error:
        raise BreakpointError(f'the condition is not a script: {error}') from error
    if is_assigning(text):
        raise BreakpointError(f'the condition {short_repr(text)} is not a condition: it would change the blackboard')


# The blackboards of a run, with their writers.


def blackboard_writes(run: DebuggedRun, watch: BlackboardWatch, keys: Iterable[str]) -> list[msg.BlackboardWrites]:
    """Return the entries of the blackboards of a run, of these keys or with none of all, by scope and key."""
    wanted = set(keys)
    return [
        _writes_of(subtree.path, key, entry, watch)
        for subtree in sorted(run.tree.subtrees, key=lambda one: one.path)
        for key, entry in sorted(subtree.blackboard.entries().items())
        if not wanted or key in wanted
    ]


def _writes_of(scope: str, key: str, entry: Any, watch: BlackboardWatch) -> msg.BlackboardWrites:
    value, writes = entry.value, watch.writes(entry)
    latest = tuple(writes.latest)
    return msg.BlackboardWrites(
        scope=sanitize_for_message(scope),
        key=sanitize_for_message(key),
        type='' if entry.type is None else entry.type.name,
        text='' if value is EMPTY else sanitize_for_message(short_repr(value)),
        count=writes.count,
        writers=[sanitize_for_message(one.writer) for one in latest],
        stamps=[time_message(max(0.0, one.when)) for one in latest],
        values=[sanitize_for_message(one.value) for one in latest],
    )

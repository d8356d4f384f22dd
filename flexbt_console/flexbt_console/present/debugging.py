# SPDX-License-Identifier: BSD-3-Clause
"""The debugger of trees as lines: trees that are held, breakpoints, blackboards with their writers, and why a node does
not run. Everything that came over the network is escaped."""

from __future__ import annotations

import shlex
from itertools import pairwise
from typing import Final

from flexbt_console.mirror.records import BreakpointKind, ExecutiveSnapshot, TreeBlackboard, TreeBreakpoint, TreeHold
from flexbt_console.mirror.trees import MirroredNode, MirroredStatus, MirroredTree
from flexbt_core.values.text import one_line, pluralize

from .rendering import stamp_text
from .style import Line, Tone

_RESULTS: Final = {2: 'SUCCESS', 3: 'FAILURE'}


def held_lines(snapshot: ExecutiveSnapshot) -> list[str]:
    """Return a line for each tree that is held or paused, and how it goes on."""
    return [Line(_held_text(hold, snapshot), Tone.WARNING) for hold in snapshot.tree_holds]


def _held_text(hold: TreeHold, snapshot: ExecutiveSnapshot) -> str:
    seconds = max(0.0, snapshot.stamp - hold.since)
    goes_on = f'; still active: {", ".join(map(one_line, hold.not_paused))}' if hold.not_paused else ''
    return held_text(hold, f'for {seconds:.0f} s', f'; "tree continue" goes on{goes_on}')


def held_text(hold: TreeHold, since: str, goes_on: str = '') -> str:
    """Return where a tree is held, ``since`` when and why, and how it ``goes_on``."""
    where = f'HELD before {one_line(hold.path)}' if hold.path else 'PAUSED'
    who = f' of {one_line(hold.operator)}' if hold.operator else ''
    reason = '' if hold.reason == 'paused' else f' ({one_line(hold.reason)}{who})'
    who = f' by {one_line(hold.operator)}' if not reason and hold.operator else ''
    return f'tree {one_line(hold.tree)} {where} {since}{reason}{who}{goes_on}'


def breakpoint_lines(snapshot: ExecutiveSnapshot) -> list[str]:
    """Return a line for each breakpoint, forced result and dummy in trees."""
    return [
        Line(breakpoint_text(point), Tone.WARNING if point.problem else Tone.PLAIN)
        for point in snapshot.tree_breakpoints
    ]


def breakpoint_summary(snapshot: ExecutiveSnapshot) -> list[str]:
    """Return that something is set at trees, in one line; nothing if nothing is."""
    count = len(snapshot.tree_breakpoints)
    problems = [f'; {one_line(point.problem)}' for point in snapshot.tree_breakpoints if point.problem][:1]
    text = f'{pluralize(count, "breakpoint")} in trees; "status" lists what was set{"".join(problems)}'
    return [Line(text, Tone.WARNING if problems else Tone.DIM)] if count else []


def breakpoint_text(point: TreeBreakpoint) -> str:
    """Return what was set at a node of a tree, by whom and when."""
    where, tree = one_line(point.path), one_line(point.tree)
    result = _RESULTS.get(point.status, '?')
    condition = f' if {one_line(point.condition)}' if point.condition else ''
    what = {
        BreakpointKind.BREAK: f'{"run to" if point.once else "break before"} {where}{condition}',
        BreakpointKind.FORCE: f'{where} returns {result}, once',
        BreakpointKind.DUMMY: f'{where} is a dummy: {result}',
        BreakpointKind.RECORD: 'writers of the blackboard are recorded',
    }.get(point.kind, where)
    hits = f', {pluralize(point.hits, "hit")}' if point.hits else ''
    by = f' by {one_line(point.operator)}' if point.operator else ''
    problem = f'; {one_line(point.problem)}' if point.problem else ''
    return f'tree {tree}: {what} (set{by} at {stamp_text(point.stamp)}{hits}){problem}'


def marks_of_nodes(snapshot: ExecutiveSnapshot | None, run: MirroredTree) -> dict[str, str]:
    """Return the remarks of the debugger about nodes of a run, for their lines, by the paths of the nodes."""
    marks: dict[str, str] = {}
    for point in snapshot.tree_breakpoints if snapshot is not None else ():
        if point.tree == run.tree and point.path:
            marks[point.path] = f'{marks.get(point.path, "")}  {mark_of(point)}'
    for hold in _holds(run, snapshot):
        if hold.path:
            marks[hold.path] = f'  HELD HERE{marks.get(hold.path, "")}'
    return marks


def mark_of(point: TreeBreakpoint) -> str:
    """Return what was set at a node, in two words at most."""
    if point.kind is BreakpointKind.BREAK:
        return 'breakpoint'
    return f'{point.kind.name.lower()} {_RESULTS.get(point.status, "?")}'


def debug_lines(run: MirroredTree, node: MirroredNode, *, has_marks: bool) -> dict[str, str]:
    """Return the commands of the debugger for a node, as lines that can be typed, by short names."""
    path, of_run = shlex.quote(node.path), f'--run {shlex.quote(run.run_id)}'
    lines = {'break': f'break {path} {of_run}', 'run-to': f'tree run-to {path} {of_run}'}
    if has_marks:
        lines['clear'] = f'tree clear {path} {of_run}'
    for verb in ('force', 'dummy'):
        lines |= {f'{verb} {result}': f'tree {verb} {path} {result} {of_run}' for result in _RESULTS.values()}
    return {**lines, 'why': f'tree why {path} {of_run}', 'blackboard': f'tree blackboard {of_run}'}


def blackboard_lines(board: TreeBlackboard) -> list[str]:
    """Return the entries of the blackboards of a tree, each with its latest writers."""
    shown: list[str] = []
    scope: str | None = None
    for entry in board.entries:
        if entry.scope != scope:
            scope = entry.scope
            shown.append(f'sub-tree {one_line(scope)}' if scope else f'tree {one_line(board.tree)}')
        kind = f' ({one_line(entry.type)})' if entry.type else ''
        shown.append(f'  {one_line(entry.key)}{kind} = {one_line(entry.text) or "never written"}')
        for write in entry.writes:
            writer = one_line(write.writer) or 'no node: a goal, a client or another program'
            shown.append(Line(f'      {stamp_text(write.stamp)}  {one_line(write.value)}  by {writer}', Tone.DIM))
        if (left := entry.count - len(entry.writes)) > 0:
            shown.append(Line(f'      and {pluralize(left, "write")} before', Tone.DIM))
    if not board.recorded:
        shown.append(Line('who writes is not recorded; "tree record" begins it', Tone.DIM))
    return shown or ['the blackboards are empty']


def why_lines(run: MirroredTree, uid: int, snapshot: ExecutiveSnapshot | None) -> list[str]:
    """Return why a node does not run: the decisions of the nodes above it, from the root to the one that decides."""
    nodes = {node.uid: node for node in run.nodes}
    chain = [nodes[uid]]
    while chain[0].parent in nodes and chain[0].parent < chain[0].uid:  # there is no ring
        chain.insert(0, nodes[chain[0].parent])
    node = chain[-1]
    if run.status(uid) is MirroredStatus.RUNNING and run.is_running:
        shown: list[str] = [f'{_name(node)} is running, for {run.seconds(uid):.0f} s']
    else:
        shown = [f'{_name(node)} is not running: {_past(run, node)}']
    if run.server_gone:
        shown.append(Line('the BT server is gone', Tone.ERROR))
    elif run.finished:
        shown.append(f'the run of tree {one_line(run.tree)} has ended')
    shown += [Line(_held_text(hold, snapshot), Tone.WARNING) for hold in _holds(run, snapshot) if snapshot is not None]
    for depth, (above, below) in enumerate(pairwise(chain)):
        shown.append(f'{"  " * (depth + 1)}{_decision(run, above, below)}')
        if run.status(below.uid) is not MirroredStatus.RUNNING:
            break
    return shown


def _holds(run: MirroredTree, snapshot: ExecutiveSnapshot | None) -> list[TreeHold]:
    return [hold for hold in snapshot.tree_holds if hold.run_id == run.run_id] if snapshot is not None else []


def _decision(run: MirroredTree, above: MirroredNode, below: MirroredNode) -> str:
    """Return what a node has decided about one of its children."""
    children = run.children(above.uid)
    which = {child.uid: f'child {number} of {len(children)}' for number, child in enumerate(children, 1)}
    if len(children) == 1:
        which = dict.fromkeys(which, 'its child')
    head = f'{_name(above)} ({one_line(above.registration)})'
    if run.status(above.uid) is not MirroredStatus.RUNNING:
        causes = [child for child in children if run.shown_status(child.uid) is MirroredStatus.FAILURE]
        because = f', as {_name(causes[0])} has failed' if causes and _ended(run, above) == 'FAILURE' else ''
        return f'{head} does not run: {_past(run, above)}{because}'
    if run.status(below.uid) is MirroredStatus.RUNNING:
        return f'{head} runs {_name(below)}, {which[below.uid]}'
    busy = [child for child in children if run.status(child.uid) is MirroredStatus.RUNNING]
    now = ', '.join(f'{_name(child)} ({which[child.uid]})' for child in busy)
    return f'{head} runs {now or "none of its children"}; {_name(below)} ({which[below.uid]}): {_past(run, below)}'


def _past(run: MirroredTree, node: MirroredNode) -> str:
    how = _ended(run, node)
    if not how:
        return f'idle for {run.seconds(node.uid):.0f} s, without a result in this run'
    if run.status(node.uid) is MirroredStatus.IDLE:
        return f'it had ended by {how}, and has been idle for {run.seconds(node.uid):.0f} s'
    return f'it has ended by {how}, {run.seconds(node.uid):.0f} s ago'


def _ended(run: MirroredTree, node: MirroredNode) -> str:
    status = run.shown_status(node.uid)
    return '' if status in (MirroredStatus.IDLE, MirroredStatus.RUNNING) else status.name


def _name(node: MirroredNode) -> str:
    return one_line(node.name) or one_line(node.registration)

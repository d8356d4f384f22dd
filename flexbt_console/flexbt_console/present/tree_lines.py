# SPDX-License-Identifier: BSD-3-Clause
"""A running tree as lines: statuses, times, and the nodes that act always among the lines that are shown."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from flexbt_console.mirror.trees import MirroredNode, MirroredNodeKind, MirroredStatus, MirroredTree
from flexbt_core.values.text import one_line

from .cells import cut
from .style import Glyphs, Line, Tone, toned

_TONES: Final = {
    MirroredStatus.IDLE: Tone.DIM,
    MirroredStatus.RUNNING: Tone.DECISION,
    MirroredStatus.SUCCESS: Tone.GOOD,
    MirroredStatus.FAILURE: Tone.ERROR,
    MirroredStatus.SKIPPED: Tone.DIM,
}

HELD_SECONDS: Final = 5.0
"""A node that has ended counts as of now for this time: one that is ticked at a rate keeps its line in between."""

NO_MARKS: Final[Mapping[str, str]] = {}

SHOWN_SECONDS: Final = 1.0
"""A status that has held for less time is shown without it."""


def tree_lines(
    run: MirroredTree, columns: int, rows: int, signs: Glyphs, marks: Mapping[str, str] = NO_MARKS
) -> list[str]:
    """Return the tree in at most this many rows of this many cells: a title, then the nodes around those that act.

    A condition has a question mark behind its name. A node that was halted shows, dimmed, how it had ended before: the
    reason of a failure stays to be seen. All are dim when the server is gone. If there is no room for all, controls and
    decorators without their own name are left out, and what is below nodes that have not run lately; then what has not
    run lately and has not failed, and ways that a condition keeps closed; and at last all that does not act. ``marks``
    are remarks by the paths of nodes, which stay among the lines.
    """
    if rows <= 0:
        return []
    nodes = _in_order(run, lambda node: True)
    if len(nodes) > rows - 1:
        nodes = _in_order(
            run,
            lambda node: _is_of_now(run, node) or bool(marks),
            is_left_out=lambda node: _is_structure(node) and node.path not in marks,
        )
    if len(nodes) > rows - 1:
        closed = _closed_ways(run)
        nodes = [
            (node, depth)
            for node, depth in nodes
            if node.path in marks
            or (node.uid not in closed and (_is_of_now(run, node) or run.status(node.uid) is MirroredStatus.FAILURE))
        ]
    if len(nodes) > rows - 1:
        nodes = [(node, depth) for node, depth in nodes if _acts(run, node) or node.path in marks]
    lines = [_node_line(run, node, depth, signs, marks) for node, depth in nodes]
    acting = set(run.running_leaves)
    held = [place for place, (node, _) in enumerate(nodes) if node.path in marks]
    marked = held or [place for place, (node, _) in enumerate(nodes) if node.uid in acting]
    marked = marked or [place for place, (node, _) in enumerate(nodes) if _is_of_now(run, node)]
    shown = window(lines, marked[-1] if marked else 0, rows - 1)
    title = _title(run)
    return [cut(title, columns), *(_cut_line(line, columns) for line in shown)]


def whole_tree_lines(run: MirroredTree, signs: Glyphs, marks: Mapping[str, str] = NO_MARKS) -> list[str]:
    """Return the whole tree, of any length, then each failed node with the nodes that failed because of it."""
    nodes = _in_order(run, lambda node: True)
    shown = [_title(run), *(_node_line(run, node, depth, signs, marks) for node, depth in nodes)]
    for leaf, *above in chains_of_failures(run):
        by_it = f', and so {", ".join(one_line(node.name) for node in above)}' if above else ''
        shown.append(Line(f'failed: {one_line(leaf.name)}{by_it}', Tone.ERROR))
    return shown


def chains_of_failures(run: MirroredTree) -> list[list[MirroredNode]]:
    """Return a chain for each node that failed on its own, not because of its children: the node, and the failed nodes
    above it, nearest first.

    A node that was halted since then counts by its last end.
    """
    nodes = {node.uid: node for node in run.nodes}
    failed = {uid for uid in nodes if run.shown_status(uid) is MirroredStatus.FAILURE}
    reasons = sorted(failed - {nodes[uid].parent for uid in failed})
    chains = []
    for uid in reasons:
        chain = [nodes[uid]]
        while chain[-1].parent in failed and chain[-1].parent < chain[-1].uid:  # there is no ring
            chain.append(nodes[chain[-1].parent])
        chains.append(chain)
    return chains


def acting_lines(run: MirroredTree) -> list[str]:
    """Return a line for each running leaf: its name, its time, and the named nodes around it, nearest first.

    The leaf that has run longest is first, so that its line does not move when others start and end.
    """
    nodes = {node.uid: node for node in run.nodes}
    shown = []
    for uid in sorted(run.running_leaves, key=run.seconds, reverse=True):
        around, below, parent = [], uid, nodes[uid].parent
        while parent in nodes and parent < below:  # there is no ring
            around += [] if _is_structure(nodes[parent]) else [one_line(nodes[parent].name)]
            below, parent = parent, nodes[parent].parent
        inside = f'  in {", ".join(around)}' if around else ''
        shown.append(f'{one_line(nodes[uid].name)}  {run.seconds(uid):.0f} s{inside}')
    return shown


def window(lines: list[str], marked: int, rows: int) -> list[str]:
    """Return at most this many of the lines, including the marked one, and the number of omitted ones."""
    if len(lines) <= rows:
        return lines
    if rows <= 2:
        return lines[marked : marked + max(0, rows)]
    begin = min(max(0, marked - (rows - 2) // 2), len(lines) - rows)
    shown = lines[begin : begin + rows]
    if begin > 0:
        shown[0] = Line(f'  ({begin + 1} above)', Tone.DIM)
    below = len(lines) - begin - rows
    if below > 0:
        shown[-1] = Line(f'  ({below + 1} below)', Tone.DIM)
    return shown


def _title(run: MirroredTree) -> str:
    state, tone = 'finished' if run.finished else 'running', Tone.PLAIN
    if run.paused:
        state, tone = 'paused', Tone.WARNING
    if run.server_gone:
        state, tone = 'SERVER GONE: last state', Tone.ERROR
    left_out = f'  {run.left_out} more nodes left out' if run.left_out else ''
    return Line(f'tree {one_line(run.tree)}  {state}{left_out}', tone)


def _is_of_now(run: MirroredTree, node: MirroredNode) -> bool:
    """Return whether a node runs, or ran within the last :data:`HELD_SECONDS`."""
    if run.status(node.uid) is MirroredStatus.RUNNING:
        return True
    return run.shown_status(node.uid) is not MirroredStatus.IDLE and run.seconds(node.uid) < HELD_SECONDS


def _closed_ways(run: MirroredTree) -> set[int]:
    """Return the nodes that failed by a condition while the tree took another branch: neither a fault nor news."""
    if run.finished:
        return set()
    chains = chains_of_failures(run)
    return {node.uid for leaf, *above in chains if leaf.kind is MirroredNodeKind.CONDITION for node in (leaf, *above)}


def _acts(run: MirroredTree, node: MirroredNode) -> bool:
    """Return whether a node is part of what the tree does now: recent, no condition, and not failed."""
    has_failed = run.status(node.uid) is MirroredStatus.FAILURE
    return _is_of_now(run, node) and node.kind is not MirroredNodeKind.CONDITION and not has_failed


def _is_structure(node: MirroredNode) -> bool:
    """Return whether a node only groups others: a control or decorator without its own name."""
    return node.kind in (MirroredNodeKind.CONTROL, MirroredNodeKind.DECORATOR) and node.name in ('', node.registration)


def _in_order(
    run: MirroredTree,
    is_open: Callable[[MirroredNode], bool],
    is_left_out: Callable[[MirroredNode], bool] = lambda node: False,
) -> list[tuple[MirroredNode, int]]:
    """Return the nodes with their depth, each before its children; not those below nodes that are not open. Children
    of a node that is left out take its place."""
    children: dict[int, list[MirroredNode]] = {}
    for node in run.nodes:
        children.setdefault(node.parent, []).append(node)
    ordered: list[tuple[MirroredNode, int]] = []
    waiting = [(node, 0) for node in reversed(children.get(0, []))]
    while waiting:
        node, depth = waiting.pop()
        is_shown = not is_left_out(node)
        ordered += [(node, depth)] if is_shown else []
        if is_open(node):
            waiting += [(child, depth + is_shown) for child in reversed(children.get(node.uid, []))]
    return ordered


def _node_line(run: MirroredTree, node: MirroredNode, depth: int, signs: Glyphs, marks: Mapping[str, str]) -> str:
    status = run.status(node.uid)
    shown = run.shown_status(node.uid)
    seconds = run.seconds(node.uid)
    has_time = status is MirroredStatus.RUNNING and seconds >= SHOWN_SECONDS and not run.server_gone
    time = f'  {seconds:.0f} s' if has_time else ''
    name = one_line(node.name) + ('?' if node.kind is MirroredNodeKind.CONDITION else '')
    kind = f' ({one_line(node.registration)})' if node.registration not in (node.name, '') else ''
    word = f'  {shown.name}' if shown is MirroredStatus.FAILURE else ''
    tone = (
        _TONES[status]
        if status is not MirroredStatus.IDLE
        else Tone.ERROR
        if shown is MirroredStatus.FAILURE
        else Tone.DIM
    )
    tone = Tone.DIM if run.server_gone else tone
    return Line(f'{"  " * depth}{signs.status[shown]} {name}{kind}{word}{time}{marks.get(node.path, "")}', tone)


def _cut_line(line: str, columns: int) -> str:
    """Cut a line; a deep one first loses the part of its indent that its name needs."""
    text = line.lstrip(' ')
    indent = min(len(line) - len(text), columns // 3)
    return cut(toned(' ' * indent + text, line), columns)

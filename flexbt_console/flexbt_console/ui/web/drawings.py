# SPDX-License-Identifier: BSD-3-Clause
"""Machine and trees as ``behavior_tool draw`` lays them out: SVG by Graphviz, made once for each and kept."""

from __future__ import annotations

import asyncio
import functools
import hashlib
from collections import OrderedDict
from collections.abc import Iterable
from typing import Final, NamedTuple

from flexbt_common.errors import ResourceError
from flexbt_common.pictures.machine_picture import DrawnState, machine_as_dot, machine_graph
from flexbt_common.pictures.markup import LAYOUT_SECONDS, finished, graphviz_command
from flexbt_common.pictures.tree_picture import DrawnNode, NodeShape, trees_as_dot
from flexbt_console.mirror.records import Structure
from flexbt_console.mirror.trees import MirroredNode, MirroredTree
from flexbt_console.present.json_form import fields_of

REMEMBERED: Final = 64
NO_DRAWING: Final = ''
"""The key of what is too large to be drawn."""
MOST_NODES: Final = 400
"""States, or nodes of a tree, that are drawn; of more there is the text alone."""


class Drawing(NamedTuple):
    """A drawing for Graphviz; ``key`` identifies it, or is NO_DRAWING."""

    key: str
    dot: str
    has_legend: bool = False


class Drawings:
    """The latest pictures. They are made one at a time, since each occupies a processor for a moment."""

    def __init__(self) -> None:
        self._made: OrderedDict[str, asyncio.Task[str]] = OrderedDict()
        self._one = asyncio.Lock()

    def wanted(self, drawing: Drawing) -> asyncio.Task[str]:
        """Return the task that makes the picture; its result is SVG. Raises ResourceError when awaited."""
        task = self._made.get(drawing.key)
        if task is None or (task.done() and (task.cancelled() or task.exception())):  # a failure is tried again
            task = self._made[drawing.key] = asyncio.create_task(self._make(drawing))
            while len(self._made) > REMEMBERED:
                self._made.popitem(last=False)[1].cancel()
        return task

    async def _make(self, drawing: Drawing) -> str:
        """Raise ResourceError."""
        async with self._one:
            name, command = graphviz_command()
            pipe = asyncio.subprocess.PIPE
            process = await asyncio.create_subprocess_exec(*command, stdin=pipe, stdout=pipe, stderr=pipe)
            try:
                out, error = await asyncio.wait_for(process.communicate(drawing.dot.encode()), LAYOUT_SECONDS)
            except TimeoutError:
                raise ResourceError(name, f'did not end within {LAYOUT_SECONDS:g} s') from None
            finally:
                if process.returncode is None:
                    process.kill()
            if process.returncode:
                raise ResourceError(name, f'failed: {error.decode(errors="replace").strip()}')
            picture = out.decode()
            return finished(picture, style='') if drawing.has_legend else picture  # the page has the style


def machine_drawing(structure: Structure) -> Drawing:
    """Return the machine of a run: the element of the state at position 3 has the identifier ``s3``, a container's
    ``m3``."""
    if len(structure.states) > MOST_NODES or not structure.states:  # seen before its hash, which takes long, is needed
        return Drawing(NO_DRAWING, '')
    return _machine_drawing(structure)


@functools.lru_cache(maxsize=REMEMBERED)
def _machine_drawing(structure: Structure) -> Drawing:
    states = [DrawnState(**{**fields_of(state), 'kind': state.kind.name.lower()}) for state in structure.states]
    return _drawing(machine_as_dot(machine_graph(states), structure.behavior), has_legend=True)


def tree_drawing(run: MirroredTree) -> Drawing:
    """Return the tree of a run: the element of its node ``uid`` has the identifier ``t0nX``, where X is ``uid`` - 1."""
    if len(run.nodes) > MOST_NODES or not run.nodes:
        return Drawing(NO_DRAWING, '')
    return _tree_drawing(run.tree, run.nodes)


@functools.lru_cache(maxsize=REMEMBERED)
def _tree_drawing(tree: str, nodes: tuple[MirroredNode, ...]) -> Drawing:
    drawn = [
        DrawnNode(
            node.registration,
            '' if node.name == node.registration else node.name,
            node.parent - 1 if 0 < node.parent < node.uid else None,
            NodeShape[node.kind.name],
        )
        for node in nodes
    ]
    return _drawing(trees_as_dot([(tree, drawn)]), has_legend=False)


def _drawing(lines: Iterable[str], *, has_legend: bool) -> Drawing:
    dot = '\n'.join(lines)
    return Drawing(hashlib.sha256(dot.encode()).hexdigest()[:16], dot, has_legend)

# SPDX-License-Identifier: BSD-3-Clause
"""State machines as ``behavior_tool draw`` lays them out: SVG by Graphviz, made once for each and kept."""

from __future__ import annotations

import asyncio
import functools
import hashlib
from collections import OrderedDict
from dataclasses import replace
from typing import Final, NamedTuple

from flexbt_common.errors import ResourceError
from flexbt_common.pictures.machine_picture import DrawnState, machine_as_dot, machine_graph
from flexbt_common.pictures.markup import LAYOUT_SECONDS, finished, graphviz_command
from flexbt_console.mirror.records import Structure
from flexbt_console.present.json_form import fields_of

REMEMBERED: Final = 64
NO_DRAWING: Final = ''
"""The key of what is too large to be drawn."""
MOST_NODES: Final = 400
"""Maximum number of states that are drawn; of more there is the text alone."""


class Drawing(NamedTuple):
    """A drawing for Graphviz; ``key`` identifies it, or is NO_DRAWING."""

    key: str
    dot: str


class Drawings:
    """The latest pictures. They are made one at a time, since each occupies a processor for a moment."""

    def __init__(self) -> None:
        self._made: OrderedDict[str, asyncio.Task[str]] = OrderedDict()
        self._one = asyncio.Lock()

    async def close(self) -> None:
        """End what is being made, and wait for the processes."""
        for task in self._made.values():
            task.cancel()
        await asyncio.gather(*self._made.values(), return_exceptions=True)

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
                    await process.wait()
            if process.returncode:
                raise ResourceError(name, f'failed: {error.decode(errors="replace").strip()}')
            return finished(out.decode(), style='')  # the page has the style


def machine_drawing(structure: Structure, folded: frozenset[str] = frozenset()) -> Drawing:
    """Return the machine of a run: the element of the state at position 3 has the identifier ``s3``, a container's
    ``m3``. The containers of ``folded`` are drawn as states."""
    if len(structure.states) > MOST_NODES or not structure.states:  # seen before its hash, which takes long, is needed
        return Drawing(NO_DRAWING, '')
    return _machine_drawing(structure, folded)


@functools.lru_cache(maxsize=REMEMBERED)
def _machine_drawing(structure: Structure, folded: frozenset[str]) -> Drawing:
    states = [DrawnState(**{**fields_of(state), 'kind': state.kind.name.lower()}) for state in structure.states]
    for place, state in enumerate(states[1:], 1):
        if state.path in folded and state.kind != 'state':
            inside = sum(other.path.startswith(f'{state.path}/') for other in states)
            states[place] = replace(state, kind='state', type=f'▸ {inside} state{"s" * (inside != 1)}, folded')
    dot = '\n'.join(machine_as_dot(machine_graph(states), structure.behavior))
    return Drawing(hashlib.sha256(dot.encode()).hexdigest()[:16], dot)

# SPDX-License-Identifier: BSD-3-Clause
"""What runs on a robot now, for the graphs of the studio: active states, and the statuses of the nodes of trees."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import zlib
from typing import TYPE_CHECKING, Any, Final

from flexbt_console.mirror.records import ExecutiveSnapshot
from flexbt_console.mirror.view import View
from flexbt_console.present.debugging import breakpoint_text, held_text, mark_of
from flexbt_console.present.rendering import stamp_text
from flexbt_console.ui.web.past import LivePast, Past, moment_part
from flexbt_console.ui.web.picture import map_part
from flexbt_console.ui.web.server import open_robot
from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_studio.errors import StudioError

if TYPE_CHECKING:
    from collections.abc import Callable

    from flexbt_console.link.fleet_link import FleetLink

PERIOD: Final = 0.1
"""Least time between two events, s."""


class LiveRobots:
    """The robots that pages watch. ``tell`` sends an event to all pages. Used on the thread of the loop."""

    def __init__(self, robots: FleetLink, tell: Callable[[dict[str, Any]], None]) -> None:
        self._robots = robots
        self._tell = tell
        self._watched: set[str] = set()
        """Robots that were opened, so that they are not forgotten."""
        self._opening = asyncio.Lock()
        self._pasts: dict[str, LivePast] = {}
        self._shown: dict[str, dict[str, Any]] = {}
        self._changed = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._robots.fleet.add_listener(self._wake)
        self._task = asyncio.create_task(self._show())

    async def close(self) -> None:
        """Stop watching."""
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
        for name in self._watched:
            await asyncio.to_thread(self._robots.close, name)

    async def watch(self, name: str = '') -> str:
        """Watch a robot; without a name the own one. Return its name. Raises StudioError if it is not known,
        or cannot be opened now."""
        known = self._robots.fleet.names
        name = name or (self._robots.own if self._robots.own in known else next(iter(known), ''))
        if not name:
            raise StudioError('no robot was found yet')
        if name not in known:
            raise StudioError(f'no robot {short_repr(name)} was found{did_you_mean(name, known)}')
        async with self._opening:
            if name not in self._watched:
                try:
                    mirror = self._robots.robot(name)[0]
                    self._pasts[name] = LivePast(*self._robots.fleet.past(name, mirror), mirror.now)
                    await open_robot(self._robots, name)
                except (KeyError, RuntimeError, TimeoutError) as error:  # forgotten; no thread; the node is busy
                    raise StudioError(
                        f'robot {short_repr(name)} cannot be watched now: {error!r}; try again'
                    ) from error
                self._watched.add(name)
        self._shown.pop(name, None)  # the page that asks has not seen it
        self._changed.set()
        return name

    def past(self, name: str) -> LivePast | None:
        """Return the past of a robot that is watched; None for what has none here, such as a program."""
        return self._pasts.get(name)

    def _wake(self) -> None:
        """Note a change. From any thread."""
        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(self._changed.set)

    async def _show(self) -> None:
        while True:
            await self._changed.wait()
            self._changed.clear()
            for name in self._watched:
                event = live_event(name, self._robots.robot(name)[0].view())
                if event != self._shown.get(name):
                    self._shown[name] = event
                    self._tell(event)
            await asyncio.sleep(PERIOD)


async def past_answer(past: Past | None, arguments: dict[str, Any]) -> dict[str, Any] | None:
    """Return the lanes of a ``robot`` since a ``revision``, or what was at a ``time`` (s): the event of then, what the
    operator's page shows as ``seen``, and the map if the page has another ``map``. None without a past."""
    match arguments:
        case {'revision': int(revision)}:
            return None if past is None else await asyncio.to_thread(past.lanes, revision)
        case {'robot': str(name), 'time': int(time) | float(time)} if past is not None:
            return await asyncio.to_thread(_moment, name, past, time, arguments.get('map'))
    raise StudioError('past: its arguments are a robot, and a revision or a time')


def _moment(name: str, past: Past, time: float, known: Any) -> dict[str, Any]:
    mirror = past.moment(time)
    view = mirror.view()
    map = view.surroundings.map
    key = '' if map is None else f'{map.width} {map.height} {zlib.crc32(map.cells)}'
    found = {**live_event(name, view), 'seen': moment_part(mirror, None), 'map': key}
    if map is not None and known is not None and key != known:
        head, cells = map_part(map)
        found['cells'] = {**head, 'cells': base64.b64encode(cells).decode()}
    return found


def live_event(name: str, view: View) -> dict[str, Any]:
    """Return what runs on a robot as an event for pages. Statuses are by the paths of nodes in a run; ``nodes`` is the
    number of all nodes of the tree."""
    snapshot = view.snapshot
    return {
        'event': 'live',
        'robot': name,
        'link': view.link.name.lower(),
        'behavior': '' if snapshot is None else snapshot.behavior,
        'state': '' if snapshot is None else snapshot.state.name.lower(),
        'active': [] if snapshot is None else [state.path for state in snapshot.active_states],
        'trees': [
            {
                'run': tree.run_id,
                'tree': tree.tree,
                'running': tree.is_running,
                'nodes': len({node.path for node in tree.nodes}) + tree.left_out,
                'statuses': {
                    node.path: tree.shown_status(node.uid).name for node in tree.nodes if tree.shown_status(node.uid)
                },
            }
            for tree in view.trees
        ],
        **({} if snapshot is None else debugged(snapshot)),
    }


def debugged(snapshot: ExecutiveSnapshot) -> dict[str, Any]:
    """Return what the debugger has set and holds: in trees, by the paths of nodes in a run, and in the machine."""
    return {
        'holds': [
            {
                'run': hold.run_id,
                'tree': hold.tree,
                'path': hold.path,
                'since': hold.since,
                'text': held_text(hold, f'since {stamp_text(hold.since)}'),
                'acts': hold.not_paused,
            }
            for hold in snapshot.tree_holds
        ],
        'points': [
            {
                'tree': point.tree,
                'path': point.path,
                'kind': point.kind.name.lower(),
                'mark': mark_of(point),
                'condition': point.condition,
                'problem': point.problem,
                'text': breakpoint_text(point),
            }
            for point in snapshot.tree_breakpoints
        ],
        'breakpoints': snapshot.breakpoints,
        'waiting': [decision.path for decision in snapshot.decisions],
        'runners': {state.tree_run_id: state.path for state in snapshot.active_states if state.tree_run_id},
    }

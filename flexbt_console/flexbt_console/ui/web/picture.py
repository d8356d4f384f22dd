# SPDX-License-Identifier: BSD-3-Clause
"""The contents of the page as plain data: the parts of a picture, of which only those that have changed are sent."""

from __future__ import annotations

import asyncio
import math
import struct
import time
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from typing import Any, Final, NamedTuple, TypeVar

import numpy

from flexbt_common.pictures.tree_picture import DrawnNode, NodeShape
from flexbt_console.commands.registry import COMMANDS
from flexbt_console.commands.spec import Typed
from flexbt_console.mirror.fleet import Fleet, RobotOverview
from flexbt_console.mirror.freshness import LinkState
from flexbt_console.mirror.records import OCCUPIED, Decision, GridMap, LogLine, StateKind
from flexbt_console.mirror.trees import MirroredNode, MirroredTree
from flexbt_console.mirror.view import View
from flexbt_console.present.json_form import encode_json, fields_of
from flexbt_console.present.queue import entry_details, state_text, what_text
from flexbt_console.present.rendering import (
    BOOLEANS,
    age_text,
    alarm_line,
    asked_text,
    authority_asked_line,
    authority_text,
    autonomy_text,
    fault_texts,
    left_out_text,
    link_word,
    log_lines,
    machine_text_lines,
    not_paused_lines,
    parameter_text,
    peer_line,
    pose_text,
    progress_text,
    reason_lines,
    robot_line,
    subject_lines,
    unreachable_text,
    what_runs,
    where_lines,
)
from flexbt_console.present.style import tone_of
from flexbt_console.ui.keys import KEYS
from flexbt_console.ui.station import Station
from flexbt_core.values.text import one_line

from .drawings import machine_drawing

T = TypeVar('T')

PERIOD: Final = 0.1
"""Seconds between two pictures, at least."""

RESTS: Final = 3.0
"""Times as long as a picture took to make, until the next one is begun: others need the processor, too."""

LOG_LINES: Final = 200
LINE_CHARACTERS: Final = 4_000
"""Maximum characters of a line of the log."""

MOST_LISTED: Final = 500
"""Maximum number of elements of a list, such as the nodes of a tree, in a page. The page shows how many are omitted."""

NODE_CHARACTERS: Final = 100
"""Maximum characters of the name of a node of a tree."""

MOST_CELLS: Final = 1_000_000
"""Maximum number of cells of a map in a page. The cells of a larger map are combined."""

_NOTHING: Final = View(LinkState.LOST, None)

COMMAND_PART: Final = [
    {
        'name': spec.name,
        'usage': spec.prompt_usage,
        'summary': spec.summary,
        'fields': [
            {
                'name': option.name,
                'help': f'{option.value}: {option.help}',
                'choices': [*option.values(Typed((), _NOTHING))] if option.values is not None else [],
            }
            for option in spec.prompt_options
            if option.value is not None
        ],
    }
    for spec in COMMANDS
    if spec.in_prompt
]


def parts_of(view: View, operator: str | None) -> dict[str, Any]:
    """Return the parts by name, for this operator. All texts are escaped for a line, and none of them is
    HTML."""
    return {
        'link': {'state': view.link.value, 'word': link_word(view), 'problem': one_line(view.problem)},
        'status': _status(view, operator),
        'actions': {
            key.action: {
                'help': key.help,
                'blocked': key.blocked(view),
                'lines': key.lines(view, operator),
                'asks': key.asks,
            }
            for key in KEYS
            if key.lines is not None
        },
        'active': _active(view),
        'decisions': [_decision(decision, view) for decision in view.decisions[:MOST_LISTED]],
        'machine': _machine(view),
        'trees': [_tree(run) for run in view.drawn_trees],
        'tree_states': {run.run_id: _tree_state(run) for run in view.drawn_trees},
        'left_out': left_out_lines(view),
        'pose': _pose(view),
        'where': '  '.join(where_lines(view.snapshot)) if view.snapshot else '',
        'plan': [[round(x, 3), round(y, 3)] for x, y in view.drawn_for(None).plan],
        'scan': [[round(x, 2), round(y, 2)] for x, y in view.surroundings.scan],
        'places': {name: [pose.x, pose.y] for name, pose in [*view.places.items()][:MOST_LISTED]},
        'behaviors': _behaviors(view),
        'queue': _queue(view),
    }


def _status(view: View, operator: str | None) -> dict[str, Any] | None:
    snapshot = view.snapshot
    if snapshot is None:
        return None
    return {
        'state': snapshot.state.name.lower(),
        'running': view.running,
        'run': snapshot.run_id,
        'runs': what_runs(view),
        'alarm': alarm_line(view),
        'message': one_line(snapshot.message),
        'autonomy': snapshot.autonomy,
        'autonomy_text': autonomy_text(snapshot.autonomy),
        'authority': authority_text(snapshot) if snapshot.authority or snapshot.authority_requests else '',
        'asked': authority_asked_line(snapshot, operator),
        'missed': [peer_line(peer) for peer in snapshot.missed_peers[:MOST_LISTED]],
        'locked': snapshot.locked[:MOST_LISTED],
        'breakpoints': snapshot.breakpoints[:MOST_LISTED],
    }


def _active(view: View) -> dict[str, Any]:
    snapshot = view.snapshot
    if snapshot is None:
        return {'paths': [], 'states': []}
    return {
        'paths': view.active_levels[:MOST_LISTED],
        'states': [
            {
                'path': state.path,
                'activity': [one_line(line) for line in (*state.activity, *not_paused_lines(state))],
                'progress': progress_text(state.progress, view.places) if state.progress is not None else '',
                'paused': state.paused,
                'since': state.entered,
                'outcomes': view.outcomes(state.path),
            }
            for state in snapshot.active_states[:MOST_LISTED]
        ],
    }


def _decision(decision: Decision, view: View) -> dict[str, Any]:
    assert view.snapshot is not None
    state = view.state(decision.path)
    leads = {one.outcome: one.target for one in state.transitions} if state is not None else {}
    around = view.drawn_for(decision)
    drawn = {'plan': [[round(x, 3), round(y, 3)] for x, y in around.plan], 'goal': around.goal}
    return {
        'id': decision.id,
        'kind': decision.kind.name.lower(),
        'path': decision.path,
        'line': asked_text(decision, view.snapshot),
        'reasons': [*subject_lines(decision, view), *reason_lines(decision, view)],
        'lacks': one_line(view.lacks(decision)),
        'drawn': drawn if around is not view.surroundings else None,
        'wanted': decision.outcome,
        'choices': [
            {'value': value, 'text': one_line(value), 'leads': one_line(leads.get(value, ''))}
            for value in decision.choices
        ],
        'wants_pose': decision.wants_pose,
        'wants_value': not decision.choices,
        'since': decision.since,
    }


def _machine(view: View) -> dict[str, Any] | None:
    if view.structure is None:
        return None
    states = view.structure.states[:MOST_LISTED]
    return {
        'behavior': one_line(view.structure.behavior),
        'drawing': machine_drawing(view.structure).key,
        'paths': [state.path for state in states],
        'containers': [place for place, state in enumerate(states) if state.kind is not StateKind.STATE],
        'lines': [f'{one_line(state.path)} ({one_line(state.type)})' for state in states],
        'outcomes': [state.outcomes for state in states],
    }


def _tree(run: MirroredTree) -> dict[str, Any]:
    return {
        'id': run.run_id,
        'tree': one_line(run.tree),
        'nodes': [_drawn_node(node) for node in run.nodes[:MOST_LISTED]],
    }


def _drawn_node(node: MirroredNode) -> dict[str, Any]:
    name, shape = one_line(node.name, NODE_CHARACTERS), NodeShape[node.kind.name]
    drawn = DrawnNode(node.registration, '' if node.name == node.registration else name, None, shape)
    parent = node.parent - 1 if 0 < node.parent < node.uid else None
    return {'lines': drawn.label(), 'kind': shape.value, 'parent': parent}


def _tree_state(run: MirroredTree) -> dict[str, Any]:
    nodes = run.nodes[:MOST_LISTED]
    return {
        'paused': run.paused,
        'server_gone': run.server_gone,
        'statuses': [run.status(node.uid).name.lower() for node in nodes],
        'last': [run.last_end(node.uid).name.lower() for node in nodes],
        'leaves': _node_names([run.nodes[uid - 1] for uid in run.running_leaves]),
    }


def _node_names(nodes: Sequence[MirroredNode]) -> list[str]:
    return [one_line(node.name or node.registration, NODE_CHARACTERS) for node in nodes[:MOST_LISTED]]


def left_out_lines(view: View) -> list[str]:
    """Report the data that the parts leave out because of their size."""
    snapshot, structure = view.snapshot, view.structure
    counts = {
        **{
            f'nodes of tree {one_line(run.tree, NODE_CHARACTERS)}': len(run.nodes) + run.left_out
            for run in view.drawn_trees
        },
        'states': len(structure.states) if structure else 0,
        'active states': len(snapshot.active_states) if snapshot else 0,
        'decisions': len(view.decisions),
        'behaviors': len(view.behaviors or ()),
        'places': len(view.places),
    }
    return [
        f'{count - MOST_LISTED} of {count} {what} not shown' for what, count in counts.items() if count > MOST_LISTED
    ]


def _pose(view: View) -> dict[str, Any] | None:
    pose = view.robot_pose
    return {**fields_of(pose), 'text': pose_text(pose)} if pose is not None else None


def _behaviors(view: View) -> list[dict[str, Any]]:
    return [
        {
            **fields_of(behavior, 'author', 'package'),
            'description': one_line(behavior.description),
            'error': one_line(behavior.error),
            'machine': '\n'.join(machine_text_lines(behavior)),
            'lacks_machine': behavior.lacks_machine,
            'parameters': [
                {
                    **fields_of(parameter, 'description', 'unit'),
                    'choices': parameter.choices or BOOLEANS * (parameter.type == 'bool'),
                    'help': parameter_text(parameter),
                }
                for parameter in behavior.parameters
            ],
            'inputs': [
                {
                    **fields_of(known, 'description'),
                    'help': one_line(f'{known.type or "TYPE:VALUE"}  {known.description}'),
                }
                for known in behavior.inputs
            ],
        }
        for behavior in (view.behaviors or ())[:MOST_LISTED]
    ]


def _queue(view: View) -> dict[str, Any] | None:
    queue = view.queue
    if queue is None:
        return None
    shown = []
    for before, entry, after in zip((None, *queue.entries), queue.entries, (*queue.entries[1:], None), strict=False):
        peers = [other is not None and other.options.priority == entry.options.priority for other in (before, after)]
        shown.append(
            {
                'number': entry.number,
                'running': entry.running,
                'text': what_text(entry, view.places),
                'state': state_text(entry),
                'details': entry_details(entry),
                'up': f'queue move {entry.number} {before.number}' if before is not None and peers[0] else '',
                'down': f'queue move {after.number} {entry.number}' if after is not None and peers[1] else '',
            }
        )
    return {'hold': queue.hold, 'held': one_line(queue.held), 'entries': shown}


def times_part(view: View) -> dict[str, Any]:
    """Return what time alone changes, for the page to count on: the age of the picture, and the executive's clock."""
    snapshot = view.snapshot
    return {
        'age': view.age,
        'age_text': '' if view.age is None else age_text(view.age),
        'now': snapshot.stamp if snapshot else 0.0,
    }


def robot_lines(robots: Iterable[RobotOverview]) -> list[dict[str, Any]]:
    """Return the data of a line for each robot. Only the lines of robots without a live link change with time alone."""
    return [
        {
            'name': robot.name,
            'link': robot.view.link.value,
            'urgency': robot.urgency.name.lower(),
            'needs_operator': robot.needs_operator,
            'tone': tone_of(robot_line(robot)).name.lower(),
            'text': _told(robot),
        }
        for robot in robots
    ]


def other_robots(name: str, view: View, robots: Iterable[RobotOverview]) -> list[dict[str, Any]]:
    """Return the other robots' poses on the map of this one, unless their map is known to be another one."""
    shown = []
    for robot in sorted(robots, key=lambda one: one.name):
        theirs, pose = robot.view.surroundings.map, _pose(robot.view)
        is_elsewhere = None not in (theirs, view.surroundings.map) and theirs != view.surroundings.map
        if robot.name != name and robot.view.link is not LinkState.LOST and pose is not None and not is_elsewhere:
            shown.append({'name': one_line(robot.name), 'live': robot.view.live, **pose})
    return shown


def _told(robot: RobotOverview) -> str:
    view = robot.view
    if robot.is_unreachable:
        return unreachable_text(view)
    asked = asked_text(view.decision, view.snapshot) if view.decision is not None and view.snapshot else ''
    return '  '.join(dict.fromkeys([alarm_line(view) or asked or what_runs(view), *fault_texts(view)]))


def log_part(line: LogLine) -> dict[str, Any]:
    """Return a line of the log."""
    text = log_lines(line, with_time=True)
    joined = '\n'.join(text)
    if len(joined) > LINE_CHARACTERS:
        joined = f'{joined[:LINE_CHARACTERS]}… ({len(joined) - LINE_CHARACTERS} more characters)'
    return {'text': joined, 'tone': tone_of(text[0]).name.lower(), 'stamp': line.stamp}


class Picture(NamedTuple):
    """A robot as its pages show it, encoded; of what has not changed the texts are the same objects as before.

    ``log`` has its lines by executive and number, in their order; ``map`` is a separate message.
    """

    view: View
    robots: Sequence[RobotOverview]
    parts: Mapping[str, str]
    times: str
    log: Mapping[tuple[str, int], str]
    map: bytes


class Pictures:
    """The pictures of one robot for all its pages: each is made once, on a thread other than that of the loop.

    A request of a page, above all a STOP, so never waits until something is encoded.
    """

    def __init__(self, fleet: Fleet, robot: str, station: Station, encoder: Executor) -> None:
        self._fleet = fleet
        self._robot = robot
        self._station = station
        self._encoder = encoder
        self._next: asyncio.Task[Picture] | None = None
        self._begun: set[asyncio.Task[Picture]] = set()
        self._begin_at = 0.0
        self._made: dict[str, tuple[Any, str]] = {}
        self._log: dict[tuple[str, int], str] = {}
        self._map: tuple[GridMap | None, bytes] = None, b''

    async def newest(self) -> Picture:
        """Return a picture that was begun after this was called, and not sooner than PERIOD after the one before."""
        if self._next is None:
            self._next = asyncio.create_task(self._make_next())
            self._begun.add(self._next)
            self._next.add_done_callback(self._begun.discard)
        return await asyncio.shield(self._next)

    def close(self) -> None:
        """Stop: no page is left."""
        for task in self._begun:
            task.cancel()

    async def _make_next(self) -> Picture:
        await asyncio.sleep(max(0.0, self._begin_at - time.monotonic()))
        self._next = None  # later callers know of changes that may be missing in this one
        began = time.monotonic()
        try:
            return await asyncio.get_running_loop().run_in_executor(self._encoder, self._make)
        finally:
            took = time.monotonic() - began
            self._begin_at = began + took + max(PERIOD - took, RESTS * took)

    def _make(self) -> Picture:
        station = self._station
        view, robots = station.mirror.view(), self._fleet.overview()
        parts = parts_of(view, station.builder.operator)
        if station.obstacles is not None:
            parts['simulator'] = station.obstacles.is_possible()
            parts['obstacles'] = station.obstacles.dropped
        parts['robots'] = robot_lines(robots)
        parts['robots_left_out'] = left_out_text(self._fleet.left_out, '--robot')
        parts['others'] = other_robots(self._robot, view, robots)
        for name, part in parts.items():
            if name not in self._made or self._made[name][0] != part:
                self._made[name] = part, encode_json(part)
        self._log = {
            key: self._log[key] if key in self._log else encode_json(log_part(line))
            for line in station.mirror.log(LOG_LINES)
            for key in [(line.executive_id, line.sequence)]
        }
        map = view.surroundings.map
        if map is not self._map[0]:
            self._map = map, b'' if map is None else map_message(*map_part(map))
        return Picture(
            view,
            robots,
            {name: text for name, (_, text) in self._made.items()},
            encode_json(times_part(view)),
            self._log,
            self._map[1],
        )


def map_message(head: dict[str, Any], cells: bytes) -> bytes:
    """Return a map or costmap as a message for the page: the length of its frame, the frame, and the cells."""
    frame = encode_json(head).encode()
    return struct.pack('>I', len(frame)) + frame + cells


def map_part(map: GridMap) -> tuple[dict[str, Any], bytes]:
    """Return a map for the page: its frame, and a byte for each cell from the lower left corner on, of at most
    MOST_CELLS.

    A cell is 0 where it is free, 1 where it is occupied, 2 where that is not known; where several become one, what is
    occupied counts most.
    """
    bits = bytes(2 if OCCUPIED <= value <= 100 else 0 if value < OCCUPIED else 1 for value in range(256))
    cells = numpy.frombuffer(map.cells.translate(bits), numpy.uint8).reshape(map.height, map.width)
    factor = 1
    while math.prod(-(-side // factor) for side in cells.shape) > MOST_CELLS:
        factor *= 2
    for axis, side in enumerate(cells.shape):
        cells = numpy.bitwise_or.reduceat(cells, range(0, side, factor), axis)
    height, width = cells.shape
    head = replace(map, width=width, height=height, resolution=map.resolution * factor)
    return fields_of(head, 'cells'), cells.tobytes().translate(bytes([0, 2, 1, 1]) + bytes(252))

# SPDX-License-Identifier: BSD-3-Clause
"""What the page shows, as plain data: the parts of a picture, of which only those that have changed are sent."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

from flexbt_console.commands import COMMANDS, Typed
from flexbt_console.mirror import OCCUPIED, Decision, GridMap, LinkState, LogLine, RobotOverview, TreeRun, View
from flexbt_console.present import (
    BOOLEANS,
    age_text,
    alarm_line,
    asked_text,
    authority_asked_line,
    authority_text,
    autonomy_text,
    link_word,
    log_lines,
    not_paused_lines,
    parameter_text,
    peer_line,
    pose_text,
    progress_text,
    reason_lines,
    robot_line,
    subject_lines,
    tone_of,
    what_runs,
    where_lines,
)
from flexbt_console.ui.interaction import KEYS
from flexbt_core.values import one_line

from .drawings import machine_drawing, tree_drawing

MOST_CELLS: Final = 1_000_000
"""Cells of a map that a page gets; of a larger one several cells become one."""

_NOTHING: Final = View(LinkState.LOST, None)

COMMAND_PART: Final = [
    {
        'name': spec.name,
        'usage': spec.prompt_usage,
        'summary': spec.summary,
        'fields': [
            {
                'name': option.name,
                'help': option.help if option.value is None else f'{option.value}: {option.help}',
                'choices': [*option.values(Typed((), _NOTHING))] if option.values is not None else [],
            }
            for option in spec.prompt_options
        ],
    }
    for spec in COMMANDS
    if spec.in_prompt
]


def parts_of(view: View, operator: str | None) -> dict[str, Any]:
    """The parts by their names, for this operator. All texts are escaped for a line, and nothing of them is HTML."""
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
        'decisions': [_decision(decision, view) for decision in view.decisions],
        'machine': _machine(view),
        'trees': [_tree(run) for run in view.running_trees],
        'pose': _pose(view),
        'where': _where(view),
        'plan': [[round(x, 3), round(y, 3)] for x, y in view.surroundings.plan],
        'scan': [[round(x, 2), round(y, 2)] for x, y in view.surroundings.scan],
        'places': {name: [pose.x, pose.y] for name, pose in view.places.items()},
        'behaviors': _behaviors(view),
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
        'missed': [peer_line(peer) for peer in snapshot.missed_peers],
        'locked': snapshot.locked,
        'breakpoints': snapshot.breakpoints,
    }


def _active(view: View) -> dict[str, Any]:
    snapshot = view.snapshot
    if snapshot is None:
        return {'paths': [], 'states': []}
    return {
        'paths': view.active_levels,
        'states': [
            {
                'path': state.path,
                'activity': [one_line(line) for line in (*state.activity, *not_paused_lines(state))],
                'progress': progress_text(state.progress, view.places) if state.progress is not None else '',
                'paused': state.paused,
                'since': state.entered,
                'outcomes': view.outcomes(state.path),
            }
            for state in snapshot.active_states
        ],
    }


def _decision(decision: Decision, view: View) -> dict[str, Any]:
    assert view.snapshot is not None
    state = view.state(decision.path)
    leads = dict(zip(state.outcomes, state.targets, strict=False)) if state is not None else {}
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
    return {
        'drawing': machine_drawing(view.structure).key,
        'paths': [state.path for state in view.structure.states],
        'lines': [f'{one_line(state.path)} ({one_line(state.type)})' for state in view.structure.states],
        'outcomes': [state.outcomes for state in view.structure.states],
    }


def _tree(run: TreeRun) -> dict[str, Any]:
    leaves = [run.nodes[uid - 1] for uid in run.running_leaves]
    return {
        'id': run.run_id,
        'tree': one_line(run.tree),
        'drawing': tree_drawing(run).key,
        'paused': run.paused,
        'statuses': [run.status(node.uid).name.lower() for node in run.nodes],
        'last': [run.last_end(node.uid).name.lower() for node in run.nodes],
        'leaves': [one_line(node.name or node.registration) for node in leaves],
        'nodes': [one_line(node.name or node.registration) for node in run.nodes],
    }


def _pose(view: View) -> dict[str, Any] | None:
    pose = view.snapshot.robot_pose if view.snapshot else None
    if pose is None:
        return None
    return {'x': pose.x, 'y': pose.y, 'yaw': pose.yaw, 'text': pose_text(pose)}


def _where(view: View) -> str:
    return '  '.join(where_lines(view.snapshot)) if view.snapshot else ''


def _behaviors(view: View) -> list[dict[str, Any]]:
    return [
        {
            'name': behavior.name,
            'description': one_line(behavior.description),
            'error': one_line(behavior.error),
            'parameters': [
                {
                    'name': parameter.name,
                    'label': parameter.label,
                    'default': parameter.default,
                    'choices': parameter.choices or BOOLEANS * (parameter.type == 'bool'),
                    'help': parameter_text(parameter),
                    'type': parameter.type,
                    'minimum': parameter.minimum,
                    'maximum': parameter.maximum,
                }
                for parameter in behavior.parameters
            ],
            'inputs': [
                {
                    'key': known.key,
                    'type': known.type,
                    'help': one_line(f'{known.type or "TYPE:VALUE"}  {known.description}'),
                    'needed': known.needed,
                }
                for known in behavior.inputs
            ],
        }
        for behavior in view.behaviors or ()
    ]


def times_part(view: View) -> dict[str, Any]:
    """What time alone changes, for the page to count on: the age of the picture, and the executive's clock."""
    snapshot = view.snapshot
    return {
        'age': view.age,
        'age_text': '' if view.age is None else age_text(view.age),
        'now': snapshot.stamp if snapshot else 0.0,
    }


def robot_lines(robots: Iterable[RobotOverview]) -> list[dict[str, Any]]:
    """A line for each robot, for who watches several. It has nothing that time alone changes."""
    return [
        {
            'name': robot.name,
            'link': robot.view.link.value,
            'urgency': robot.urgency.name.lower(),
            'needs_operator': robot.needs_operator,
            'tone': tone_of(robot_line(robot)).name.lower(),
            'text': '  '.join([_needs(robot.view), *_missed(robot.view)]),
        }
        for robot in robots
    ]


def other_robots(name: str, view: View, robots: Iterable[RobotOverview]) -> list[dict[str, Any]]:
    """Where the other robots are on the map of this one, unless their map is known to be another one."""
    shown = []
    for robot in sorted(robots, key=lambda one: one.name):
        theirs, pose = robot.view.surroundings.map, _pose(robot.view)
        is_elsewhere = None not in (theirs, view.surroundings.map) and theirs != view.surroundings.map
        if robot.name != name and robot.view.link is not LinkState.LOST and pose is not None and not is_elsewhere:
            shown.append({'name': one_line(robot.name), 'live': robot.view.live, **pose})
    return shown


def _needs(view: View) -> str:
    return alarm_line(view) or _asked(view) or what_runs(view)


def _missed(view: View) -> list[str]:
    return [peer_line(peer) for peer in view.snapshot.missed_peers] if view.live and view.snapshot else []


def _asked(view: View) -> str:
    return asked_text(view.decision, view.snapshot) if view.decision is not None and view.snapshot else ''


def log_part(line: LogLine) -> dict[str, Any]:
    """A line of the log."""
    text = log_lines(line, with_time=True)
    return {'text': '\n'.join(text), 'tone': tone_of(text[0]).name.lower(), 'stamp': line.stamp}


def map_part(map: GridMap) -> tuple[dict[str, Any], bytes]:
    """A map for the page: its frame, and a byte for each cell from the lower left corner on, of at most MOST_CELLS.

    A cell is 0 where it is free, 1 where it is occupied, 2 where that is not known; where several become one, what is
    occupied counts most.
    """
    bits = bytes(2 if OCCUPIED <= value <= 100 else 0 if value < OCCUPIED else 1 for value in range(256))
    cells, width, height, factor = map.cells.translate(bits), map.width, map.height, 1
    while width * height > MOST_CELLS:
        rows = [cells[row * width : (row + 1) * width] for row in range(height)]
        pairs = [_united(a, b) for a, b in zip(rows[::2], [*rows[1::2], rows[-1]], strict=False)]
        cells = b''.join(_united(row[::2], row[1::2].ljust(-(-width // 2), b'\0')) for row in pairs)
        width, height, factor = -(-width // 2), len(pairs), factor * 2
    head = {'width': width, 'height': height, 'resolution': map.resolution * factor, 'x': map.x, 'y': map.y}
    return head, cells.translate(bytes([0, 2, 1, 1]) + bytes(252))


def _united(one: bytes, other: bytes) -> bytes:
    """The bits of both, byte by byte: as numbers, since that is quick."""
    return (int.from_bytes(one, 'big') | int.from_bytes(other, 'big')).to_bytes(len(one), 'big')

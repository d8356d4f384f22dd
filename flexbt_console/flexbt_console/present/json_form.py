# SPDX-License-Identifier: BSD-3-Clause
"""The console's data as JSON, for programs. The keys are the fields of the records, and so of the messages."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from enum import Enum
from typing import Any

from flexbt_console.errors import ExitCode
from flexbt_console.mirror.command_tracker import CommandState, TrackedCommand
from flexbt_console.mirror.fleet import RobotOverview
from flexbt_console.mirror.records import Structure
from flexbt_console.mirror.trees import MirroredNode, MirroredTree
from flexbt_console.mirror.view import View


def encode_json(value: Any) -> str:
    """Return one line of JSON in ASCII, so that no text can control a terminal."""
    return json.dumps(_plain(value), allow_nan=False)


def fields_of(record: Any, *left_out: str) -> dict[str, Any]:
    """Return the fields of a record by name, without the excluded ones."""
    names = (field.name for field in dataclasses.fields(record))
    return {name: getattr(record, name) for name in names if name not in left_out}


def status_json(view: View) -> dict[str, Any]:
    """Return the picture and how old it is. ``link`` is live, stale or lost; everything else is only as good as
    that."""
    known = fields_of(view.snapshot, 'results') if view.snapshot else {}
    link = {'link': view.link.value, 'age': view.age, 'problem': view.problem}
    return {**link, 'unwanted_motion': view.unwanted_motion, 'guard': view.guard, **known}


def robots_json(robots: Sequence[RobotOverview]) -> list[dict[str, Any]]:
    """Return the robots, the most urgent first, each with its status."""
    return [
        {'robot': one.name, 'urgency': one.urgency, 'waiting': one.seconds, **status_json(one.view)} for one in robots
    ]


def structure_json(known: Structure) -> dict[str, Any]:
    """Return the state machine of a run; transitions as objects."""
    states = [
        {**fields_of(state, 'outcomes', 'targets', 'autonomy'), 'transitions': state.transitions}
        for state in known.states
    ]
    return {**fields_of(known), 'states': states}


def tree_json(run: MirroredTree, failures: Sequence[Sequence[MirroredNode]]) -> dict[str, Any]:
    """Return a run of a tree: of each node its status, how it had ended before (``last``), and for how long, s.
    ``failures`` are the identifiers of nodes that have failed, each with those that have failed by it. With
    ``server_gone`` nothing runs: the statuses are the last that were heard."""
    return {
        'run_id': run.run_id,
        'tree': run.tree,
        'nodes_left_out': run.left_out,
        'running': run.is_running,
        'server_gone': run.server_gone,
        'paused': run.paused,
        'nodes': [
            {
                **fields_of(node),
                'status': run.status(node.uid),
                'last': run.last_end(node.uid),
                'seconds': run.seconds(node.uid),
            }
            for node in run.nodes
        ],
        'acting': run.running_leaves,
        'failures': [[node.uid for node in chain] for chain in failures],
    }


def map_json(view: View) -> dict[str, Any]:
    """Return the surroundings of the robot, m, without the cells of the map."""
    around = view.drawn
    return {
        'map': fields_of(around.map, 'cells') if around.map is not None else None,
        'robot': view.robot_pose,
        'goal': around.goal,
        'lacks': view.lacks(view.decision) if view.decision is not None else '',
        'plan': around.plan,
        'scan': around.scan,
        'places': view.places,
    }


def result_json(name: str, tracked: TrackedCommand, exit_code: ExitCode, **more: Any) -> dict[str, Any]:
    """Return the result of a command. ``duration`` is in seconds."""
    return {
        'command': name,
        'id': tracked.command.id,
        'result': tracked.state.value,
        'reason': tracked.reason,
        'confirmed_by': tracked.confirmed_by.value if tracked.confirmed_by is not None else '',
        'duration': tracked.duration if tracked.state is not CommandState.PENDING else None,
        **more,
        'exit_code': int(exit_code),
    }


def failure_json(name: str, exit_code: ExitCode, reason: str) -> dict[str, Any]:
    """Return a command that was not sent or not answered."""
    return {'command': name, 'result': exit_code.name.lower(), 'reason': reason, 'exit_code': int(exit_code)}


def _plain(value: Any) -> Any:
    if isinstance(value, Enum):
        return value.name.lower()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {name: _plain(item) for name, item in fields_of(value).items()}
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value

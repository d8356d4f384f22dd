# SPDX-License-Identifier: BSD-3-Clause
"""What the console knows as JSON, for programs. The keys are the fields of the records, and so of the messages."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from enum import Enum
from typing import Any

from flexbt_console.errors import ExitCode
from flexbt_console.mirror import CommandState, RobotOverview, Structure, TrackedCommand, View


def encode_json(value: Any) -> str:
    """One line of JSON in ASCII: nothing in it can act on a terminal."""
    return json.dumps(_plain(value), allow_nan=False)


def status_json(view: View) -> dict[str, Any]:
    """The picture and how old it is. ``link`` is live, stale or lost; everything else is only as good as that."""
    snapshot = view.snapshot
    shown = (field.name for field in dataclasses.fields(snapshot) if field.name != 'results') if snapshot else ()
    known = {name: getattr(snapshot, name) for name in shown}
    link = {'link': view.link.value, 'age': view.age, 'problem': view.problem}
    return {**link, 'unwanted_motion': view.unwanted_motion, **known}


def robots_json(robots: Sequence[RobotOverview]) -> list[dict[str, Any]]:
    """The robots, the most urgent first, each with its status."""
    return [
        {'robot': one.name, 'urgency': one.urgency, 'waiting': one.seconds, **status_json(one.view)} for one in robots
    ]


def structure_json(known: Structure) -> dict[str, Any]:
    """The state machine of a run; transitions as objects."""
    return {
        'run_id': known.run_id,
        'behavior': known.behavior,
        'states': [
            {
                'path': state.path,
                'kind': state.kind,
                'type': state.type,
                'children': state.children,
                'transitions': [
                    {'outcome': outcome, 'target': target, 'autonomy': autonomy}
                    for outcome, target, autonomy in zip(state.outcomes, state.targets, state.autonomy, strict=False)
                ],
            }
            for state in known.states
        ],
    }


def result_json(name: str, tracked: TrackedCommand, exit_code: ExitCode, **more: Any) -> dict[str, Any]:
    """What became of a command. ``duration`` is in seconds."""
    return {
        'command': name,
        'id': tracked.command.id,
        'result': tracked.state.value,
        'reason': tracked.reason,
        'duration': tracked.duration if tracked.state is not CommandState.PENDING else None,
        **more,
        'exit_code': int(exit_code),
    }


def failure_json(name: str, exit_code: ExitCode, reason: str) -> dict[str, Any]:
    """A command that was not sent or not answered."""
    return {'command': name, 'result': exit_code.name.lower(), 'reason': reason, 'exit_code': int(exit_code)}


def _plain(value: Any) -> Any:
    if isinstance(value, Enum):
        return value.name.lower()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: _plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value

# SPDX-License-Identifier: BSD-3-Clause
"""Where a run is, as plain data, so that it can be written down and another run go on there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any

from flexbt_core.state_machine.model import StateMachineError
from flexbt_core.values import shown


@dataclass(frozen=True)
class Position:
    """A position of a run. Paths are those of states and machines; the root is always active and not listed.

    ``active``: what is active, outermost first. Each machine that is active, and neither in ``wanted`` nor in
    ``leaving``, has one active or coming child; a concurrency container has any of its children.
    ``coming``: what is to be entered at its beginning.
    ``wanted``: outcome that something active waits to be left by, since it is done: a machine has nothing active in it
    then, and a state is not entered again.
    ``approved``: which of those the operator has approved of.
    ``leaving``: outcome by which something was left that had not halted yet; '' for what is repeated.
    ``ended``: outcome of each child of an active concurrency container that has ended.
    ``userdata``: keys and values of the root and of each machine in ``active``: the values themselves, so that they
    have to be written down at once.
    ``levels``: autonomy of the root, and of each sub-tree that has another level than what is around it.
    ``decisions``: what waits for the operator, for people: id, kind, path, outcome, prompt. ``decision_count`` keeps
    later ids from being those of before.
    """

    active: tuple[str, ...]
    coming: tuple[str, ...]
    wanted: Mapping[str, str]
    approved: tuple[str, ...]
    leaving: Mapping[str, str]
    ended: Mapping[str, str]
    userdata: Mapping[str, Mapping[str, Any]]
    levels: Mapping[str, int]
    locked: tuple[str, ...]
    breakpoints: tuple[str, ...]
    is_paused: bool
    decisions: tuple[Mapping[str, str], ...]
    decision_count: int

    def to_plain(self) -> dict[str, Any]:
        """As dicts and lists; fit for JSON when the userdata is."""
        plain = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: _plain(value) for name, value in plain.items()}

    @classmethod
    def from_plain(cls, plain: Mapping[str, Any]) -> Position:
        """The position that :meth:`to_plain` gave.

        Raises:
            StateMachineError: that is no position; it says what is missing, left over, or of another type.
        """
        names = {field.name for field in fields(cls)}
        if plain.keys() != names:
            wrong = ', '.join(sorted(map(str, plain.keys() ^ names)))
            raise StateMachineError(f'this is no position of a run: missing or left over: {wrong}')
        for name, value in plain.items():
            if not _CHECKS[name](value):
                raise StateMachineError(f'this is no position of a run: {name} cannot be {shown(value)}')
        values: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value for name, value in plain.items()
        }
        return cls(**values)


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [dict(one) if isinstance(one, Mapping) else one for one in value]
    return dict(value) if isinstance(value, Mapping) else value


def _texts(value: Any) -> bool:
    return isinstance(value, list | tuple) and all(isinstance(one, str) for one in value)


def _text_by_path(value: Any) -> bool:
    return isinstance(value, Mapping) and _texts([*value.keys(), *value.values()])


def _is_number(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


_CHECKS: dict[str, Callable[[Any], bool]] = {
    'active': _texts,
    'coming': _texts,
    'wanted': _text_by_path,
    'approved': _texts,
    'leaving': _text_by_path,
    'ended': _text_by_path,
    'userdata': lambda value: (
        isinstance(value, Mapping)
        and _texts([*value.keys()])
        and all(isinstance(one, Mapping) and _texts([*one.keys()]) for one in value.values())
    ),
    'levels': lambda value: (
        isinstance(value, Mapping) and _texts([*value.keys()]) and all(map(_is_number, value.values()))
    ),
    'locked': _texts,
    'breakpoints': _texts,
    'is_paused': lambda value: isinstance(value, bool),
    'decisions': lambda value: isinstance(value, list | tuple) and all(map(_text_by_path, value)),
    'decision_count': lambda value: _is_number(value) and value >= 0,
}

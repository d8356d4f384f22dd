# SPDX-License-Identifier: BSD-3-Clause
"""The keys of the screen: one table, from which the footer, the help and the documentation are made.

No key depends on which pane has the focus. A key whose command cannot work now says why.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Container, Iterable
from dataclasses import dataclass
from typing import Final

from flexbt_console.mirror import AutonomyLevel, DecisionKind, ExecutiveState, View

Possible = Callable[[View], str]
"""Why it cannot work now; '' when it can."""


@dataclass(frozen=True)
class Key:
    """A key, or several; ``action`` is what the screen does, or what :func:`lines_for` knows as lines.

    ``rank``: 1 has a place in every footer, 2 where there is room; 3 is in the help only.
    """

    keys: tuple[str, ...]
    shown: str
    label: str
    help: str
    action: str
    blocked: Possible = lambda view: ''
    rank: int = 1


def _runs(view: View) -> str:
    return '' if view.running else 'no behavior runs'


def _is_idle(view: View) -> str:
    return 'a behavior runs; "w" goes on with another one' if view.running else ''


def _waits(view: View) -> str:
    return '' if view.decision is not None else 'nothing waits for you'


def _has_choices(view: View) -> str:
    return _waits(view) or ('' if view.decision is not None and view.decision.choices else 'there is nothing to pick')


def _wants_pose(view: View) -> str:
    return '' if view.decision is not None and view.decision.wants_pose else 'no pose is asked for'


def _wants_value(view: View) -> str:
    is_input = view.decision is not None and view.decision.kind is DecisionKind.INPUT
    return '' if is_input else 'no value is asked for'


def _is_active(view: View) -> str:
    return '' if view.active_paths else 'no state is active'


def _is_lockable(view: View) -> str:
    return '' if view.lockable_paths else 'nothing that is active can be locked'


_OF_DECISION: Final = (
    Key(('enter',), 'Enter', 'confirm', 'send the answer in brackets to the decision on the screen', 'confirm', _waits),
    Key(tuple('0123456789'), '0-9', 'pick', 'pick an answer, by 0 from a list; Enter sends it', 'pick', _has_choices),
    Key(('g',), 'g', 'point', 'answer on the map: arrows move, < > turn, Enter answers', 'point', _wants_pose, rank=2),
    Key(('d',), 'd', 'decline', 'decline to give the value that is asked for', 'decline', _wants_value, rank=3),
)

_OF_RUN: Final = (
    Key(('exclamation_mark', 'f8'), '! F8', 'STOP', 'stop the run, bring the robot to rest; F8 from anywhere', 'stop'),
    Key(('p',), 'p', 'pause', 'pause the run, or go on with it', 'pause', _runs),
    Key(('f',), 'f', 'force', 'leave an active state by an outcome of your choice', 'force', _is_active, rank=2),
    Key(('plus',), '+ -', 'autonomy', 'let the robot decide more alone, or less', 'more_autonomy', rank=2),
    Key(('minus',), '-', 'less autonomy', 'let the robot decide less alone', 'less_autonomy', rank=3),
    Key(('s',), 's', 'start', 'start a behavior', 'start', _is_idle),
    Key(('w',), 'w', 'switch', 'go on with another behavior, keeping the active states', 'switch', _runs, rank=3),
    Key(('l',), 'l', 'lock', 'keep a state or container from being left, or let it go', 'lock', _is_lockable, rank=3),
    Key(('b',), 'b', 'break', 'set or clear a breakpoint at the active state', 'breakpoint', _is_active, rank=3),
    Key(('r',), 'r', 'repeat', 'leave the active state and enter it again', 'repeat', _is_active, rank=3),
)

_OF_SCREEN: Final = (
    Key(('colon',), ':', 'command', 'type any command; Tab completes it, Esc leaves', 'command_line'),
    Key(('question_mark', 'f1'), '?', 'keys', 'show the keys and the commands', 'help'),
    Key(('z',), 'z', 'zoom', 'the next pane alone on the screen; after the last, all of them', 'zoom', rank=2),
    Key(('o',), 'o', 'robots', 'all robots, the most urgent first; Enter goes to one', 'robots', rank=2),
    Key(('q',), 'q', 'quit', 'leave the screen', 'leave'),
    Key(('u',), 'u', 'userdata', 'show what the states have handed to each other', 'userdata', _runs, rank=3),
    Key(('n',), 'n', 'note', 'write a remark into the log', 'note', rank=3),
    Key(('c',), 'c', 'claim', 'claim the authority to command (ask who has it), or give it back', 'claim', rank=3),
)

KEYS: Final = (*_OF_DECISION, *_OF_RUN, *_OF_SCREEN)


def lines_for(action: str, view: View, operator: str | None) -> list[str]:
    """What a key of this operator stands for, as it would be typed: one line, or several of which one is meant.

    Of several states that are active, any can be meant; a lock is also for the containers around them.
    """
    snapshot = view.snapshot
    if action == 'pause':
        stands = snapshot is not None and snapshot.state in (ExecutiveState.PAUSED, ExecutiveState.INTERRUPTED)
        return ['resume' if stands else 'pause']
    if action in ('more_autonomy', 'less_autonomy'):
        level = (snapshot.autonomy if snapshot else AutonomyLevel.LOW) + (1 if action == 'more_autonomy' else -1)
        return [f'autonomy {min(max(level, AutonomyLevel.OFF), AutonomyLevel.FULL)}']
    if action == 'lock':
        return _at_each(view.lockable_paths, 'lock', 'unlock', snapshot.locked if snapshot else ())
    if action == 'breakpoint':
        return _at_each(view.active_paths, 'breakpoint', 'clear', snapshot.breakpoints if snapshot else ())
    if action == 'repeat':
        return _at_each(view.active_paths, 'repeat', 'repeat', ())
    if action == 'claim':
        has_claimed = snapshot is not None and operator in (snapshot.authority, *snapshot.authority_requests)
        return ['release' if has_claimed else 'claim']
    return [action]


def _at_each(paths: Iterable[str], verb: str, undo: str, done: Container[str]) -> list[str]:
    return [f'{undo if path in done else verb} {shlex.quote(path)}' for path in paths]


def help_lines() -> list[str]:
    """The table, for people."""
    return [f'{key.shown:>6}  {key.label:<14} {key.help}' for key in KEYS]

# SPDX-License-Identifier: BSD-3-Clause
"""The keys of an operator, in one table. The footer, help and documentation of the screen come from it, and so do the
keys and buttons of the page.

No key depends on the pane that has the focus. A key whose command cannot work now shows the reason.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Container, Iterable
from dataclasses import dataclass
from typing import Final

from flexbt_console.mirror.records import AutonomyLevel, DecisionKind, ExecutiveState
from flexbt_console.mirror.view import View

Possible = Callable[[View], str]
"""A function that returns why a key cannot work now, or ''."""

Written = Callable[[View, str | None], list[str]]
"""A function that returns the command of a key as a line; several lines are alternatives to choose from."""


@dataclass(frozen=True)
class KeyBinding:
    """One key, or several with the same effect.

    ``shown``: the key as footer and help show it. ``keys``: Textual's names of the keys, by default ``shown``.
    ``action``: name of the action, by default ``label``; the screen runs it if there are no ``lines``.
    ``begins``: the key opens the command line with this text.
    ``sends``: the key sends a command, which needs a live link, and the authority if any operator has it.
    ``rank``: 1 is in every footer, 2 where it fits, 3 only in the help, unless the operator ``needs`` the key now.
    """

    shown: str
    label: str
    help: str
    action: str = ''
    keys: tuple[str, ...] = ()
    begins: str | None = None
    blocked: Possible = lambda view: ''
    lines: Written | None = None
    rank: int = 1
    needs: Callable[[View, str | None], bool] = lambda view, operator: False
    sends: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, 'action', self.action or self.label)
        object.__setattr__(self, 'keys', self.keys or (self.shown,))

    def can_be_used(self, view: View, operator: str | None, *, has_answer: bool = True) -> bool:
        """Return whether the key has an effect now, as far as known. If pressed anyway, it shows why it has none.

        ``has_answer``: Enter has an answer to send or a line to begin.
        """
        snapshot = view.snapshot
        is_held = snapshot is not None and snapshot.authority not in ('', operator)
        is_refused = (operator is None and self.gives_command) or (self.action == 'confirm' and not has_answer)
        return not (self.blocked(view) or is_refused or (self.sends and (is_held or not view.live)))

    @property
    def gives_command(self) -> bool:
        """True if an observer may not use the key."""
        return self.sends or self.action in ('stop', 'authority', 'note')

    @property
    def asks(self) -> bool:
        """True if the key first shows its line, which Enter then sends.

        Only STOP acts at once, because any other key may be the first letter of a word that is typed as an answer.
        Further letters are appended to the line, which is then no command.
        """
        return self.lines is not None and self.gives_command and self.action != 'stop'


def has_map(view: View) -> bool:
    """Return whether a map can be drawn."""
    around = view.drawn
    return bool(around.map or around.plan or around.driven or view.robot_pose or view.places)


def _runs(view: View) -> str:
    return '' if view.running else 'no behavior runs'


def _is_idle(view: View) -> str:
    return 'a behavior runs; "w" switches to another one' if view.running else _has_behaviors(view)


def _is_switchable(view: View) -> str:
    return _runs(view) or _has_behaviors(view)


def _has_behaviors(view: View) -> str:
    if view.behaviors is None:
        return 'the robot has not sent its list of behaviors'
    return '' if view.behaviors else 'no behaviors are installed on the robot'


def _waits(view: View) -> str:
    return '' if view.decision is not None else 'no decision is pending'


def _has_choices(view: View) -> str:
    return _waits(view) or ('' if view.decision is not None and view.decision.choices else 'it has no choices')


def _wants_pose(view: View) -> str:
    if view.decision is None or not view.decision.wants_pose:
        return 'no pose is requested'
    return '' if has_map(view) else 'there is no map to point at yet; ":" types a place, or x y yaw'


def _wants_value(view: View) -> str:
    is_input = view.decision is not None and view.decision.kind is DecisionKind.INPUT
    return '' if is_input else 'no value is requested'


def _is_active(view: View) -> str:
    return '' if view.active_paths else 'no state is active'


def _has_outcomes(view: View) -> str:
    has_some = any(view.outcomes(path) for path in view.active_paths)
    return _is_active(view) or ('' if has_some else 'the outcomes of the active state are not known yet')


def _is_lockable(view: View) -> str:
    return '' if view.lockable_paths else 'no active state can be locked'


# The lines of keys: one for each active state; for a lock, also one for each container around these.


def _line(text: str) -> Written:
    return lambda view, operator: [text]


def _pause(view: View, operator: str | None) -> list[str]:
    stands = view.snapshot is not None and view.snapshot.state in (ExecutiveState.PAUSED, ExecutiveState.INTERRUPTED)
    return ['resume' if stands else 'pause']


def _autonomy(by: int) -> Written:
    def lines(view: View, operator: str | None) -> list[str]:
        level = (view.snapshot.autonomy if view.snapshot else AutonomyLevel.LOW) + by
        return [f'autonomy {min(max(level, AutonomyLevel.OFF), AutonomyLevel.FULL)}']

    return lines


def _lock(view: View, operator: str | None) -> list[str]:
    return _at_each(view.lockable_paths, 'lock', 'unlock', view.snapshot.locked if view.snapshot else ())


def _breakpoint(view: View, operator: str | None) -> list[str]:
    return _at_each(view.active_paths, 'breakpoint', 'clear', view.snapshot.breakpoints if view.snapshot else ())


def _no_tree(view: View) -> str:
    return '' if view.running_trees else 'no tree runs, as far as this screen knows'


def _no_hold(view: View) -> str:
    return '' if _is_held(view, None) else 'no tree is held or paused'


def _is_held(view: View, operator: str | None) -> bool:
    return view.snapshot is not None and bool(view.snapshot.tree_holds)


def _of_held(verb: str) -> Written:
    def lines(view: View, operator: str | None) -> list[str]:
        holds = view.snapshot.tree_holds if view.snapshot is not None else ()
        return [f'tree {verb} --run {shlex.quote(hold.run_id)}' for hold in holds]

    return lines


def _no_queue(view: View) -> str:
    return '' if view.queue is not None else 'the robot has not sent its mission queue'


def _has_queue(view: View, operator: str | None) -> bool:
    return view.queue is not None and bool(view.queue.entries or view.queue.hold)


def _repeat(view: View, operator: str | None) -> list[str]:
    return _at_each(view.active_paths, 'repeat', 'repeat', ())


def _at_each(paths: Iterable[str], verb: str, undo: str, done: Container[str]) -> list[str]:
    return [f'{undo if path in done else verb} {shlex.quote(path)}' for path in paths]


def _authority(view: View, operator: str | None) -> list[str]:
    snapshot = view.snapshot
    if snapshot is None or operator not in (snapshot.authority, *snapshot.authority_requests):
        return ['claim']
    asking = snapshot.authority_requests if snapshot.authority == operator else ()
    return [*(f'{verb} {shlex.quote(one)}' for one in asking for verb in ('handover', 'refuse')), 'release']


def _is_held_or_asked_for(view: View, operator: str | None) -> bool:
    """Return whether another operator has the authority, or requests it from this operator."""
    snapshot = view.snapshot
    if snapshot is None or operator is None:
        return False
    return bool(snapshot.authority_requests if snapshot.authority == operator else snapshot.authority)


KEYS: Final = (
    KeyBinding(
        'Enter',
        'confirm',
        'Send the answer in brackets to the decision on the screen; for a value, begin the line',
        keys=('enter',),
        blocked=_waits,
        sends=True,
    ),
    KeyBinding(
        '0-9',
        'pick',
        'Put the answer with this number in brackets (0: choose from a list); Enter sends it',
        keys=tuple('0123456789'),
        blocked=_has_choices,
    ),
    KeyBinding('g', 'point', 'Answer on the map: arrows move, < > turn, Enter answers', blocked=_wants_pose, rank=2),
    KeyBinding(
        'a',
        'all',
        'List pending decisions; Enter shows one',
        'waiting',
        blocked=_waits,
        rank=3,
        needs=lambda view, operator: len(view.decisions) > 1,
    ),
    KeyBinding(
        'd',
        'decline',
        'Decline to answer the input request',
        blocked=_wants_value,
        lines=_line('decline'),
        rank=3,
        sends=True,
    ),
    KeyBinding(
        '! F8',
        'STOP',
        'Stop the run and the robot; F8 works everywhere',
        'stop',
        keys=('exclamation_mark', 'f8'),
        lines=_line('stop'),
    ),
    KeyBinding('p', 'pause', 'Pause or resume the run', blocked=_runs, lines=_pause, sends=True),
    KeyBinding(
        'f', 'force', 'Leave an active state by an outcome of your choice', blocked=_has_outcomes, rank=2, sends=True
    ),
    KeyBinding(
        '+ -',
        'autonomy',
        'Raise or lower the autonomy of the robot',
        'more_autonomy',
        keys=('plus',),
        lines=_autonomy(1),
        rank=2,
        sends=True,
    ),
    KeyBinding(
        '-',
        'less autonomy',
        'Lower the autonomy of the robot',
        'less_autonomy',
        keys=('minus',),
        lines=_autonomy(-1),
        rank=3,
        sends=True,
    ),
    KeyBinding('s', 'start', 'Start a behavior', blocked=_is_idle, sends=True),
    KeyBinding(
        'w',
        'switch',
        'Switch to another behavior, keeping the active states',
        blocked=_is_switchable,
        rank=3,
        sends=True,
    ),
    KeyBinding(
        'l', 'lock', 'Lock or unlock a state or container', blocked=_is_lockable, lines=_lock, rank=3, sends=True
    ),
    KeyBinding(
        'b',
        'break',
        'Set or clear a breakpoint at the active state',
        'breakpoint',
        blocked=_is_active,
        lines=_breakpoint,
        rank=3,
        sends=True,
    ),
    KeyBinding(
        'r',
        'repeat',
        'Leave the active state and enter it again',
        blocked=_is_active,
        lines=_repeat,
        rank=3,
        sends=True,
    ),
    KeyBinding(
        't',
        'debug',
        'Debug a node of a running tree: break, force a result, dummy, why it does not run',
        'debug',
        blocked=_no_tree,
        rank=3,
    ),
    KeyBinding(
        'e',
        'tree step',
        'Tick a held or paused tree once',
        'tree_step',
        blocked=_no_hold,
        lines=_of_held('step'),
        rank=3,
        needs=_is_held,
        sends=True,
    ),
    KeyBinding(
        'v',
        'tree on',
        'Let a held or paused tree go on',
        'tree_continue',
        blocked=_no_hold,
        lines=_of_held('continue'),
        rank=3,
        needs=_is_held,
        sends=True,
    ),
    KeyBinding(
        'm',
        'queue',
        'Show the mission queue: add, edit, move or remove entries, hold or release it',
        blocked=_no_queue,
        rank=3,
        needs=_has_queue,
    ),
    KeyBinding(
        'c',
        'authority',
        'Take, request, hand over or release control',
        lines=_authority,
        rank=3,
        needs=_is_held_or_asked_for,
    ),
    KeyBinding(
        ':', 'command', 'Type any command; Tab completes, Esc cancels', 'command_line', keys=('colon',), begins=''
    ),
    KeyBinding('?', 'keys', 'Show the keys and the commands', 'help', keys=('question_mark', 'f1')),
    KeyBinding('Tab', 'focus', 'Focus the next pane (PgUp, PgDn and z then act on it)', keys=('tab',), rank=3),
    KeyBinding(
        'PgUp',
        'back',
        'Scroll back in the focused pane, or in the log; Esc shows the latest',
        'scroll_back',
        keys=('pageup',),
        rank=3,
    ),
    KeyBinding('PgDn', 'on', 'Scroll forward', 'scroll_on', keys=('pagedown',), rank=3),
    KeyBinding('z', 'zoom', 'Enlarge the focused or next pane; after the last, show all', rank=2),
    KeyBinding('h', 'hide', 'Hide the focused pane; without focus, show all', rank=3),
    KeyBinding('o', 'robots', 'List robots, the most urgent first; Enter selects one', rank=2),
    KeyBinding('q', 'quit', 'Quit', 'leave'),
    KeyBinding(
        'u', 'userdata', 'Show the data that states pass to each other', blocked=_runs, lines=_line('userdata'), rank=3
    ),
    KeyBinding('n', 'note', 'Write a note to the log', begins='note ', rank=3),
)

SIGNS: Final = (('[ ]', 'what Enter sends'), ('*', 'the outcome that the state wants'))
"""The signs of answers in the decision bar, and their meanings."""

HOW_KEYS_SEND: Final = (
    'Only STOP acts at once. Every other command shows its line, list or form first; Enter sends it. '
    'Letters typed within 0.7 s of each other are a word and send nothing.'
)


def help_lines() -> list[str]:
    """Return the lines of the help: the keys, and the signs of the decision bar."""
    keys = [f'{key.shown:>6}  {key.label:<14} {key.help}' for key in KEYS]
    signs = [f'{sign:>6}  {"":<14} {what}' for sign, what in SIGNS]
    return [*keys, '', HOW_KEYS_SEND, '', 'Signs in the decision bar:', *signs]

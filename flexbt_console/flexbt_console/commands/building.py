# SPDX-License-Identifier: BSD-3-Clause
"""From a parsed command line to the command for the executive, the same for line mode and prompt."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Final

from flexbt_console.errors import RefusedError, UsageError
from flexbt_console.mirror import View
from flexbt_console.mirror.records import AutonomyLevel, Command, CommandKind

from .command_line import CommandLine, autonomy_level
from .operator_values import start_input
from .requests import Requests


def check_command(line: CommandLine) -> None:
    """Find what is wrong with a command as it is written, whatever the executive does.

    Raises:
        UsageError: a level is none, a pair is not one, or a value is missing.
    """
    assert line.spec is not None
    if line.spec.name == 'autonomy':
        autonomy_level(line.words[0])
    if line.spec.name in ('start', 'switch'):
        _arguments(line)
        _start_autonomy(line)
    if line.spec.name == 'input' and not line.has('--decline') and not line.words:
        raise UsageError(f'usage: {line.spec.usage}')


def build(line: CommandLine, view: View, requests: Requests) -> Command:
    """Make the command that the line asks for, bound to what ``view`` shows.

    Raises:
        UsageError: it is not written as it has to be.
        RefusedError: it cannot work now.
    """
    assert line.spec is not None
    return BUILDERS[line.spec.name](line, view, requests)


def _start(line: CommandLine, view: View, requests: Requests) -> Command:
    inputs = [start_input(text, requests.places) for text in line.values('--input')]
    return requests.start(view, line.words[0], _arguments(line), _start_autonomy(line), inputs)


def _stop(line: CommandLine, view: View, requests: Requests) -> Command:
    return requests.stop(view, _reason(line))


def _autonomy(line: CommandLine, view: View, requests: Requests) -> Command:
    path = line.words[1] if len(line.words) > 1 else ''
    return requests.autonomy(view, autonomy_level(line.words[0]), path)


def _confirm(line: CommandLine, view: View, requests: Requests) -> Command:
    return requests.confirm(view, _first_word(line), _reason(line))


def _force(line: CommandLine, view: View, requests: Requests) -> Command:
    path, outcome = line.words if len(line.words) == 2 else ('', line.words[0])
    return requests.force(view, path, outcome, line.value('--decision') or '', _reason(line))


def _input(line: CommandLine, view: View, requests: Requests) -> Command:
    decision_id, words = line.value('--decision') or '', line.words
    if line.has('--decline'):
        return requests.decline(view, decision_id or _first_word(line), _reason(line))
    if not decision_id and len(words) > 1:
        if view.snapshot is not None and view.snapshot.decision(words[0]) is not None:
            decision_id, words = words[0], words[1:]
        elif any(decision.input_type in ('string', 'str') for decision in view.decisions):
            # The first word might be meant as the name of a question that is gone: it must not become the answer.
            raise RefusedError('a text of several words is one word in quotes, or goes with --decision ID')
    return requests.answer(view, decision_id, ' '.join(words), _reason(line))


def _decline(line: CommandLine, view: View, requests: Requests) -> Command:
    return requests.decline(view, _first_word(line), _reason(line))


def _pause(line: CommandLine, view: View, requests: Requests) -> Command:
    return requests.pause(view, _reason(line))


def _resume(line: CommandLine, view: View, requests: Requests) -> Command:
    return requests.resume(view, _reason(line))


def _abort(line: CommandLine, view: View, requests: Requests) -> Command:
    return requests.abort(view, _reason(line))


def _repeat(line: CommandLine, view: View, requests: Requests) -> Command:
    return requests.repeat(view, _first_word(line), _reason(line))


def _mark(kind: CommandKind, line: CommandLine, view: View, requests: Requests) -> Command:
    return requests.mark(kind, view, line.words[0], _reason(line))


def _switch(line: CommandLine, view: View, requests: Requests) -> Command:
    return requests.switch(view, line.words[0], _arguments(line), _reason(line))


def _claim(line: CommandLine, view: View, requests: Requests) -> Command:
    return requests.claim_authority(view, _reason(line))


def _release(line: CommandLine, view: View, requests: Requests) -> Command:
    return requests.release_authority(view, _reason(line))


def _handover(line: CommandLine, view: View, requests: Requests) -> Command:
    return requests.hand_over_authority(view, _first_word(line), _reason(line))


BUILDERS: Final[Mapping[str, Callable[[CommandLine, View, Requests], Command]]] = {
    'start': _start,
    'stop': _stop,
    'autonomy': _autonomy,
    'confirm': _confirm,
    'force': _force,
    'input': _input,
    'decline': _decline,
    'pause': _pause,
    'resume': _resume,
    'abort': _abort,
    'repeat': _repeat,
    'lock': functools.partial(_mark, CommandKind.LOCK),
    'unlock': functools.partial(_mark, CommandKind.UNLOCK),
    'breakpoint': functools.partial(_mark, CommandKind.BREAKPOINT),
    'clear': functools.partial(_mark, CommandKind.CLEAR_BREAKPOINT),
    'switch': _switch,
    'claim': _claim,
    'release': _release,
    'handover': _handover,
}
"""The commands of the table that are sent to the executive."""


def _first_word(line: CommandLine) -> str:
    return line.words[0] if line.words else ''


def _reason(line: CommandLine) -> str:
    return line.value('--reason') or ''


def _arguments(line: CommandLine) -> list[tuple[str, str]]:
    pairs = []
    for word in line.words[1:]:
        key, equals, value = word.partition('=')
        if not equals or not key:
            raise UsageError(f'{word!r}: expected PARAMETER=VALUE')
        pairs.append((key, value))
    return pairs


def _start_autonomy(line: CommandLine) -> AutonomyLevel:
    text = line.value('--autonomy')
    return AutonomyLevel.LOW if text is None else autonomy_level(text)

# SPDX-License-Identifier: BSD-3-Clause
"""The commands for the executive that lines are made into."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from flexbt_console.errors import NotShownError, RefusedError, UsageError
from flexbt_console.mirror import NOTE_LENGTH, Command, CommandKind, DecisionKind, View
from flexbt_core.values import one_line

from .command_builder import CommandBuilder
from .operator_values import assignment, autonomy_level, start_input
from .spec import DECISION, UNSEEN, Answers, CommandLine, Send


def alone(kind: CommandKind) -> Send:
    """A command without arguments of its own."""
    return Send((kind,), lambda line, view, make: make.command(view, kind))


def at_path(kind: CommandKind) -> Send:
    """A command for the state or container that the line names."""
    return Send((kind,), lambda line, view, make: make.at_path(kind, view, line.words[0]))


def to_requester(kind: CommandKind) -> Send:
    """A command about an operator who asks for the authority."""
    return Send((kind,), lambda line, view, make: make.to_requester(kind, view, line.first_word))


def check_input(line: CommandLine) -> None:
    """Raises UsageError: neither a value, nor that it is declined."""
    if not line.has('--decline') and not line.words:
        assert line.spec is not None
        raise UsageError(f'usage: {line.spec.usage}')


def check_note(line: CommandLine) -> None:
    """Raises UsageError: it is empty, or too long."""
    if len(line.text) > NOTE_LENGTH:
        raise UsageError(f'the note has {len(line.text)} characters; at most {NOTE_LENGTH} are taken')
    if not line.text.strip():
        raise UsageError('the note is empty')


def _assignments(line: CommandLine) -> list[tuple[str, str]]:
    return [assignment(word) for word in line.words[1:]]


def _start(line: CommandLine, view: View, make: CommandBuilder) -> Command:
    inputs = [start_input(text, view.places) for text in line.values('--input')]
    level = autonomy_level(line.value('--autonomy')) if line.has('--autonomy') else None
    _check_listed(line, view)
    return make.start(view, line.words[0], _assignments(line), level, inputs, unseen=line.has(UNSEEN))


def _switch(line: CommandLine, view: View, make: CommandBuilder) -> Command:
    _check_listed(line, view)
    return make.switch(view, line.words[0], _assignments(line), unseen=line.has(UNSEEN))


def _check_listed(line: CommandLine, view: View) -> None:
    """Raises NotShownError: the behavior may be one that was synthesized, and nobody here can have seen its machine."""
    if view.behaviors is None and not line.has(UNSEEN):
        message = view.snapshot.message if view.snapshot is not None else ''
        why = f' ({one_line(message, 300)})' if message else ''
        raise NotShownError(
            f'the robot has not said which behaviors it has, and how those were synthesized{why}; nothing was sent. '
            'Wait for it, or send it all the same with --unseen'
        )


def _autonomy(line: CommandLine, view: View, make: CommandBuilder) -> Command:
    return make.autonomy(view, autonomy_level(line.words[0]), line.words[1] if len(line.words) > 1 else '')


def _force(line: CommandLine, view: View, make: CommandBuilder) -> Command:
    path, outcome = line.words if len(line.words) == 2 else ('', line.words[0])
    return make.force(view, path, outcome, line.value(DECISION), unseen=line.has(UNSEEN))


def _input(line: CommandLine, view: View, make: CommandBuilder) -> Command:
    decision_id, unseen = line.value(DECISION), line.has(UNSEEN)
    if line.has('--decline'):
        return make.decline(view, decision_id or line.first_word)
    if not decision_id and len(line.words) > 1:
        if view.pending(line.words[0]) is not None:
            return make.answer(view, line.words[0], ' '.join(line.words[1:]), unseen=unseen)
        if any(decision.wants_text for decision in view.decisions):
            # The first word might be meant as the name of a request that is gone: it must not become the answer.
            raise RefusedError('a text of several words is one word in quotes, or goes with --decision ID')
    return make.answer(view, decision_id, line.text, unseen=unseen)


def _names_decision(line: CommandLine, view: View) -> bool:
    return bool(line.words)


def _names_state(line: CommandLine, view: View) -> bool:
    return len(line.words) == 2


def _names_input_request(line: CommandLine, view: View) -> bool:
    return bool(line.words) and view.pending(line.words[0]) is not None


_OUTCOMES: Final = frozenset({DecisionKind.TRANSITION, DecisionKind.CHOICE})
_VALUES: Final = frozenset({DecisionKind.INPUT})

START: Final = Send((CommandKind.START,), _start)
SWITCH: Final = Send((CommandKind.SWITCH,), _switch)
AUTONOMY: Final = Send((CommandKind.AUTONOMY,), _autonomy)
CONFIRM: Final = Send(
    (CommandKind.CONFIRM,),
    lambda line, view, make: make.confirm(view, line.value(DECISION) or line.first_word, unseen=line.has(UNSEEN)),
    Answers(_OUTCOMES, _names_decision),
)
FORCE: Final = Send((CommandKind.FORCE,), _force, Answers(_OUTCOMES, _names_state, also_alone=True))
INPUT: Final = Send((CommandKind.ANSWER, CommandKind.DECLINE), _input, Answers(_VALUES, _names_input_request))
DECLINE: Final = Send(
    (CommandKind.DECLINE,),
    lambda line, view, make: make.decline(view, line.value(DECISION) or line.first_word),
    Answers(_VALUES, _names_decision),
)
RESUME: Final = Send((CommandKind.RESUME, CommandKind.RESUME_RUN), lambda line, view, make: make.resume(view))
REPEAT: Final = Send((CommandKind.REPEAT,), lambda line, view, make: make.repeat(view, line.first_word))
NOTE: Final = Send(
    (CommandKind.NOTE,), lambda line, view, make: replace(make.command(view, CommandKind.NOTE), text=line.text)
)

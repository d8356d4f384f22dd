# SPDX-License-Identifier: BSD-3-Clause
"""What a line typed at the prompt means: a command, or in short the answer to the question on the screen."""

from __future__ import annotations

import dataclasses
import difflib
import shlex
from dataclasses import dataclass
from enum import Enum

from flexbt_console.commands import command_table
from flexbt_console.commands.building import build, check_command
from flexbt_console.commands.command_line import CommandLine, parse
from flexbt_console.commands.command_table import COMMON_OPTIONS
from flexbt_console.commands.requests import Requests
from flexbt_console.errors import RefusedError, UsageError
from flexbt_console.mirror import View, choices
from flexbt_console.mirror.records import Command, CommandKind, Decision, DecisionKind

ANSWERING = frozenset({'confirm', 'force', 'input', 'decline'})
"""Commands that answer the question on the screen when they name no other."""

CHANGED = 'the question changed while you were typing; nothing was sent. Look at it, and answer again'


class Local(Enum):
    """What the prompt does by itself."""

    NOTHING = 'nothing'
    QUIT = 'quit'
    HELP = 'help'
    SHOW = 'show'


@dataclass(frozen=True, slots=True)
class Meaning:
    """What is to be done: send ``command``, called ``label`` to the operator, or something local with ``line``."""

    local: Local = Local.NOTHING
    command: Command | None = None
    label: str = ''
    line: CommandLine | None = None


@dataclass(frozen=True, slots=True)
class Bound:
    """The question that a line belongs to (see :class:`flexbt_console.ui.prompt.shown_question.ShownQuestion`)."""

    decision_id: str | None
    hasty: bool = False

    def decision(self, view: View) -> Decision:
        """That question.

        Raises:
            RefusedError: it is not pending any more, or was not there yet when the typing began.
        """
        if self.hasty:
            raise RefusedError('this question had just come up when you began to type; nothing was sent')
        if self.decision_id is None:
            if view.decision is not None:
                raise RefusedError(CHANGED)
            raise RefusedError('nothing waits for you; "help" lists the commands')
        found = view.snapshot.decision(self.decision_id) if view.snapshot else None
        if found is None:
            raise RefusedError(CHANGED if view.decision else 'the question is gone; nothing was sent')
        return found


def interpret(text: str, view: View, requests: Requests, bound: Bound) -> Meaning:
    """Find out what a line means. Names of commands come first; then it is an answer.

    Raises:
        UsageError: it is not written as it has to be.
        RefusedError: it cannot work now; nothing is sent.
    """
    words = _words(text)
    if not words:
        return Meaning()
    name = words[0].lower()
    if name in ('quit', 'exit'):
        return Meaning(Local.QUIT)
    if name in ('help', '?'):
        topic = command_table.find(words[1]) if len(words) > 1 else None
        return Meaning(Local.HELP, line=CommandLine(topic))
    spec = command_table.find(name)
    if spec is not None and spec.in_prompt:
        return _command(parse([name, *words[1:]]), view, requests, bound)
    if bound.decision_id is None and view.decision is None and not words[0].isdigit():
        near = difflib.get_close_matches(name, [spec.name for spec in command_table.COMMANDS], n=1)
        hint = f'did you mean {near[0]!r}?' if near else '"help" lists them'
        raise UsageError(f'there is no command {words[0]!r}; {hint}')
    return _answer(text.strip(), view, requests, bound.decision(view))


def _command(line: CommandLine, view: View, requests: Requests, bound: Bound) -> Meaning:
    assert line.spec is not None
    if line.has('--help'):
        return Meaning(Local.HELP, line=line)
    name = line.spec.name
    if name in ('status', 'behaviors', 'structure', 'log', 'places'):
        return Meaning(Local.SHOW, line=line)
    shell_only = [option.name for option in line.spec.options if not option.in_prompt and line.has(option.name)]
    shell_only += [option.name for option in COMMON_OPTIONS if line.has(option.name)]
    if shell_only:
        raise UsageError(f'{shell_only[0]} is for the command line; it means nothing at the prompt')
    check_command(line)
    if name != 'stop':
        _require_live(view)
    command = build(_bind(line, view, bound), view, requests)
    return Meaning(command=command, label=name)


def _bind(line: CommandLine, view: View, bound: Bound) -> CommandLine:
    """The line with the question that it answers named in it."""
    assert line.spec is not None
    if line.spec.name not in ANSWERING or line.has('--decision'):
        return line
    pending = {decision.id for decision in view.decisions}
    if line.spec.name == 'force':
        if len(line.words) == 2 or (bound.decision_id is None and not pending):
            return line
        question = bound.decision(view)
        if question.kind is DecisionKind.INPUT:
            return line  # leaves the asking state by an outcome: checked against the state itself
        return dataclasses.replace(line, options={**line.options, '--decision': [question.id]})
    if line.words and line.words[0] in pending:
        return line
    if line.spec.name in ('confirm', 'decline') and line.words:
        return line
    question = bound.decision(view)
    if line.spec.name == 'input':
        return dataclasses.replace(line, options={**line.options, '--decision': [question.id]})
    return dataclasses.replace(line, words=(question.id,))


def _answer(text: str, view: View, requests: Requests, decision: Decision) -> Meaning:
    _require_live(view)
    options = choices(decision)
    chosen = text
    if text not in options and text.isascii() and text.isdigit() and options:
        number = int(text)
        if not 1 <= number <= len(options):
            raise RefusedError(f'{number} is none of the choices 1 to {len(options)}')
        chosen = options[number - 1]
    if decision.kind is DecisionKind.INPUT:
        if not options and decision.input_type in ('string', 'str'):
            # Any mistyped command would be a valid answer.
            raise RefusedError(f'{text!r} is no command; a text is answered by: input "..."')
        command = requests.answer(view, decision.id, chosen)
        return Meaning(command=command, label=f'answer {chosen}')
    command = requests.choose(view, decision, chosen)
    verb = 'confirm' if command.kind is CommandKind.CONFIRM else 'force'
    return Meaning(command=command, label=f'{verb} {chosen}')


def _require_live(view: View) -> None:
    if not view.live:
        seen = 'no executive was heard' if view.age is None else f'what you see is {view.age:.1f} s old'
        raise RefusedError(f'there is no live link ({seen}); nothing was sent. Only "stop" is tried all the same')


def _words(text: str) -> list[str]:
    try:
        return shlex.split(text)
    except ValueError:
        return text.split()

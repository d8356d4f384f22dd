# SPDX-License-Identifier: BSD-3-Clause
"""The meaning of a typed line: a command, or a short answer to the decision that was shown when typing began."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.commands.command_line import COMMON_OPTIONS, check, parse
from flexbt_console.commands.registry import COMMANDS, begun, build
from flexbt_console.commands.spec import DECISION, NO_COMMAND, CommandLine, CommandSpec, LinkNeed, Send, Show
from flexbt_console.errors import RefusedError, UsageError
from flexbt_console.mirror.records import CommandKind, Decision, DecisionKind, OperatorCommand
from flexbt_console.mirror.view import View
from flexbt_core.clock.clock import Clock
from flexbt_core.values.text import did_you_mean, short_repr

CHANGED = 'the decision changed while you were typing; nothing was sent. Check it and answer again'


class NoLiveLinkError(RefusedError):
    """A live link that is needed and missing."""


class Local(Enum):
    """An action of the user interface itself."""

    NOTHING = 'nothing'
    QUIT = 'quit'
    HELP = 'help'
    READ = 'read'


@dataclass(frozen=True, slots=True)
class Meaning:
    """The meaning of a line: send ``command``, shown to the operator as ``label``, or do ``local`` with ``line``."""

    local: Local = Local.NOTHING
    command: OperatorCommand | None = None
    label: str = ''
    line: CommandLine = field(default_factory=CommandLine)


@dataclass(frozen=True, slots=True)
class Bound:
    """The decision that a line belongs to (see :class:`ShownDecision`). ``hasty``: its typing began too soon."""

    decision_id: str | None
    hasty: bool = False

    def decision(self, view: View) -> Decision:
        """Return that decision.

        Raises:
            RefusedError: it is not pending any more, or was not there yet when the typing began.
        """
        if self.hasty:
            raise RefusedError('this decision appeared just as you began to type; nothing was sent')
        if self.decision_id is None:
            if view.decision is not None:
                raise RefusedError(CHANGED)
            raise RefusedError('no decision is pending; "help" lists the commands')
        found = view.pending(self.decision_id)
        if found is None:
            raise RefusedError(CHANGED if view.decision else 'the decision is no longer pending; nothing was sent')
        return found


Permit = Callable[[CommandSpec | None], None]
"""A check whether the user may give a command, or for None an answer. Raises RefusedError."""


def interpret(
    text: str, view: View, builder: CommandBuilder, bound: Bound, permit: Permit = lambda spec: None
) -> Meaning:
    """Interpret a line. Names of commands take precedence; other lines are answers.

    ``permit`` is called before a value is read, which may take long.

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
        topic = begun(words[1:])[0] if len(words) > 1 else NO_COMMAND
        if topic is None:
            raise UsageError(_no_command(words[1]))
        return Meaning(Local.HELP, line=CommandLine(topic))
    spec, _ = begun([name, *words[1:]])
    if spec is not None and spec.in_prompt:
        permit(spec)
        return _command(parse([name, *words[1:]]), view, builder, bound)
    if spec is not None and not any(text.strip() in decision.choices for decision in view.decisions):
        raise UsageError(f'{name!r} is for the command line: console {name}')
    if bound.decision_id is None and view.decision is None and not words[0].isdigit():
        raise UsageError(_no_command(words[0]))
    permit(None)
    return _answer(text.strip(), view, builder, bound.decision(view))


def _command(line: CommandLine, view: View, builder: CommandBuilder, bound: Bound) -> Meaning:
    spec = line.spec
    if line.has('--help'):
        return Meaning(Local.HELP, line=line)
    shell_only = [option.name for option in spec.options if not option.in_prompt and line.has(option.name)]
    shell_only += [*(option.name for option in COMMON_OPTIONS if line.has(option.name)), *line.ros_arguments[:1]]
    if shell_only:
        raise UsageError(f'{shell_only[0]} is for the command line, not for the prompt')
    check(line)
    if spec.link is LinkNeed.LIVE and not isinstance(spec.action, Show):
        _require_live(view)
    if isinstance(spec.action, Send):
        line = _bind(line, view, bound)
    return meaning_of(line, view, builder, ' '.join([spec.name, *line.words]))


def meaning_of(line: CommandLine, view: View, builder: CommandBuilder, label: str) -> Meaning:
    """Return the meaning of a checked line that names everything it refers to.

    Raises:
        ConsoleError: it cannot work now; nothing is sent.
    """
    if isinstance(line.spec.action, Send):
        return Meaning(command=build(line, view, builder), label=label)
    return Meaning(Local.READ, line=line)


def _bind(line: CommandLine, view: View, bound: Bound) -> CommandLine:
    """Return the line with the identifier of the decision that it answers."""
    assert isinstance(line.spec.action, Send)
    answers = line.spec.action.answers
    if answers is None or line.has(DECISION) or answers.names_its_own(line, view):
        return line
    if answers.also_alone and bound.decision_id is None and not view.decisions:
        return line
    decision = bound.decision(view)
    if answers.also_alone and decision.kind not in answers.kinds:
        return line  # meant for the state that asks: checked against the state itself
    name = line.spec.name
    if name in decision.choices and name != decision.outcome and not (line.words or line.options):
        raise RefusedError(
            f'{name!r} is an answer, and a command; write: {_verb(decision)} {name}, or {name} {decision.id}'
        )
    return line.bound_to(decision.id)


def _answer(text: str, view: View, builder: CommandBuilder, decision: Decision) -> Meaning:
    _require_live(view)
    choices = decision.choices
    chosen = text
    if text.isascii() and text.isdigit() and choices:
        is_number = len(text) < 6 and not text.startswith('0')
        counted = choices[int(text) - 1] if is_number and int(text) <= len(choices) else None
        if text in choices and counted not in (None, text):
            told = f'{text} is an answer, and the number of {short_repr(counted)}'
            raise RefusedError(f'{told}; write: {_verb(decision)} {text}')
        if text not in choices and counted is None:
            raise RefusedError(f'{short_repr(text)} is not one of the choices 1 to {len(choices)}')
        chosen = text if counted is None else counted
    if decision.kind is DecisionKind.INPUT and not choices and decision.wants_text:
        # Any mistyped command would be a valid answer.
        raise RefusedError(f'{text!r} is not a command; to answer with text, use: input "..."')
    return choose(chosen, view, builder, decision)


def _verb(decision: Decision) -> str:
    """Return the command by which a decision is answered with any of its choices."""
    return 'input' if decision.kind is DecisionKind.INPUT else 'force'


def choose(chosen: str, view: View, builder: CommandBuilder, decision: Decision, *, unseen: bool = False) -> Meaning:
    """Return the command by which a decision is answered: one of its choices, or the value that it asks for, as text.

    ``unseen``: the operator was asked, and insists, although what the decision is about was not received.

    Raises:
        NotShownError: what the decision is about was not received.
        UsageError: the value is not written as its type has to be.
        RefusedError: it cannot work now; nothing is sent.
    """
    _require_live(view)
    if decision.kind is DecisionKind.INPUT:
        return Meaning(command=builder.answer(view, decision.id, chosen, unseen=unseen), label=f'input {chosen}')
    command = builder.choose(view, decision, chosen, unseen=unseen)
    verb = 'confirm' if command.kind is CommandKind.CONFIRM else 'force'
    return Meaning(command=command, label=f'{verb} {chosen}')


def _require_live(view: View) -> None:
    if not view.live:
        seen = 'no executive was heard' if view.age is None else f'the status is {view.age:.1f} s old'
        raise NoLiveLinkError(f'there is no live link ({seen}); nothing was sent. Only "stop" can be sent')


def _no_command(word: str) -> str:
    known = [spec.name for spec in COMMANDS if spec.in_prompt]
    return f'there is no command {short_repr(word)}' + did_you_mean(word.lower(), known, '; "help" lists them')


def _words(text: str) -> list[str]:
    first, *rest = text.strip().split(maxsplit=1) or ['']
    spec, _ = begun([first.lower()])
    if spec is not None and any(one.as_typed for one in spec.arguments) and rest[:1] != ['--help']:
        return [first, '--', *rest]
    try:
        return shlex.split(text)
    except ValueError:
        return text.split()


# Which decision the operator was looking at when the typing began, so that no answer reaches another one.

REACTION_SECONDS: Final = 0.4
"""A key that is pressed sooner than this after a decision took the place of another was meant for the other.

So it is also when there was nothing in between for no longer than this: who presses Enter twice answers once.
"""


class ShownDecision:
    """A binding of each typed line to the decision that was on the screen at its first key."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._shown: str | None = None
        self._left_at: float | None = None
        self._replaced_at: float | None = None
        self._bound: str | None = None
        self._typing = False
        self._hasty = False

    @property
    def shown(self) -> str | None:
        """Identifier of the decision on the screen."""
        return self._shown

    def drawn(self, decision_id: str | None) -> None:
        """Note that the screen shows this decision now."""
        if decision_id == self._shown:
            return
        now = self._clock.now()
        if self._shown is not None:
            self._left_at = now
        is_replaced = self._left_at is not None and now - self._left_at < REACTION_SECONDS
        self._replaced_at = now if is_replaced and decision_id is not None else None
        self._shown = decision_id

    def known(self, decision_id: str) -> None:
        """Note that the screen shows this decision now, because the operator asked for it."""
        self._shown, self._left_at, self._replaced_at = decision_id, None, None

    def typed(self, text: str) -> None:
        """Note the text of the line. Its first character binds the line to the decision on the screen."""
        if not text:
            self._typing = False
        elif not self._typing:
            self._typing = True
            self._bound = self._shown
            since = None if self._replaced_at is None else self._clock.now() - self._replaced_at
            self._hasty = since is not None and since < REACTION_SECONDS

    @property
    def bound(self) -> Bound:
        """The decision to which the line is bound."""
        return Bound(self._bound, self._hasty) if self._typing else Bound(self._shown)

    def take(self) -> Bound:
        """Return the binding of the finished line."""
        bound = self.bound
        self._typing = False
        return bound

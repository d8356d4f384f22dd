# SPDX-License-Identifier: BSD-3-Clause
"""The station of an operator: carry out a line, follow its commands, notice restarts, explain waiting decisions.

Prompt, screen and page use it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from math import fsum
from typing import Final, NamedTuple

from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.commands.command_line import prompt_command_help, prompt_help
from flexbt_console.commands.spec import Ask, CommandLine, RobotCommands, RobotQueries, Show
from flexbt_console.mirror.command_tracker import CommandState, Confirmation
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import OperatorCommand
from flexbt_console.mirror.view import View
from flexbt_console.present.rendering import command_result_lines
from flexbt_console.present.style import Line, Tone
from flexbt_core.clock.clock import Clock

from .answers import Local, Meaning


@dataclass(frozen=True)
class Station:
    """A robot as its operator has it; ``timeout`` is in seconds, for each answer; ``leaving`` says what happens when
    its operator leaves.

    ``page`` is the address of the page of the same robots, '' where there is none known.
    ``attention`` is what its operator deals with: one for all robots of that operator.
    """

    mirror: Mirror
    link: RobotCommands
    make: CommandBuilder
    timeout: float
    attention: Attention
    leaving: str
    page: str = ''


class Reading(NamedTuple):
    """Lines to be read, and what they are about; whether they are the map."""

    title: str
    text: list[str]
    is_map: bool = False


RobotRequest = Callable[[RobotQueries, Callable[[str], None]], Reading]
"""Asks the robot, and waits: ``Station.timeout`` seconds at most, but for a synthesis, which has a time of its own and
tells lines meanwhile. Not on the thread of a user interface. Raises ConsoleError."""


def carry_out(meaning: Meaning, view: View, station: Station) -> OperatorCommand | Reading | RobotRequest | None:
    """Do what was meant by what was seen in ``view``, and give the command that was sent, or what there is to read.
    To leave is left to the caller.

    Raises:
        ConsoleError: what is to be shown has not arrived.
    """
    line = meaning.line
    if meaning.command is not None:
        command = station.attention.measured(meaning.command)
        station.link.send(command, station.timeout, meaning.label)
        return command
    spec = line.spec if line is not None else None
    if meaning.local is Local.HELP:
        return Reading('help', prompt_help(station.leaving) if spec is None else prompt_command_help(spec))
    if line is None or spec is None:
        return None
    if isinstance(spec.action, Show):
        return Reading(spec.name, spec.action.show(line, view, station.mirror).text)
    if isinstance(spec.action, Ask):
        return partial(_ask, spec.name, spec.action, line, station.timeout)
    return None


def _ask(
    title: str, action: Ask, line: CommandLine, timeout: float, robot: RobotQueries, tell: Callable[[str], None]
) -> Reading:
    return Reading(title, action.ask(line, robot, timeout, tell).text, action.is_map)


# What an operator is told of the commands that were sent: that there is no answer yet, and what became of each.

SOON_SECONDS: Final = 0.5
"""Of a command that is answered within that time only the answer is told."""


@dataclass(frozen=True, slots=True)
class _Sent:
    mirror: Mirror
    given: float
    told: tuple[CommandState, Confirmation | None] | None = None


class SentCommands:
    """The commands of one operator, for one robot or several. An answer after the time-out is told, too."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._sent: dict[str, _Sent] = {}

    def add(self, mirror: Mirror, command_id: str) -> None:
        """It was given to the robot of that mirror."""
        self._sent[command_id] = _Sent(mirror, self._clock.now())

    def __bool__(self) -> bool:
        """Return whether there is a command of which more may be told."""
        return bool(self._sent)

    def updates(self) -> list[list[str]]:
        """Return the lines of each command whose state has changed since the last call, in the order of sending."""
        updates = []
        for command_id, sent in list(self._sent.items()):
            tracked = sent.mirror.command(command_id)
            if tracked is None or (
                tracked.state in (CommandState.APPLIED, CommandState.REFUSED)
                and tracked.confirmed_by is not Confirmation.STOP_GUARD  # the executive may still confirm it
            ):
                del self._sent[command_id]
            elif (tracked.state, tracked.confirmed_by) == sent.told or (
                tracked.state is CommandState.PENDING and self._clock.now() < sent.given + SOON_SECONDS
            ):
                continue
            else:
                self._sent[command_id] = _Sent(sent.mirror, sent.given, (tracked.state, tracked.confirmed_by))
            if tracked is not None:
                updates.append(command_result_lines(tracked))
        return updates


# Why a decision has waited: its operator dealt with another one, had not noticed it, or was dealing with it.
#
# The parts are those of the literature on how many robots one operator can serve (Cummings and Mitchell 2008,
# *Predicting controller capacity in supervisory control of multiple UAVs*): wait times by queues, by loss of situation
# awareness, and by interaction. An operator deals with a decision from the first key that is pressed while it is on the
# screen.

REMEMBERED: Final = 200
"""Spells of dealing with a decision."""


DecisionKey = tuple[str, str]
"""A decision among those of all robots: the identifier of its executive, and its own."""


class Attention:
    """What the operator deals with, and since when, by the keys that are pressed."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._seen: dict[DecisionKey, float] = {}
        self._spells: list[tuple[DecisionKey, float, float]] = []
        self._current: tuple[DecisionKey, float] | None = None

    def pending(self, views: Iterable[View]) -> None:
        """What waits in these waits now."""
        now = self._clock.now()
        waiting = [key for view in views for one in view.decisions if (key := _key(view, one.id)) is not None]
        self._seen = {one: self._seen.get(one, now) for one in waiting}

    def touched(self, view: View, decision_id: str | None) -> None:
        """A key was pressed while this decision of the view was on the screen; None is none."""
        key = _key(view, decision_id)
        if self._current is not None and self._current[0] == key:
            return
        self._close()
        self._current = (key, self._clock.now()) if key is not None else None

    def measured(self, command: OperatorCommand) -> OperatorCommand:
        """With why the decision that it answers has waited, for the report of the run."""
        if not command.decision_id:
            return command
        queue, interaction = self.answered((command.executive_id, command.decision_id))
        return replace(command, wait_queue=queue, wait_interaction=interaction)

    def answered(self, decision: DecisionKey) -> tuple[float, float]:
        """Seconds in which others were dealt with while this one waited, and in which this one was."""
        self._close()
        now = self._clock.now()
        seen = self._seen.get(decision, now)
        queue = fsum(max(0.0, end - max(begin, seen)) for one, begin, end in self._spells if one != decision)
        return queue, fsum(end - begin for one, begin, end in self._spells if one == decision)

    def _close(self) -> None:
        if self._current is not None:
            decision, begin = self._current
            self._spells = [*self._spells[-REMEMBERED + 1 :], (decision, begin, self._clock.now())]
            self._current = None


def _key(view: View, decision_id: str | None) -> DecisionKey | None:
    return (view.snapshot.executive_id, decision_id) if decision_id and view.snapshot is not None else None


# That the executive of a robot is not the one that was there before, with which its run may have gone.

RESTARTED = Line('the executive was restarted; the first line says what runs now', Tone.WARNING)


class Restarts:
    """What was seen of one robot so far."""

    def __init__(self) -> None:
        self._known = ''

    def told(self, view: View) -> list[str]:
        """Return what is to be told of this view."""
        before, self._known = self._known, view.snapshot.executive_id if view.snapshot is not None else self._known
        return [RESTARTED] if before not in ('', self._known) else []

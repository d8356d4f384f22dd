# SPDX-License-Identifier: BSD-3-Clause
"""The session of an operator: carry out lines, follow their commands, and measure why decisions have waited.

Line mode, prompt, screen and page differ only in where lines come from and where answers go.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from math import fsum
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.commands.command_line import prompt_command_help, prompt_help
from flexbt_console.commands.registry import role_for
from flexbt_console.commands.spec import Ask, CommandLine, CommandSpec, Inquiry, Reading, Role, Show
from flexbt_console.errors import RefusedError
from flexbt_console.link.robot_link import RobotLink
from flexbt_console.mirror.command_tracker import CommandState, Confirmation
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import OperatorCommand
from flexbt_console.mirror.view import View
from flexbt_console.present.rendering import command_result_lines
from flexbt_console.present.style import Line, Tone
from flexbt_core.clock.clock import Clock

from .answers import Bound, Local, Meaning, interpret

if TYPE_CHECKING:
    from flexbt_console.link.simulator_link import SimulatorLink


@dataclass(frozen=True)
class Station:
    """A robot and the settings of its operator. ``timeout`` is the time-out of an answer, s; ``leaving`` describes
    the effect of quitting.

    ``page`` is the address of the page of the same robots, '' if it is not known. ``attention`` is shared by all robots
    of the operator. Without ``obstacles`` nobody can drop any.
    """

    mirror: Mirror
    link: RobotLink
    builder: CommandBuilder
    timeout: float
    attention: Attention
    leaving: str
    page: str = ''
    obstacles: SimulatorLink | None = None
    role: Role = Role.MAINTAINER

    def require(self, role: Role, what: str) -> None:
        """Raise RefusedError if the role of the user is less."""
        if self.role < role:
            raise RefusedError(f'{what} needs the role {role.name.lower()}; yours is {self.role.name.lower()}')

    def permit(self, spec: CommandSpec | None) -> None:
        """Raise RefusedError if the role of the user is less than that for a command; None stands for an answer."""
        if spec is None:
            self.require(Role.OPERATOR, 'an answer')
        else:
            self.require(role_for(spec), f'"{spec.name}"')

    def carry_out(self, meaning: Meaning, view: View) -> OperatorCommand | Reading | RobotRequest | None:
        """Execute the meaning, based on ``view``. Return the command that was sent, or the text to show.
        The caller handles leaving.

        Raises:
            ConsoleError: the requested data has not arrived.
        """
        line, spec = meaning.line, meaning.line.spec
        self.permit(spec)
        if meaning.command is not None:
            self.permit(None)
            command = self.attention.measured(meaning.command)
            self.link.send(command, self.timeout, meaning.label)
            return command
        if meaning.local is Local.HELP:
            text = prompt_command_help(spec) if spec.name else prompt_help(self.leaving)
            return Reading(None, text, title='help')
        if isinstance(spec.action, Show):
            return spec.action.show(line, view, self.mirror)._replace(title=spec.name)
        return RobotRequest(line, self.timeout, self.builder) if isinstance(spec.action, Ask) else None


class RobotRequest(NamedTuple):
    """A query to the robot. ``timeout`` is in seconds; a synthesis has its own time limit."""

    line: CommandLine
    timeout: float
    builder: CommandBuilder

    def ask(self, robot: RobotLink, tell: Callable[[str], None], left: Future[None] | None = None) -> Reading:
        """Ask the robot and wait; see :class:`Inquiry`. Not on the thread of a user interface.

        Raises:
            ConsoleError: there is no answer.
        """
        spec = self.line.spec
        assert isinstance(spec.action, Ask)

        def acknowledge(state: Path, things: Sequence[int]) -> list[str]:
            from flexbt_console.alerts import store  # what only this needs

            return store.acknowledge(state, things, self.builder.require_operator())

        reading = spec.action.ask(self.line, Inquiry(robot, self.timeout, tell, left, acknowledge))
        return reading._replace(title=spec.name, is_map=spec.action.is_map)


SOON_SECONDS: Final = 0.5
"""If a command is answered within this time, only the answer is reported."""

RESTARTED: Final = Line('the executive was restarted; the first line shows what runs now', Tone.WARNING)


@dataclass(frozen=True, slots=True)
class _Sent:
    mirror: Mirror
    given: float
    reported: tuple[CommandState, Confirmation | None] | None = None


class Session:
    """An operator at work, in any user interface: lines are carried out, and commands are followed to their answers.

    ``station`` is the robot of the moment. Commands to another one are followed, too, also after the time-out.
    """

    def __init__(self, station: Station, clock: Clock) -> None:
        self.station = station
        self._clock = clock
        self._sent: dict[str, _Sent] = {}
        self._executive = ''

    def turn_to(self, station: Station) -> None:
        """Continue with another robot, or with the same one at another time."""
        self.station, self._executive = station, ''

    def interpret(self, text: str, view: View, bound: Bound) -> Meaning:
        """Return what a line means. Raises what :func:`interpret` raises."""
        return interpret(text, view, self.station.builder, bound, self.station.permit)

    def carry_out(self, meaning: Meaning, view: View) -> OperatorCommand | Reading | RobotRequest | None:
        """Execute as :meth:`Station.carry_out`, and follow the command that was sent."""
        done = self.station.carry_out(meaning, view)
        if isinstance(done, OperatorCommand):
            self.follow(self.station.mirror, done.id)
        return done

    def follow(self, mirror: Mirror, command_id: str) -> None:
        """Follow a command that was sent to the robot of that mirror."""
        self._sent[command_id] = _Sent(mirror, self._clock.now())

    @property
    def is_waiting(self) -> bool:
        """True while a result of a command is still expected."""
        return bool(self._sent)

    def answers(self) -> list[list[str]]:
        """Return the lines of each command whose state has changed since the last call, in the order of sending."""
        answers = []
        for command_id, sent in list(self._sent.items()):
            tracked = sent.mirror.command(command_id)
            if tracked is None or (
                tracked.state in (CommandState.APPLIED, CommandState.REFUSED)
                and tracked.confirmed_by is not Confirmation.STOP_GUARD  # the executive may still confirm it
            ):
                del self._sent[command_id]
            elif (tracked.state, tracked.confirmed_by) == sent.reported or (
                tracked.state is CommandState.PENDING and self._clock.now() < sent.given + SOON_SECONDS
            ):
                continue
            else:
                self._sent[command_id] = replace(sent, reported=(tracked.state, tracked.confirmed_by))
            if tracked is not None:
                answers.append(command_result_lines(tracked))
        return answers

    def news(self, view: View) -> list[list[str]]:
        """Return what is new for an operator who sees the state: a restarted executive, and :meth:`answers`."""
        before, self._executive = self._executive, view.snapshot.executive_id if view.snapshot else self._executive
        restarted: list[list[str]] = [[RESTARTED]] if before not in ('', self._executive) else []
        return restarted + self.answers()


# # Why a decision has waited: its operator worked on another one, had not noticed it, or worked on it.
#
# The parts are those of the literature on how many robots one operator can serve (Cummings and Mitchell 2008,
# *Predicting controller capacity in supervisory control of multiple UAVs*): wait times by queues, by loss of situation
# awareness, and by interaction. An operator deals with a decision from the first key that is pressed while it is on the
# screen.

REMEMBERED: Final = 200
"""Maximum number of remembered periods of dealing with a decision."""


DecisionKey = tuple[str, str]
"""A decision among those of all robots: the identifier of its executive, and its own."""


class Attention:
    """The decision on which the operator works, and since when, by the pressed keys."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._seen: dict[DecisionKey, float] = {}
        self._spells: list[tuple[DecisionKey, float, float]] = []
        self._current: tuple[DecisionKey, float] | None = None

    def pending(self, views: Iterable[View]) -> None:
        """Note which decisions are pending now."""
        now = self._clock.now()
        waiting = [key for view in views for one in view.decisions if (key := _key(view, one.id)) is not None]
        self._seen = {one: self._seen.get(one, now) for one in waiting}

    def touched(self, view: View, decision_id: str | None) -> None:
        """Note a key that was pressed while this decision was on the screen; None for none."""
        key = _key(view, decision_id)
        if self._current is not None and self._current[0] == key:
            return
        self._close()
        self._current = (key, self._clock.now()) if key is not None else None

    def measured(self, command: OperatorCommand) -> OperatorCommand:
        """Return the command with the reason why the decision that it answers has waited, if it was observed here."""
        decision = (command.executive_id, command.decision_id)
        if decision not in self._seen:
            return command
        queue, interaction = self.answered(decision)
        return replace(command, wait_queue=queue, wait_interaction=interaction)

    def answered(self, decision: DecisionKey) -> tuple[float, float]:
        """Seconds in which the operator worked on others while this one waited, and on this one."""
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

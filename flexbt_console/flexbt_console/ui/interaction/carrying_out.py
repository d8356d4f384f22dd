# SPDX-License-Identifier: BSD-3-Clause
"""What an operator says is done: a command is sent, what is known is shown, the robot is asked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

from flexbt_console.commands import (
    Ask,
    AskedRobot,
    CommandBuilder,
    CommandedRobot,
    CommandLine,
    Show,
    prompt_command_help,
    prompt_help,
)
from flexbt_console.mirror import Command, Mirror, View

from .attention import Attention
from .short_form import Local, Meaning


@dataclass(frozen=True)
class Station:
    """A robot as its operator has it; ``timeout`` is in seconds, for each answer; ``leaving`` says what happens when
    its operator leaves.

    ``page`` is the address of the page of the same robots, '' where there is none known.
    ``attention`` is what its operator deals with: one for all robots of that operator.
    """

    mirror: Mirror
    link: CommandedRobot
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


Later = Callable[[AskedRobot, Callable[[str], None]], Reading]
"""Asks the robot, and waits: ``Station.timeout`` seconds at most, but for a synthesis, which has a time of its own and
tells lines meanwhile. Not on the thread of a user interface. Raises ConsoleError."""


def carry_out(meaning: Meaning, view: View, station: Station) -> Command | Reading | Later | None:
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
    title: str, action: Ask, line: CommandLine, timeout: float, robot: AskedRobot, tell: Callable[[str], None]
) -> Reading:
    return Reading(title, action.ask(line, robot, timeout, tell).text, action.is_map)

# SPDX-License-Identifier: BSD-3-Clause
"""The declaration of a command in the registry, a line in which it is written, and suggestions for its words."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from enum import Enum, IntEnum
from pathlib import Path
from typing import Any, Final, NamedTuple

from flexbt_console.errors import UsageError
from flexbt_console.link.robot_link import RobotLink
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import AutonomyLevel, CommandKind, DecisionKind, OperatorCommand
from flexbt_console.mirror.view import View
from flexbt_core.values.text import short_repr

from .command_builder import CommandBuilder


class Typed(NamedTuple):
    """The context of a completion: the words before it, without options, and what is known about the robot."""

    words: tuple[str, ...]
    view: View
    robots: tuple[str, ...] = ()


Values = Callable[[Typed], Iterable[str]]
"""The words that may stand for an argument or for the value of an option, the likely ones first."""

Read = Callable[[str], object]
"""A reader of a word; raises UsageError if the word is malformed."""


class Argument(NamedTuple):
    """A positional argument; a ``repeated`` one takes any number of words, at least one if ``required``.

    A ``spaced`` one is the first: its value is the text before the first word with ``=``, spaces included. One that is
    ``as_typed`` is the rest of a line at the prompt, quotes included.
    """

    name: str
    required: bool = True
    repeated: bool = False
    spaced: bool = False
    as_typed: bool = False
    values: Values | None = None
    read: Read | None = None

    @property
    def usage(self) -> str:
        """Usage of it, as in a usage line."""
        text = f'{self.name} ...' if self.repeated else self.name
        return text if self.required else f'[{text}]'


class Option(NamedTuple):
    """An option; ``value`` names its value, None for a switch. A ``repeated`` option may occur several times.

    ``in_prompt``: whether it is valid at the interactive prompt.
    """

    name: str
    help: str
    value: str | None = None
    repeated: bool = False
    in_prompt: bool = True
    values: Values | None = None
    read: Read | None = None

    @property
    def usage(self) -> str:
        """Usage of it, as in a usage line."""
        return self.name if self.value is None else f'{self.name} {self.value}'


class Role(IntEnum):
    """What a user may do: look; also start, answer, stop and the like; also override, debug and edit."""

    OBSERVER = 1
    OPERATOR = 2
    MAINTAINER = 3


class LinkNeed(Enum):
    """The need of a command for the link to the executive.

    NONE: it works without one. HEARD: an old picture is sufficient: it is shown as old, and at the prompt the command
    is sent anyway. LIVE: the picture has to be the present.
    """

    NONE = 'none'
    HEARD = 'heard'
    LIVE = 'live'


class Part(Enum):
    """A part of the view that arrives separately from the status, and that a command checks or shows."""

    BEHAVIORS = 'behaviors'
    PLACES = 'places'
    QUEUE = 'queue'
    STRUCTURE = 'structure'
    SUBJECTS = 'subjects'


class Answers(NamedTuple):
    """A command's way to answer a decision of one of the ``kinds``.

    ``names_its_own``: whether a line names the decision or state itself; any other is meant for the decision on the
    screen. With ``also_alone`` the command also works while no decision of this kind is pending.
    """

    kinds: frozenset[DecisionKind]
    names_its_own: Callable[[CommandLine, View], bool]
    also_alone: bool = False


class Send(NamedTuple):
    """A command that is sent to the executive. ``build`` binds it to what the view shows, or raises ConsoleError."""

    kinds: tuple[CommandKind, ...]
    build: Callable[[CommandLine, View, CommandBuilder], OperatorCommand]
    answers: Answers | None = None


class Reading(NamedTuple):
    """The answer of a command: the value for programs (JSON), and lines for people under a title.

    ``is_refusal``: the robot refused. ``is_map``: the lines are the map, which some interfaces show as an image.
    """

    value: Any
    text: list[str]
    is_refusal: bool = False
    title: str = ''
    is_map: bool = False


class Show(NamedTuple):
    """A command that shows what the console knows. It raises ConsoleError if that has not arrived.

    ``history`` reads data that arrive line by line; it is complete when no more arrive.
    """

    show: Callable[[CommandLine, View, Mirror], Reading]
    history: Callable[[Mirror], tuple[object, ...]] | None = None


class Inquiry(NamedTuple):
    """The robot to query, and the timeout of its answer, in seconds.

    A synthesis may take longer. It reports progress by ``tell``, and is canceled once ``left`` is done.
    ``acknowledge`` is that of :mod:`flexbt_console.alerts.store`, by the operator.
    """

    robot: RobotLink
    timeout: float
    tell: Callable[[str], None]
    left: Future[None] | None
    acknowledge: Callable[[Path, Sequence[int]], list[str]]


class Ask(NamedTuple):
    """A command that queries the robot and waits for its answer. Not on the executor thread.

    ``is_map``: it shows the map, which some interfaces show as an image.
    """

    ask: Callable[[CommandLine, Inquiry], Reading]
    is_map: bool = False


class Mode(Enum):
    """A command that is a mode of the console and runs until it is interrupted. In line mode only. DEFAULT: the screen
    or the prompt, for a line without a command."""

    WATCH = 'watch'
    PROMPT = 'prompt'
    SCREEN = 'screen'
    WEB = 'web'
    ROBOTS = 'robots'
    ALERTS = 'alerts'
    REPLAY = 'replay'
    INCIDENTS = 'incidents'
    USERS = 'users'
    RUN_TREE = 'run-tree'
    COMPLETION = 'completion'
    DEFAULT = ''


@dataclass(frozen=True, slots=True)
class CommandSpec:
    """The declaration of a command.

    Its syntax: ``name``, ``arguments``, ``options``, and ``check``, which finds errors of a line beyond those of its
    single words (UsageError). Its effect: ``action``. ``details`` are paragraphs of help. ``link`` is its need for
    the link; a mode handles that itself. ``needs`` are the parts of the view that it checks or shows.
    """

    name: str
    summary: str
    action: Send | Show | Ask | Mode
    arguments: tuple[Argument, ...] = ()
    options: tuple[Option, ...] = ()
    details: tuple[str, ...] = ()
    link: LinkNeed = LinkNeed.LIVE
    needs: tuple[Part, ...] = ()
    check: Callable[[CommandLine], None] | None = None

    def has_arrived(self, view: View) -> bool:
        """Return whether the view has all that the command needs."""
        is_known = {
            Part.BEHAVIORS: view.behaviors is not None,
            Part.PLACES: view.has_places,
            Part.QUEUE: view.queue is not None,
            Part.STRUCTURE: view.structure is not None or view.snapshot is None or not view.snapshot.run_id,
            Part.SUBJECTS: not any(view.lacks(decision) for decision in view.decisions),
        }
        return all(is_known[part] for part in self.needs)

    @property
    def in_prompt(self) -> bool:
        """True if the interactive prompt has it too."""
        return not isinstance(self.action, Mode)

    @property
    def usage(self) -> str:
        """Usage without the options that every command has."""
        return self._usage(self.options)

    @property
    def prompt_usage(self) -> str:
        """Usage at the interactive prompt."""
        return self._usage(self.prompt_options)

    @property
    def prompt_options(self) -> tuple[Option, ...]:
        """The options that mean something at the interactive prompt."""
        return tuple(option for option in self.options if option.in_prompt)

    def _usage(self, options: tuple[Option, ...]) -> str:
        shown = [f'[{option.usage}]{"..." if option.repeated else ""}' for option in options]
        return ' '.join([self.name, *(argument.usage for argument in self.arguments), *shown])

    @property
    def is_spaced(self) -> bool:
        """True if the first argument may be written with spaces."""
        return bool(self.arguments) and self.arguments[0].spaced

    def joined(self, words: Sequence[str]) -> tuple[str, ...]:
        """Return the words of a line, one for each argument, also for one that is written with spaces."""
        if not self.is_spaced:
            return tuple(words)
        first = next((index for index, word in enumerate(words) if '=' in word), len(words))
        return (*[' '.join(words[:first])][: bool(first)], *words[first:])

    def arguments_at(self, index: int) -> list[Argument]:
        """Return the arguments that the word of that index may be, the last of them first."""
        found: list[Argument] = []
        required = 0
        for place, argument in enumerate(self.arguments):
            if required <= index and (index <= place or argument.repeated):
                found.insert(0, argument)
            required += argument.required
        return found


NO_COMMAND: Final = CommandSpec('', '', Mode.DEFAULT)
"""The command of a line that names none."""

DECISION: Final = '--decision'
"""The option by which a line names the decision that it answers."""

UNSEEN: Final = '--unseen'
"""The option by which a line answers a decision though what that is about has not arrived."""


@dataclass(frozen=True, slots=True)
class CommandLine:
    """A command with its words. ``ros_arguments`` are those for ROS, ``--ros-args`` included."""

    spec: CommandSpec = NO_COMMAND
    words: tuple[str, ...] = ()
    options: dict[str, list[str]] = field(default_factory=dict)
    ros_arguments: tuple[str, ...] = ()

    def has(self, name: str) -> bool:
        """Return whether the option was given."""
        return name in self.options

    def value(self, name: str) -> str:
        """Return the value of an option, the last one when it was given again; empty when it was not given."""
        values = self.options.get(name)
        return values[-1] if values else ''

    def values(self, name: str) -> list[str]:
        """Return all values of a repeated option."""
        return self.options.get(name, [])

    def seconds(self, name: str) -> float | None:
        """Return the value of an option in seconds; None when it was not given. Raises UsageError as
        :func:`seconds`."""
        return seconds(self.value(name)) if self.has(name) else None

    @property
    def first_word(self) -> str:
        """The first word after the command; empty when there is none."""
        return self.words[0] if self.words else ''

    @property
    def text(self) -> str:
        """The words after the command as one text."""
        return ' '.join(self.words)

    def bound_to(self, decision_id: str) -> CommandLine:
        """Return the line with the identifier of the decision that it answers."""
        return replace(self, options={**self.options, DECISION: [decision_id]})


def seconds(text: str) -> float:
    """Read a number of seconds.

    Raises:
        UsageError: it is not a number above 0.
    """
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0.0 < number < math.inf:
        raise UsageError(f'{short_repr(text)}: expected a number of seconds above 0')
    return number


# The possible words of a line for the current robot; for completion.


def levels(typed: Typed) -> Iterable[str]:
    return (level.name.lower() for level in AutonomyLevel)


def behaviors(typed: Typed) -> Iterable[str]:
    """Return the behaviors. Those that cannot be loaded come last: starting one reports the reason."""
    return (one.name for one in sorted(typed.view.behaviors or (), key=lambda one: bool(one.error)))


def parameters(typed: Typed) -> Iterable[str]:
    chosen = (behavior for behavior in typed.view.behaviors or () if typed.words[:1] == (behavior.name,))
    return (f'{parameter.name}=' for behavior in chosen for parameter in behavior.parameters)


def states(typed: Typed) -> Iterable[str]:
    view = typed.view
    return (state.path for state in view.structure.states) if view.structure else view.active_levels


def active_states(typed: Typed) -> Iterable[str]:
    return typed.view.active_levels


def locked(typed: Typed) -> Iterable[str]:
    return typed.view.snapshot.locked if typed.view.snapshot else ()


def breakpoints(typed: Typed) -> Iterable[str]:
    snapshot = typed.view.snapshot
    return (*snapshot.breakpoints, *snapshot.step.split(' ')[1:]) if snapshot else ()


def queue_entries(typed: Typed) -> Iterable[str]:
    """Return the numbers of the entries of the mission queue."""
    return (str(entry.number) for entry in typed.view.queue.entries) if typed.view.queue else ()


def tree_nodes(typed: Typed) -> Iterable[str]:
    """Return the paths of the nodes of the trees that run, as far as they are known."""
    return (node.path for run in typed.view.running_trees for node in run.nodes)


def tree_points(typed: Typed) -> Iterable[str]:
    """Return the nodes at which something is set."""
    return (point.path for point in typed.view.snapshot.tree_breakpoints) if typed.view.snapshot else ()


def tree_runs(typed: Typed) -> Iterable[str]:
    """Return the runs of trees that are known."""
    holds = typed.view.snapshot.tree_holds if typed.view.snapshot else ()
    return (*(hold.run_id for hold in holds), *(run.run_id for run in typed.view.running_trees))


def results(typed: Typed) -> Iterable[str]:
    return ('SUCCESS', 'FAILURE')


def outcomes(typed: Typed) -> Iterable[str]:
    view = typed.view
    if typed.words:
        return view.outcomes(typed.words[0])
    waiting = view.decision.outcomes if view.decision else ()
    return (*waiting, *(view.outcomes(view.active_paths[0]) if len(view.active_paths) == 1 else ()))


def decisions(typed: Typed) -> Iterable[str]:
    return (decision.id for decision in typed.view.decisions)


def input_requests(typed: Typed) -> Iterable[str]:
    return (decision.id for decision in typed.view.decisions if decision.kind is DecisionKind.INPUT)


def requesters(typed: Typed) -> Iterable[str]:
    return typed.view.snapshot.authority_requests if typed.view.snapshot else ()


def userdata_paths(typed: Typed) -> Iterable[str]:
    structure = typed.view.structure
    return (state.path for state in structure.states if state.children) if structure else ()


def robot_names(typed: Typed) -> Iterable[str]:
    """Return the namespaces of the robots of the domain."""
    return typed.robots


def short_answers(typed: Typed) -> Iterable[str]:
    """Return the short inputs that need no command: the choices of the oldest decision, or the places."""
    decision = typed.view.decision
    if decision is None:
        return ()
    return decision.choices or (sorted(typed.view.places) if decision.wants_pose else ())

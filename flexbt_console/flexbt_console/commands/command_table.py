# SPDX-License-Identifier: BSD-3-Clause
"""The console's commands: the single source for parsing, help, completion and documentation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Argument:
    """A positional argument; a ``repeated`` one takes any number of words, at least one when ``required``."""

    name: str
    required: bool = True
    repeated: bool = False

    @property
    def usage(self) -> str:
        """As written in a usage line."""
        text = f'{self.name} ...' if self.repeated else self.name
        return text if self.required else f'[{text}]'


@dataclass(frozen=True, slots=True)
class Option:
    """An option; ``value`` is what follows it, None for a switch. A ``repeated`` one may be given again.

    ``in_prompt`` tells whether it means something at the interactive prompt.
    """

    name: str
    help: str
    value: str | None = None
    repeated: bool = False
    in_prompt: bool = True

    @property
    def usage(self) -> str:
        """As written in a usage line."""
        return self.name if self.value is None else f'{self.name} {self.value}'


@dataclass(frozen=True, slots=True)
class CommandSpec:
    """A command: how it is written, and what it does. ``details`` are paragraphs of help.

    ``in_prompt`` tells whether the interactive prompt has it too.
    """

    name: str
    summary: str
    arguments: tuple[Argument, ...] = ()
    options: tuple[Option, ...] = ()
    details: tuple[str, ...] = ()
    in_prompt: bool = True

    @property
    def usage(self) -> str:
        """How it is written, without the options that every command has."""
        return self._usage(self.options)

    @property
    def prompt_usage(self) -> str:
        """How it is written at the interactive prompt."""
        return self._usage(tuple(option for option in self.options if option.in_prompt))

    def _usage(self, options: tuple[Option, ...]) -> str:
        shown = [f'[{option.usage}]{"..." if option.repeated else ""}' for option in options]
        return ' '.join([self.name, *(argument.usage for argument in self.arguments), *shown])


JSON: Final = Option('--json', 'print JSON for programs: one object, or one a line for watch')
TIMEOUT: Final = Option('--timeout', 'how long to wait for the executive and its answer (default 5)', 'SECONDS')
OPERATOR: Final = Option('--operator', 'who gives the command (default: FLEXBT_OPERATOR, or user@host)', 'NAME')
NAMESPACE: Final = Option('--namespace', 'namespace of the robot, as --ros-args -r __ns:=NAME', 'NAME')
PLACES: Final = Option(
    '--places',
    'YAML file of named places (default: FLEXBT_PLACES, or the parameter "places" of the node)',
    'FILE',
)
HELP: Final = Option('--help', 'show this help')
COMMON_OPTIONS: Final = (JSON, TIMEOUT, OPERATOR, NAMESPACE, PLACES, HELP)
"""Options of every command."""

_REASON = Option('--reason', 'why, for the record', 'TEXT')
_DECISION = Option('--decision', 'the question that is meant; refused when it is not pending any more', 'ID')
_WAIT = Option('--wait', 'wait until the run has ended', in_prompt=False)
_WAIT_TIMEOUT = Option('--wait-timeout', 'end the waiting after so long (exit code 4)', 'SECONDS', in_prompt=False)

_VALUE_DETAILS: Final = (
    'VALUE is written as the wanted type: JSON or YAML; a text needs no quotes of its own. A pose is a named place, '
    'or "x y yaw" in metres and radians in the frame "map"; several poses are separated by ";". Its stamp is 0, '
    'which means now. Words that begin with "-" and are no numbers go after "--".',
)

COMMANDS: Final = (
    CommandSpec('status', 'show what runs, what waits for the operator, and how old that knowledge is'),
    CommandSpec(
        'watch',
        'print every change until it is interrupted, or for --timeout seconds',
        details=(
            'It goes on when the link is lost, and says so. With --json each line is an object with "event": status, '
            'structure, behaviors, log or link.',
        ),
        in_prompt=False,
    ),
    CommandSpec('behaviors', 'list the behaviors that can be started, with their parameters'),
    CommandSpec('structure', 'show the state machine that runs: states, outcomes, targets, required autonomy'),
    CommandSpec(
        'userdata',
        'show what the states of the run have handed to each other',
        (Argument('PATH', required=False), Argument('KEY', required=False, repeated=True)),
        details=(
            'The values of every active machine, by the names of their keys in it; of the machine PATH only, "/" for '
            'the outermost, and of the KEYs only, when these are given. It is read between two steps of the run.',
        ),
        in_prompt=False,
    ),
    CommandSpec(
        'log',
        'show the latest lines of the log',
        (Argument('COUNT', required=False),),
        details=('COUNT lines at most, 20 when it is left out.',),
    ),
    CommandSpec(
        'start',
        'start a behavior',
        (Argument('NAME'), Argument('PARAMETER=VALUE', required=False, repeated=True)),
        (
            Option('--autonomy', 'off, low, high, full or 0 to 3 (default low)', 'LEVEL'),
            Option('--input', 'input userdata of the behavior', 'KEY=TYPE:VALUE', repeated=True),
            _WAIT,
            _WAIT_TIMEOUT,
        ),
        details=(
            'With --wait the exit code is 0 when the run ended by an outcome of its own, and 3 when it was stopped '
            'or ended by a fault.',
        ),
    ),
    CommandSpec('stop', 'stop the run and bring the robot to rest', options=(_REASON, _WAIT, _WAIT_TIMEOUT)),
    CommandSpec(
        'autonomy',
        'set how much the robot decides alone',
        (Argument('LEVEL'), Argument('PATH', required=False)),
        details=(
            'PATH is a state or container: the level holds for it and what is in it. Without PATH: for everything.',
            'LEVEL is off, low, high, full or 0 to 3. A transition happens without the operator when it requires '
            'less than LEVEL.',
        ),
    ),
    CommandSpec(
        'confirm',
        'let the transition happen that waits for the operator',
        (Argument('ID', required=False),),
        (_REASON,),
        details=('Without ID: the only pending question; when there are several, they are listed.',),
    ),
    CommandSpec(
        'force',
        "leave a state by an outcome of the operator's choice",
        (Argument('PATH', required=False), Argument('OUTCOME')),
        (_DECISION, _REASON),
        details=(
            'PATH is a state or container, in full or its last labels when they are unique. Without PATH: the state '
            'that waits for the operator, or else the only active state.',
        ),
    ),
    CommandSpec(
        'input',
        'answer a question for a value',
        (Argument('ID', required=False), Argument('VALUE', required=False, repeated=True)),
        (_DECISION, Option('--decline', 'decline to answer'), _REASON),
        details=('Without ID: the only pending question for a value.', *_VALUE_DETAILS),
    ),
    CommandSpec(
        'decline',
        'decline to answer a question for a value',
        (Argument('ID', required=False),),
        (_REASON,),
    ),
    CommandSpec(
        'pause',
        'let the run stand still',
        options=(_REASON,),
        details=(
            'No state is executed or left, and time does not pass for them, until "resume". "stop" works as ever.',
        ),
    ),
    CommandSpec(
        'resume',
        'go on with a paused run, or with one that the end of the executive interrupted',
        options=(_REASON,),
        details=(
            'After a crash of the executive the states that were active are entered again. "abort" gives the run up.',
        ),
    ),
    CommandSpec('abort', 'give up a run that the end of the executive interrupted', options=(_REASON,)),
    CommandSpec(
        'repeat',
        'leave a state and enter it again',
        (Argument('PATH', required=False),),
        (_REASON,),
        details=('Without PATH: the state that waits for the operator, or else the only active state.',),
    ),
    CommandSpec(
        'lock',
        'keep a state or container from being left',
        (Argument('PATH'),),
        (_REASON,),
        details=('PATH is a state or container, in full or its last labels when they are unique.',),
    ),
    CommandSpec('unlock', 'undo lock', (Argument('PATH'),), (_REASON,)),
    CommandSpec(
        'breakpoint',
        'let every transition out of a state wait for the operator, whatever the autonomy',
        (Argument('PATH'),),
        (_REASON,),
        details=('PATH is a state or container, in full or its last labels when they are unique.',),
    ),
    CommandSpec('clear', 'clear a breakpoint', (Argument('PATH'),), (_REASON,)),
    CommandSpec(
        'switch',
        'go on with another behavior, keeping the active states',
        (Argument('NAME'), Argument('PARAMETER=VALUE', required=False, repeated=True)),
        (_REASON,),
        details=(
            'The other behavior has to have the active states at the same paths; the refusal names those it lacks.',
        ),
    ),
    CommandSpec(
        'claim',
        'claim the authority to command',
        options=(_REASON,),
        details=(
            'While nobody has the authority, every operator may command. When another operator has it, this asks for '
            'it; "status" shows who has it. It is lost when its holder was gone for the time that the executive sets. '
            '"stop" needs no authority.',
        ),
    ),
    CommandSpec('release', 'give the authority back, or do not ask for it any more', options=(_REASON,)),
    CommandSpec(
        'handover',
        'give the authority to another operator',
        (Argument('OPERATOR', required=False),),
        (_REASON,),
        details=('Without OPERATOR: to the one who asks for it.',),
    ),
    CommandSpec('places', 'list the named places'),
    CommandSpec('prompt', 'the interactive console, also without any command in a terminal', in_prompt=False),
)

EXIT_CODES: Final = (
    ('0', 'applied; the question was answered'),
    ('1', 'a fault of the console itself'),
    ('2', 'wrong usage; nothing was sent'),
    ('3', 'refused, by the executive or before it was sent; the reason is printed'),
    ('4', 'no answer in time; whether it had an effect is not known'),
    ('5', 'no link: no executive is heard'),
    ('130', 'interrupted while waiting (watch and the prompt end with 0)'),
)


def find(name: str) -> CommandSpec | None:
    """The command of that name."""
    return next((spec for spec in COMMANDS if spec.name == name), None)

# SPDX-License-Identifier: BSD-3-Clause
"""The registry of commands: what the console parses, helps with, completes, builds, shows and documents.

A new command is one entry of :data:`COMMANDS` here, one handler on the robot (``flexbt_onboard.commands``), and its
effect in the engine; ``docs/tools/make_console.py`` writes its documentation.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from flexbt_console.mirror.records import LIVENESS, NOTE_LENGTH, SYNTHESIS_SECONDS, CommandKind, OperatorCommand
from flexbt_console.mirror.view import View

from . import effects, spec
from .command_builder import CommandBuilder
from .operator_values import (
    SHELLS,
    assignment,
    autonomy_level,
    line_count,
    liveness,
    map_size,
    port_number,
    retry_count,
    shell_name,
)
from .spec import DECISION, UNSEEN, Argument, Ask, CommandLine, CommandSpec, LinkNeed, Mode, Option, Send, Show, seconds

# What has to have arrived


def _behaviors_known(view: View) -> bool:
    return view.behaviors is not None


def _places_known(view: View) -> bool:
    return view.has_places


def _subjects_known(view: View) -> bool:
    return not any(view.lacks(decision) for decision in view.decisions)


def _all_to_force_known(view: View) -> bool:
    return _structure_known(view) and _subjects_known(view)


def _all_to_answer_known(view: View) -> bool:
    return _places_known(view) and _subjects_known(view)


def _all_for_a_start_known(view: View) -> bool:
    return _behaviors_known(view) and _places_known(view)


def _structure_known(view: View) -> bool:
    return view.structure is not None or view.snapshot is None or not view.snapshot.run_id


# The commands

_REASON = Option('--reason', 'why, for the event log', 'TEXT')
_DECISION = Option(
    DECISION, 'the decision that is meant; refused when it is not pending any more', 'ID', values=spec.decisions
)
_UNSEEN = Option(UNSEEN, 'answer although what you are asked about (a path, a value) was not received')
_UNSEEN_MACHINE = Option(UNSEEN, 'send it although the behavior was synthesized, and its machine was not received')
_LEAVING = Option('--leaving', 'what it tells of "quit" (default: the robot goes on), for who starts it', 'TEXT')
_PAGE = Option('--page', 'address of the page of the same robots, which it shows, for who starts both', 'URL')
_PORT = Option('--port', 'port of the page (default 8465; 0 takes a free one)', 'NUMBER', read=port_number)
_ADDRESS = Option(
    '--address', 'address to listen at (default 127.0.0.1: this computer only; beyond it a token is needed)', 'IP'
)
_SCAN_PERIOD = Option(
    '--scan-period',
    f'from one scan of the lidar on the map to the next (default {effects.SCAN_PERIOD:g})',
    'SECONDS',
    read=seconds,
)
_SLOW_LINK = Option('--slow-link', 'show no scan: it and the transforms are most of what comes over the link')
_ROBOT = Option(
    '--robot',
    'namespace of a robot (default: every robot that is found)',
    'NAME',
    repeated=True,
    values=spec.robot_names,
)
_WAIT = Option('--wait', 'wait until the run has ended', in_prompt=False)
_WAIT_TIMEOUT = Option(
    '--wait-timeout', 'end the waiting after so long (exit code 4)', 'SECONDS', in_prompt=False, read=seconds
)
_PATH_DETAILS: Final = 'PATH is a state or container, in full or its last labels when they are unique.'
_VALUE_DETAILS: Final = (
    'VALUE is written as the wanted type: JSON or YAML; a text needs no quotes of its own. A pose is a named place, '
    'or "x y yaw" in metres and radians in the frame "map"; several poses are separated by ";". Its stamp is 0, '
    'which means now. Words that begin with "-" and are no numbers go after "--".',
)

COMMANDS: Final = (
    CommandSpec(
        'status',
        'show what runs, what waits for the operator, and how old that knowledge is',
        Show(effects.status),
        link=LinkNeed.HEARD,
        has_arrived=_subjects_known,
    ),
    CommandSpec(
        'watch',
        'print every change until it is interrupted, or for --timeout seconds',
        Mode.WATCH,
        details=(
            'It goes on when the link is lost, and says so. With --jsonl each line is an object with "event": status, '
            'structure, behaviors, log or link.',
        ),
        options=(Option('--jsonl', 'print JSON for programs, one object a line, as --json'),),
        link=LinkNeed.NONE,
    ),
    CommandSpec(
        'behaviors',
        'list the behaviors that can be started, with their parameters',
        Show(effects.behaviors),
        (Argument('NAME', required=False, spaced=True, values=spec.behaviors),),
        details=('Of NAME alone, also the machine when it was synthesized. JSON has all machines.',),
        has_arrived=_behaviors_known,
    ),
    CommandSpec(
        'structure',
        'show the state machine that runs: states, outcomes, targets, required autonomy',
        Show(effects.structure),
        has_arrived=_structure_known,
    ),
    CommandSpec(
        'tree',
        'show the trees that run, or the latest: each node with its status, and what has failed by what',
        Ask(effects.tree),
        details=(
            'A node that was halted shows how it had ended before. Behind the nodes stands each that has failed by '
            'itself, with those above it that have failed by it.',
        ),
    ),
    CommandSpec(
        'map',
        'show the map: walls, places, the plan, and where the robot is',
        Ask(effects.map_of_robot, is_map=True),
        options=(
            Option('--png', 'write an image into this file instead', 'FILE', in_prompt=False),
            Option(
                '--size', 'cells of the terminal (default: as many as there is room for)', 'COLUMNSxROWS', read=map_size
            ),
            Option('--scan', 'with what the lidar meets now', in_prompt=False),
        ),
        details=('As JSON: where the map lies, the robot, the plan, the places and the scan, in metres.',),
    ),
    CommandSpec(
        'userdata',
        'show what the states of the run have handed to each other',
        Ask(effects.userdata),
        (Argument('PATH', required=False, values=spec.userdata_paths), Argument('KEY', required=False, repeated=True)),
        details=(
            'The values of every active machine, by the names of their keys in it; of the machine PATH only, "/" for '
            'the outermost, and of the KEYs only, when these are given. It is read between two steps of the run.',
        ),
    ),
    CommandSpec(
        'log',
        'show the latest lines of the log',
        Show(effects.log),
        (Argument('COUNT', required=False, read=line_count),),
        details=(f'COUNT lines at most, {effects.LOG_COUNT} when it is left out.',),
    ),
    CommandSpec(
        'events',
        'show the latest transitions, and the commands of all operators',
        Show(effects.events),
        (Argument('COUNT', required=False, read=line_count),),
        details=(f'COUNT of them at most, {effects.LOG_COUNT} when it is left out.',),
    ),
    CommandSpec(
        'start',
        'start a behavior',
        effects.START,
        (
            Argument('NAME', spaced=True, values=spec.behaviors),
            Argument('PARAMETER=VALUE', required=False, repeated=True, values=spec.parameters, read=assignment),
        ),
        (
            Option(
                '--autonomy',
                'off, low, high, full or 0 to 3 (default: as it is shown)',
                'LEVEL',
                values=spec.levels,
                read=autonomy_level,
            ),
            Option('--input', 'input userdata of the behavior', 'KEY=TYPE:VALUE', repeated=True),
            _UNSEEN_MACHINE,
            _REASON,
            _WAIT,
            _WAIT_TIMEOUT,
        ),
        details=(
            'NAME may have spaces: it ends before the first PARAMETER=VALUE.',
            'With --wait the exit code is 0 when the run ended by an outcome of its own, and 3 when it was stopped '
            'or ended by a fault.',
        ),
        has_arrived=_all_for_a_start_known,
    ),
    CommandSpec(
        'stop',
        'stop the run and bring the robot to rest',
        effects.alone(CommandKind.STOP),
        options=(_REASON, _WAIT, _WAIT_TIMEOUT),
        link=LinkNeed.HEARD,
    ),
    CommandSpec(
        'autonomy',
        'set how much the robot decides alone',
        effects.AUTONOMY,
        (
            Argument('LEVEL', values=spec.levels, read=autonomy_level),
            Argument('PATH', required=False, values=spec.states),
        ),
        (_REASON,),
        details=(
            'PATH is a state or container: the level holds for it and what is in it. Without PATH: for everything.',
            'LEVEL is off, low, high, full or 0 to 3. A transition happens without the operator when it requires '
            'less than LEVEL.',
        ),
        has_arrived=_structure_known,
    ),
    CommandSpec(
        'confirm',
        'let the transition happen that waits for the operator',
        effects.CONFIRM,
        (Argument('ID', required=False, values=spec.decisions),),
        (_UNSEEN, _REASON),
        details=('Without ID: the only pending decision; when there are several, they are listed.',),
        has_arrived=_subjects_known,
    ),
    CommandSpec(
        'force',
        "leave a state by an outcome of the operator's choice",
        effects.FORCE,
        (Argument('PATH', required=False, values=spec.active_states), Argument('OUTCOME', values=spec.outcomes)),
        (_DECISION, _UNSEEN, _REASON),
        details=(
            f'{_PATH_DETAILS} Without PATH: the state that waits for the operator, or else the only active state.',
        ),
        has_arrived=_all_to_force_known,
    ),
    CommandSpec(
        'input',
        'answer an input request by a value',
        effects.INPUT,
        (
            Argument('ID', required=False, values=spec.input_requests),
            Argument('VALUE', required=False, repeated=True, values=spec.short_answers),
        ),
        (_DECISION, Option('--decline', 'decline to answer'), _UNSEEN, _REASON),
        details=('Without ID: the only pending input request.', *_VALUE_DETAILS),
        has_arrived=_all_to_answer_known,
        check=effects.check_input,
    ),
    CommandSpec(
        'decline',
        'decline to answer an input request',
        effects.DECLINE,
        (Argument('ID', required=False, values=spec.input_requests),),
        (_REASON,),
    ),
    CommandSpec(
        'pause',
        'let the run stand still',
        effects.alone(CommandKind.PAUSE),
        options=(_REASON,),
        details=(
            'No state is executed or left, and time does not pass for them, until "resume". "stop" works as ever.',
        ),
    ),
    CommandSpec(
        'resume',
        'go on with a paused run, or with one that the end of the executive interrupted',
        effects.RESUME,
        options=(_REASON,),
        details=(
            'After a crash of the executive the states that were active are entered again. "abort" gives the run up.',
        ),
    ),
    CommandSpec(
        'abort',
        'give up a run that the end of the executive interrupted',
        effects.alone(CommandKind.ABORT_RUN),
        options=(_REASON,),
    ),
    CommandSpec(
        'repeat',
        'leave a state and enter it again',
        effects.REPEAT,
        (Argument('PATH', required=False, values=spec.active_states),),
        (_REASON,),
        details=('Without PATH: the state that waits for the operator, or else the only active state.',),
        has_arrived=_structure_known,
    ),
    CommandSpec(
        'lock',
        'keep a state or container from being left',
        effects.at_path(CommandKind.LOCK),
        (Argument('PATH', values=spec.states),),
        (_REASON,),
        details=(_PATH_DETAILS,),
        has_arrived=_structure_known,
    ),
    CommandSpec(
        'unlock',
        'undo lock',
        effects.at_path(CommandKind.UNLOCK),
        (Argument('PATH', values=spec.locked),),
        (_REASON,),
        has_arrived=_structure_known,
    ),
    CommandSpec(
        'breakpoint',
        'let every transition out of a state wait for the operator, whatever the autonomy',
        effects.at_path(CommandKind.BREAKPOINT),
        (Argument('PATH', values=spec.states),),
        (_REASON,),
        details=(_PATH_DETAILS,),
        has_arrived=_structure_known,
    ),
    CommandSpec(
        'clear',
        'clear a breakpoint',
        effects.at_path(CommandKind.CLEAR_BREAKPOINT),
        (Argument('PATH', values=spec.breakpoints),),
        (_REASON,),
        has_arrived=_structure_known,
    ),
    CommandSpec(
        'switch',
        'go on with another behavior, keeping the active states',
        effects.SWITCH,
        (
            Argument('NAME', spaced=True, values=spec.behaviors),
            Argument('PARAMETER=VALUE', required=False, repeated=True, values=spec.parameters, read=assignment),
        ),
        (_UNSEEN_MACHINE, _REASON),
        details=(
            'The other behavior has to have the active states at the same paths; the refusal names those it lacks.',
        ),
        has_arrived=_behaviors_known,
    ),
    CommandSpec(
        'synthesize',
        'have a behavior made of capabilities that reaches goals whatever fails, or be told why there is none',
        Ask(effects.synthesis),
        (Argument('SYSTEM', required=False),),
        (
            Option('--goal', 'what is to hold (all of them)', 'FORMULA', repeated=True),
            Option('--initial', 'what holds at the start', 'FORMULA', repeated=True),
            Option('--outcome', 'outcome of the machine', 'NAME', repeated=True),
            Option('--retries', 'a state is repeated so often, then it is given up', 'N', read=retry_count),
            Option(
                '--liveness',
                'fair, adversarial or fair-outcomes: what is assumed about failures (default fair)',
                'WHAT',
                values=lambda typed: LIVENESS,
                read=liveness,
            ),
            Option('--name', "name of the behavior (default: the system's)", 'NAME'),
            Option('--spec', 'file on the robot of more variables and formulas', 'FILE'),
            Option('--file', 'capability file (YAML) of this computer, in place of SYSTEM', 'FILE', in_prompt=False),
            Option(
                '--time-limit', f'end the search after so long (default {SYNTHESIS_SECONDS:g})', 'SECONDS', read=seconds
            ),
            Option('--cancel', 'end the synthesis that is under way, whoever asked for it'),
        ),
        details=(
            "SYSTEM is a capability file of the robot: a name in the executive's capability_directories, or "
            'package/path.yaml. A FORMULA with blanks is one word in quotes.',
            'The machine is shown, and becomes a behavior of the robot, which "start" and "switch" take; nothing is '
            'started by this, and what runs goes on. Where no machine can do that, the answer is why, and the exit '
            'code 3. In line mode Ctrl-C cancels it.',
        ),
        check=effects.check_synthesis,
    ),
    CommandSpec(
        'claim',
        'claim the authority to command',
        effects.alone(CommandKind.CLAIM_AUTHORITY),
        options=(_REASON,),
        details=(
            'While nobody has the authority, every operator may command. When another operator has it, this asks for '
            'it; "status" shows who has it. It is lost when its holder was gone for the time that the executive sets. '
            '"stop" needs no authority.',
        ),
    ),
    CommandSpec(
        'release',
        'give the authority back, or do not ask for it any more',
        effects.alone(CommandKind.RELEASE_AUTHORITY),
        options=(_REASON,),
    ),
    CommandSpec(
        'handover',
        'give the authority to another operator',
        effects.to_requester(CommandKind.HAND_OVER_AUTHORITY),
        (Argument('OPERATOR', required=False, values=spec.requesters),),
        (_REASON,),
        details=('Without OPERATOR: to the one who asks for it.',),
    ),
    CommandSpec(
        'refuse',
        'keep the authority, and take who asks for it from the list',
        effects.to_requester(CommandKind.REFUSE_AUTHORITY),
        (Argument('OPERATOR', required=False, values=spec.requesters),),
        (_REASON,),
        details=('Without OPERATOR: the one who asks for it, who may ask again.',),
    ),
    CommandSpec(
        'note',
        'write a remark into the event log and the log of every console',
        effects.NOTE,
        (Argument('TEXT', repeated=True),),
        details=(
            f'TEXT is what comes after "note", {NOTE_LENGTH} characters at most. It becomes part of the report of the '
            'run, and of its recording. It needs neither a run nor the authority.',
        ),
        check=effects.check_note,
    ),
    CommandSpec(
        'places',
        'list the named places: those of the robot, and those of --places',
        Show(effects.places),
        link=LinkNeed.NONE,
        has_arrived=_places_known,
    ),
    CommandSpec(
        'robots',
        'list the robots of the domain, the most urgent first, and how long each has waited',
        Mode.ROBOTS,
        link=LinkNeed.NONE,
    ),
    CommandSpec(
        'screen',
        'the whole screen, also without any command: machine, trees, map, decisions and log, one key for each command',
        Mode.SCREEN,
        options=(_LEAVING, _PAGE, _SCAN_PERIOD, _SLOW_LINK),
        link=LinkNeed.NONE,
    ),
    CommandSpec(
        'web',
        'the page for a browser: machine, trees and map as pictures, decisions, commands and log',
        Mode.WEB,
        options=(_ROBOT, _PORT, _ADDRESS, _SCAN_PERIOD, _SLOW_LINK),
        details=(
            'It prints the address of the page, and serves it until it is interrupted. The page has a line for each '
            'robot that is found, those that wait first, and ?robot=NAME opens one of them.',
            'At an address beyond this '
            'computer the page needs the token that is part of the printed address; FLEXBT_WEB_TOKEN sets it, and '
            'then it is needed on this computer, too. Nothing is encrypted: for an open network, use a tunnel '
            '(ssh -L 8465:localhost:8465 STATION).',
        ),
        link=LinkNeed.NONE,
    ),
    CommandSpec(
        'replay',
        'show a recording on the screen: time line, step, search, speed',
        Mode.REPLAY,
        (Argument('FILE'),),
        link=LinkNeed.NONE,
        details=('Nothing is published; the executable `replay` publishes a recording for other consoles.',),
    ),
    CommandSpec(
        'completion',
        'print what makes Tab complete the words of console in a shell',
        Mode.COMPLETION,
        (Argument('SHELL', values=lambda typed: SHELLS, read=shell_name),),
        (Option('--line', 'print the words that the last one of this line may become, as the shell asks', 'TEXT'),),
        details=(
            'In bash: . <(console completion bash); in zsh: . <(console completion zsh); in ~/.bashrc or ~/.zshrc for '
            'every shell. Names of behaviors, states, decisions and robots are asked of the robot, for 1.5 s at most.',
        ),
        link=LinkNeed.NONE,
    ),
    CommandSpec(
        'prompt',
        'the interactive prompt, also without any command where there is no room for the screen, or Textual is missing',
        Mode.PROMPT,
        options=(_LEAVING, _PAGE),
        link=LinkNeed.NONE,
    ),
)


def find(name: str) -> CommandSpec | None:
    """Return the command of that name."""
    return next((spec for spec in COMMANDS if spec.name == name), None)


def build(line: CommandLine, view: View, make: CommandBuilder) -> OperatorCommand:
    """Make the command for the executive that the line asks for, bound to what ``view`` shows.

    Raises:
        UsageError: it is not written as it has to be.
        RefusedError: it cannot work now.
    """
    assert line.spec is not None and isinstance(line.spec.action, Send)
    command = line.spec.action.build(line, view, make)
    return replace(command, reason=line.value(_REASON.name))

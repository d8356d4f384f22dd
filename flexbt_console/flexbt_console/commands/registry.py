# SPDX-License-Identifier: BSD-3-Clause
"""The registry of commands. Parser, help, completion, sending, display and documentation of the console use it.

A new command is one entry of :data:`COMMANDS` here, one handler on the robot (``flexbt_onboard.commands``), and its
effect in the engine; ``docs/tools/make_console.py`` writes its documentation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

from flexbt_common.files import ALERTS, INCIDENTS
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import LIVENESS, NOTE_LENGTH, SYNTHESIS_SECONDS, CommandKind, OperatorCommand
from flexbt_console.mirror.view import View

from . import effects, queue_commands, spec
from .command_builder import CommandBuilder
from .operator_values import (
    SHELLS,
    assignment,
    autonomy_level,
    item_number,
    line_count,
    map_size,
    node_result,
    one_of,
    port_number,
    retry_count,
    run_count,
)
from .spec import (
    DECISION,
    UNSEEN,
    Argument,
    Ask,
    CommandLine,
    CommandSpec,
    LinkNeed,
    Mode,
    Option,
    Part,
    Role,
    Send,
    Show,
    seconds,
)

_REASON = Option('--reason', 'why, for the event log', 'TEXT')
_DECISION = Option(DECISION, 'decision to answer; refused if it is no longer pending', 'ID', values=spec.decisions)
_UNSEEN = Option(UNSEEN, 'answer even if the subject of the decision (a path, a value) was not received')
_UNSEEN_MACHINE = Option(UNSEEN, 'send it even if the machine of a synthesized behavior was not received')
_LEAVING = Option(
    '--leaving', 'what "quit" does (default: the robot continues); for programs that start the console', 'TEXT'
)
_PAGE = Option('--page', 'address of the page of the same robots, for programs', 'URL')
_PORT = Option('--port', 'port of the page (default 8465; 0 picks a free one)', 'NUMBER', read=port_number)
_ADDRESS = Option(
    '--address', 'address to listen at (default 127.0.0.1: this computer only; any other requires a token)', 'IP'
)
_USERS = Option('--users', 'file of the users, with their roles: see "users"', 'FILE')
_TLS = (
    Option('--certificate', 'serve by HTTPS with this certificate and the chain that it needs (PEM)', 'FILE'),
    Option('--key', 'private key of the certificate, unless it is in the same file (PEM)', 'FILE'),
)
_STUDIO = Option('--studio', 'serve the studio as well, for the missions in this folder', 'FOLDER')
_SCAN_PERIOD = Option(
    '--scan-period',
    f'time between two lidar scans on the map (default {effects.SCAN_PERIOD:g})',
    'SECONDS',
    read=seconds,
)
_SLOW_LINK = Option('--slow-link', 'show no scan; scans and transforms are most of the traffic on the link')
_ROBOT = Option(
    '--robot',
    'namespace of a robot (default: every robot that is found)',
    'NAME',
    repeated=True,
    values=spec.robot_names,
)
_STATE = Option('--state', f'file in which "alerts" remembers (default {ALERTS})', 'FILE', in_prompt=False)
_BEHAVIOR = (
    Argument('NAME', spaced=True, values=spec.behaviors),
    Argument('PARAMETER=VALUE', required=False, repeated=True, values=spec.parameters, read=assignment),
)
_AUTONOMY = Option(
    '--autonomy',
    'off, low, high, full or 0 to 3 (default: the current one)',
    'LEVEL',
    values=spec.levels,
    read=autonomy_level,
)
_INPUT = Option('--input', 'input userdata of the behavior', 'KEY=TYPE:VALUE', repeated=True)
_QUEUE_OPTIONS = (
    Option('--priority', 'higher ones start first (default 0)', 'NUMBER', read=queue_commands.priority),
    Option(
        '--when',
        'condition of a start (all must hold)',
        'CONDITION',
        repeated=True,
        values=queue_commands.conditions,
        read=queue_commands.condition,
    ),
    Option('--repeat', 'number of runs (default 1, or no end with --every)', 'COUNT', read=run_count),
    Option(
        '--every', 'time from one start to the next, as in 90s, 10m, 2h, 1d', 'DURATION', read=queue_commands.duration
    ),
    Option(
        '--on-failure',
        'hold the queue (default), continue, drop the entry, or retry=TIMES and then hold',
        'WHAT',
        values=lambda typed: queue_commands.FAILURES,
        read=queue_commands.on_failure,
    ),
    Option(
        '--wanted', 'outcome that is no failure (default: all but failed, canceled, aborted)', 'OUTCOME', repeated=True
    ),
)
_QUEUE_DETAILS: Final = (
    'CONDITION is battery=PERCENT (at least), time=22:00-06:00 (local time of the robot), after=+10m or '
    'after=2026-01-31T08:00 (time of this computer), near=PLACE or near=PLACE:METRES (default 1).',
    'A run fails if it cannot start or ends with failed, canceled or aborted; with --wanted: by any outcome that is '
    'not wanted. After a stop, a fault or a forced end the queue is held, whatever --on-failure says.',
)
_WAIT = Option('--wait', 'wait until the run has ended', in_prompt=False)
_WAIT_TIMEOUT = Option(
    '--wait-timeout', 'stop waiting after this time (exit code 4)', 'SECONDS', in_prompt=False, read=seconds
)
_RUN = Option('--run', 'run of the tree, if several run', 'ID', values=spec.tree_runs)
_TREE = Option('--tree', 'tree, by its identifier, also if it does not run (default: the one that runs)', 'ID')
_IF = Option('--if', 'condition, a script of the tree: hold only while it is true', 'SCRIPT')
_NODE_DETAILS: Final = (
    'NODE is the path of a node, or its last part if that is unique. What was set holds for every run of the tree, '
    'until it is cleared or the BT server ends; "status" lists it.'
)
_PATH_DETAILS: Final = 'PATH is a state or container, in full or its last labels when they are unique.'
_VALUE_DETAILS: Final = (
    'VALUE is JSON or YAML of the requested type; text needs no quotes of its own. A pose is a named place, '
    'or "x y yaw" in metres and radians in the frame "map"; several poses are separated by ";". Its stamp is 0, '
    'which means now. Put words that begin with "-" and are not numbers after "--".',
)


def _sent(
    name: str,
    summary: str,
    action: Send,
    arguments: tuple[Argument, ...] = (),
    options: tuple[Option, ...] = (),
    **more: Any,
) -> CommandSpec:
    """Return a command that is sent to the executive, with an option for the reason."""
    return CommandSpec(name, summary, action, arguments, (*options, _REASON), **more)


def _gives_result(name: str, summary: str, kind: CommandKind, how_often: str) -> CommandSpec:
    """Return a command that gives a node of a tree a result."""
    arguments = (Argument('NODE', values=spec.tree_nodes), Argument('RESULT', values=spec.results, read=node_result))
    details = (_NODE_DETAILS, f'RESULT is SUCCESS or FAILURE. A node that runs is halted. {how_often}')
    return _sent(name, summary, effects.of_tree(kind), arguments, (_TREE, _RUN), details=details)


COMMANDS: Final = (
    CommandSpec(
        'status',
        'show what runs, which decisions are pending, and how old that information is',
        Show(effects.status),
        link=LinkNeed.HEARD,
        needs=(Part.SUBJECTS,),
    ),
    CommandSpec(
        'watch',
        'print every change until interrupted, or for --timeout seconds',
        Mode.WATCH,
        details=(
            'It reports a lost link and continues. With --jsonl each line is an object with "event": status, '
            'structure, behaviors, log or link.',
        ),
        options=(Option('--jsonl', 'print JSON, one object per line, as --json'),),
    ),
    CommandSpec(
        'behaviors',
        'list the behaviors that can be started, with their parameters',
        Show(effects.behaviors),
        (Argument('NAME', required=False, spaced=True, values=spec.behaviors),),
        details=('With NAME, also show the machine if it was synthesized. JSON includes all machines.',),
        needs=(Part.BEHAVIORS,),
    ),
    CommandSpec(
        'structure',
        'show the state machine that runs: states, outcomes, targets, required autonomy',
        Show(effects.structure),
        needs=(Part.STRUCTURE,),
    ),
    CommandSpec(
        'tree',
        'show the running trees or the latest one: status of each node, and causes of failures',
        Ask(effects.tree),
        details=(
            'A halted node shows how it ended before. Nodes that failed by themselves are listed at the end, each with '
            'the ancestors that failed because of it.',
        ),
    ),
    CommandSpec(
        'tree why',
        'show why a node of a running tree is not running: the decisions above it',
        Ask(effects.tree_why),
        (Argument('NODE', values=spec.tree_nodes),),
        (_RUN,),
    ),
    CommandSpec(
        'tree blackboard',
        'show the blackboards of a running tree, with who wrote what and when',
        Ask(effects.tree_blackboard),
        (Argument('KEY', required=False, repeated=True),),
        (_RUN,),
        details=('Writes are recorded while anything is set at the tree: a breakpoint, or "tree record".',),
    ),
    _sent(
        'break',
        'hold a tree before each tick of a node',
        effects.of_tree(CommandKind.TREE_BREAK),
        (Argument('NODE', values=spec.tree_nodes),),
        (_IF, _TREE, _RUN),
        details=(
            _NODE_DETAILS,
            'While it is held, leaves hold their goals where they can, so that the robot stands; "stop" works. A '
            'condition that cannot be evaluated holds the tree, too, and says why.',
        ),
    ),
    _sent(
        'tree pause',
        'pause a tree between two ticks',
        effects.of_tree(CommandKind.TREE_PAUSE),
        options=(_RUN,),
    ),
    _sent(
        'tree step',
        'tick a held or paused tree once, or to the end of the tick in which it is held',
        effects.of_held_tree(CommandKind.TREE_STEP),
        options=(_RUN,),
    ),
    _sent(
        'tree continue',
        'let a held or paused tree go on',
        effects.of_held_tree(CommandKind.TREE_CONTINUE),
        options=(_RUN,),
    ),
    _sent(
        'tree run-to',
        'let a held or paused tree go on until it gets to a node',
        effects.of_held_tree(CommandKind.TREE_RUN_TO),
        (Argument('NODE', values=spec.tree_nodes),),
        (_IF, _RUN),
    ),
    _gives_result(
        'tree force',
        'give a node a result at its next tick, without ticking it',
        CommandKind.TREE_FORCE,
        'It happens once.',
    ),
    _gives_result(
        'tree dummy',
        'replace a node by a dummy that always gives a result',
        CommandKind.TREE_DUMMY,
        'Until it is cleared.',
    ),
    _sent(
        'tree record',
        'record who writes to the blackboards of a tree',
        effects.of_tree(CommandKind.TREE_RECORD),
        options=(_TREE, _RUN),
        details=('"tree blackboard" shows it, "tree clear" ends it.',),
    ),
    _sent(
        'tree set',
        'change the blackboard of a held or paused tree by a script',
        effects.ASSIGN,
        (Argument('SCRIPT'),),
        (Option('--at', 'node whose blackboard it is (default: the root)', 'NODE', values=spec.tree_nodes), _RUN),
        details=('SCRIPT assigns as scripts of the tree do: tree set "speed := 0.5; tries := 0".',),
    ),
    _sent(
        'tree clear',
        'clear what was set at a node of a tree, or at all of its nodes',
        effects.of_tree(CommandKind.TREE_CLEAR),
        (Argument('NODE', required=False, values=spec.tree_points),),
        (_TREE, _RUN),
        details=('A tree that is held at the node stays held: "tree continue".',),
    ),
    CommandSpec(
        'map',
        'show the map: walls, places, the plan, and where the robot is',
        Ask(effects.map_of_robot, is_map=True),
        options=(
            Option('--png', 'write an image to this file instead', 'FILE', in_prompt=False),
            Option('--size', 'size in cells of the terminal (default: what fits)', 'COLUMNSxROWS', read=map_size),
            Option('--scan', 'include the current lidar scan', in_prompt=False),
        ),
        details=('JSON has the position of the map, the robot, the plan, the places and the scan, in metres.',),
    ),
    CommandSpec(
        'userdata',
        'show the data that states of the run pass to each other',
        Ask(effects.userdata),
        (Argument('PATH', required=False, values=spec.userdata_paths), Argument('KEY', required=False, repeated=True)),
        details=(
            'Without arguments: all values of every active machine, by key. PATH, which begins with "/", selects a '
            'machine ("/" is the outermost), KEY selects keys. The data is read between two steps of the run.',
        ),
    ),
    CommandSpec(
        'incident',
        'have the black box write an incident: the last minutes, and what the robot does now',
        Ask(effects.incident),
    ),
    CommandSpec(
        'log',
        'show the latest lines of the log',
        Show(effects.log, Mirror.log),
        (Argument('COUNT', required=False, read=line_count),),
        details=(f'At most COUNT lines (default {effects.LOG_COUNT}).',),
    ),
    CommandSpec(
        'events',
        'show the latest transitions, and the commands of all operators',
        Show(effects.events, Mirror.events),
        (Argument('COUNT', required=False, read=line_count),),
        details=(f'At most COUNT of them (default {effects.LOG_COUNT}).',),
    ),
    _sent(
        'start',
        'start a behavior',
        effects.START,
        _BEHAVIOR,
        (
            _AUTONOMY,
            _INPUT,
            _UNSEEN_MACHINE,
            Option('--hold-queue', 'hold the mission queue, which does not go on after this run'),
            _WAIT,
            _WAIT_TIMEOUT,
        ),
        details=(
            'NAME may have spaces: it ends before the first PARAMETER=VALUE.',
            'With --wait the exit code is 0 if the run ended with one of its outcomes, and 3 if it was stopped or '
            'failed.',
        ),
        needs=(Part.BEHAVIORS, Part.PLACES),
    ),
    _sent(
        'stop',
        'stop the run and the robot',
        effects.alone(CommandKind.STOP),
        options=(_WAIT, _WAIT_TIMEOUT),
        link=LinkNeed.HEARD,
    ),
    _sent(
        'autonomy',
        'set how much the robot decides by itself',
        effects.AUTONOMY,
        (
            Argument('LEVEL', values=spec.levels, read=autonomy_level),
            Argument('PATH', required=False, values=spec.states),
        ),
        details=(
            'PATH is a state or container: the level holds for it and what is in it. Without PATH: for everything.',
            'LEVEL is off, low, high, full or 0 to 3. A transition happens without the operator when it requires '
            'less than LEVEL.',
        ),
        needs=(Part.STRUCTURE,),
    ),
    _sent(
        'confirm',
        'confirm the pending transition',
        effects.CONFIRM,
        (Argument('ID', required=False, values=spec.decisions),),
        (_UNSEEN,),
        details=('Without ID: the only pending decision. If there are several, they are listed.',),
        needs=(Part.SUBJECTS,),
    ),
    _sent(
        'force',
        "leave a state by an outcome of the operator's choice",
        effects.FORCE,
        (Argument('PATH', required=False, values=spec.active_states), Argument('OUTCOME', values=spec.outcomes)),
        (
            _DECISION,
            _UNSEEN,
        ),
        details=(
            f'{_PATH_DETAILS} Without PATH: the state that waits for the operator, or else the only active state.',
        ),
        needs=(Part.STRUCTURE, Part.SUBJECTS),
    ),
    _sent(
        'input',
        'answer an input request with a value',
        effects.INPUT,
        (
            Argument('ID', required=False, values=spec.input_requests),
            Argument('VALUE', required=False, repeated=True, values=spec.short_answers),
        ),
        (
            _DECISION,
            Option('--decline', 'decline to answer'),
            _UNSEEN,
        ),
        details=('Without ID: the only pending input request.', *_VALUE_DETAILS),
        needs=(Part.PLACES, Part.SUBJECTS),
        check=effects.check_input,
    ),
    _sent(
        'decline',
        'decline to answer an input request',
        effects.DECLINE,
        (Argument('ID', required=False, values=spec.input_requests),),
    ),
    _sent(
        'pause',
        'pause the run',
        effects.alone(CommandKind.PAUSE),
        details=('Until "resume", no state runs or is left, and their time stands still. "stop" still works.',),
    ),
    _sent(
        'resume',
        'resume a paused run, or one that was interrupted when the executive ended',
        effects.RESUME,
        details=(
            'After a crash of the executive, the states that were active are entered again. "abort" drops the run.',
        ),
    ),
    _sent(
        'abort',
        'drop a run that was interrupted when the executive ended',
        effects.alone(CommandKind.ABORT_RUN),
    ),
    _sent(
        'repeat',
        'leave a state and enter it again',
        effects.REPEAT,
        (Argument('PATH', required=False, values=spec.active_states),),
        details=('Without PATH: the state that waits for the operator, or else the only active state.',),
        needs=(Part.STRUCTURE,),
    ),
    _sent(
        'lock',
        'prevent a state or container from being left',
        effects.at_path(CommandKind.LOCK),
        (Argument('PATH', values=spec.states),),
        details=(_PATH_DETAILS,),
        needs=(Part.STRUCTURE,),
    ),
    _sent(
        'unlock',
        'undo lock',
        effects.at_path(CommandKind.UNLOCK),
        (Argument('PATH', values=spec.locked),),
        needs=(Part.STRUCTURE,),
    ),
    _sent(
        'breakpoint',
        'hold every transition out of a state for the operator, at any level of autonomy',
        effects.at_path(CommandKind.BREAKPOINT),
        (Argument('PATH', values=spec.states),),
        details=(_PATH_DETAILS,),
        needs=(Part.STRUCTURE,),
    ),
    _sent(
        'clear',
        'clear a breakpoint',
        effects.at_path(CommandKind.CLEAR_BREAKPOINT),
        (Argument('PATH', values=spec.breakpoints),),
        needs=(Part.STRUCTURE,),
    ),
    _sent(
        'step',
        'confirm a held transition, and hold a later one',
        effects.STEP,
        (Argument('HOW', values=lambda typed: effects.STEPS, read=one_of(tuple(effects.STEPS))),),
        (_DECISION, _UNSEEN),
        details=(
            'into: the next transition anywhere. over: the next one that is not within the container that is entered. '
            'out: the next one out of the container around the state. Any breakpoint on the way holds, too.',
        ),
        needs=(Part.SUBJECTS,),
    ),
    _sent(
        'switch',
        'switch to another behavior, keeping the active states',
        effects.SWITCH,
        _BEHAVIOR,
        (_UNSEEN_MACHINE,),
        details=('The other behavior must have the active states at the same paths. A refusal lists those it lacks.',),
        needs=(Part.BEHAVIORS,),
    ),
    CommandSpec(
        'queue',
        'list the mission queue: the behaviors that the robot starts by itself when no other runs',
        Show(queue_commands.show),
        details=('The first entry whose conditions hold starts. Higher priorities come first.',),
        needs=(Part.QUEUE, Part.PLACES),
    ),
    _sent(
        'queue add',
        'add a behavior to the mission queue',
        queue_commands.ADD,
        _BEHAVIOR,
        (_AUTONOMY, _INPUT, *_QUEUE_OPTIONS, _UNSEEN_MACHINE),
        details=(
            'It starts by itself, also when no operator is connected, or another one has the authority.',
            *_QUEUE_DETAILS,
        ),
        needs=(Part.BEHAVIORS, Part.PLACES),
    ),
    _sent(
        'queue edit',
        'change an entry of the mission queue: the options that are given',
        queue_commands.EDIT,
        (
            Argument('NUMBER', values=spec.queue_entries, read=item_number),
            Argument('PARAMETER=VALUE', required=False, repeated=True, read=assignment),
        ),
        (_AUTONOMY, _INPUT, *_QUEUE_OPTIONS),
        details=(
            'Parameters and inputs replace all that the entry has of them. "battery=none" ends that condition. '
            'It is refused if another operator has changed the entry meanwhile, or a run of it has ended.',
            *_QUEUE_DETAILS,
        ),
        needs=(Part.BEHAVIORS, Part.PLACES, Part.QUEUE),
    ),
    _sent(
        'queue remove',
        'remove an entry from the mission queue; a run of it goes on',
        queue_commands.REMOVE,
        (Argument('NUMBER', values=spec.queue_entries, read=item_number),),
        needs=(Part.QUEUE,),
    ),
    _sent(
        'queue move',
        'move an entry before another one of the same priority',
        queue_commands.MOVE,
        (
            Argument('NUMBER', values=spec.queue_entries, read=item_number),
            Argument(
                'BEFORE',
                values=lambda typed: (*queue_commands.WHERE, *spec.queue_entries(typed)),
                read=queue_commands.place_in_queue,
            ),
        ),
        details=('BEFORE is the number of an entry, or first or last.',),
        needs=(Part.QUEUE,),
    ),
    _sent('queue hold', 'start no further entry of the mission queue', queue_commands.HOLD),
    _sent(
        'queue release',
        'let the mission queue go on',
        queue_commands.RELEASE,
        options=(
            Option(
                queue_commands.HOLD_OPTION,
                'hold that was seen, by its number (default: that which this console shows)',
                'NUMBER',
                read=item_number,
            ),
        ),
        details=('It is refused if the queue was held again for another reason than this console shows.',),
        needs=(Part.QUEUE,),
    ),
    _sent(
        'queue clear',
        'remove all entries of the mission queue that this console shows; a run goes on',
        queue_commands.CLEAR,
        needs=(Part.QUEUE,),
    ),
    CommandSpec(
        'synthesize',
        'synthesize a behavior that reaches its goals despite failures, or explain why there is none',
        Ask(effects.synthesis),
        (Argument('SYSTEM', required=False),),
        (
            Option('--goal', 'goal of the behavior (all must hold)', 'FORMULA', repeated=True),
            Option('--initial', 'condition at the start', 'FORMULA', repeated=True),
            Option('--outcome', 'outcome of the machine', 'NAME', repeated=True),
            Option('--retries', 'times that a failed state is repeated', 'N', read=retry_count),
            Option(
                '--liveness',
                'fair, adversarial or fair-outcomes: assumption about failures (default fair)',
                'WHAT',
                values=lambda typed: LIVENESS,
                read=one_of(LIVENESS),
            ),
            Option('--name', "name of the behavior (default: the system's)", 'NAME'),
            Option('--spec', 'file on the robot with more variables and formulas', 'FILE'),
            Option('--file', 'capability file (YAML) on this computer, instead of SYSTEM', 'FILE', in_prompt=False),
            Option(
                '--time-limit',
                f'end the search after this time (default {SYNTHESIS_SECONDS:g})',
                'SECONDS',
                read=seconds,
            ),
            Option('--cancel', 'end the running synthesis, whoever requested it'),
        ),
        details=(
            "SYSTEM is a capability file on the robot: a name in the executive's capability_directories, or "
            'package/path.yaml. Put a FORMULA with spaces in quotes.',
            'The machine is shown and becomes a behavior of the robot for "start" and "switch". Nothing is started; '
            'the current run continues. If there is no such machine, the answer explains why, with exit code 3. In '
            'line mode Ctrl-C cancels the synthesis.',
        ),
        check=effects.check_synthesis,
    ),
    _sent(
        'claim',
        'claim the authority to command',
        effects.alone(CommandKind.CLAIM_AUTHORITY),
        details=(
            'While nobody has the authority, every operator may command. If another operator has it, this requests it. '
            '"status" shows the holder. A holder that is gone for the time set by the executive loses it. "stop" needs '
            'no authority.',
        ),
    ),
    _sent(
        'release',
        'release the authority, or withdraw a request for it',
        effects.alone(CommandKind.RELEASE_AUTHORITY),
    ),
    _sent(
        'handover',
        'hand over the authority to another operator',
        effects.to_requester(CommandKind.HAND_OVER_AUTHORITY),
        (Argument('OPERATOR', required=False, values=spec.requesters),),
        details=('Without OPERATOR: to the only one who requests it.',),
    ),
    _sent(
        'refuse',
        'refuse a request for the authority',
        effects.to_requester(CommandKind.REFUSE_AUTHORITY),
        (Argument('OPERATOR', required=False, values=spec.requesters),),
        details=('Without OPERATOR: the only request. The operator may request again.',),
    ),
    CommandSpec(
        'note',
        'write a remark into the event log and the log of every console',
        effects.NOTE,
        (Argument('TEXT', repeated=True, as_typed=True),),
        details=(
            f'TEXT is everything after "note", at most {NOTE_LENGTH} characters. It becomes part of the report and the '
            'recording of the run. It needs neither a run nor the authority.',
        ),
        check=effects.check_note,
    ),
    CommandSpec(
        'places',
        'list the named places: those of the robot, and those of --places',
        Show(effects.places),
        link=LinkNeed.NONE,
        needs=(Part.PLACES,),
    ),
    CommandSpec(
        'robots',
        'list the robots of the domain, the most urgent first, and how long each has waited',
        Mode.ROBOTS,
    ),
    CommandSpec(
        'alerts',
        'call people about what robots need, by the rules of a file',
        Mode.ALERTS,
        (Argument('FILE'),),
        (
            Option('--check', 'show what is wrong with the file, or whom it would call now; call nobody'),
            Option('--test', 'send a message to this contact', 'CONTACT'),
            _STATE,
        ),
        details=(
            'It runs until interrupted, and reports in the log what it sends. It calls once for one thing, also after '
            'a restart. It reads the file again when it changes.',
        ),
    ),
    CommandSpec(
        'alerts acknowledge',
        'acknowledge calls of "alerts" on this computer, so that nobody else is called',
        Ask(effects.acknowledge),
        (Argument('NUMBER', required=False, repeated=True, read=item_number),),
        (_STATE,),
        details=(
            'Without NUMBER: the only one. If there are several, they are listed.',
            'On a page, and by HTTP, "this computer" is that which serves it.',
        ),
        link=LinkNeed.NONE,
    ),
    CommandSpec(
        'screen',
        'full screen (default without a command): machine, trees, map, decisions and log; a key for each command',
        Mode.SCREEN,
        options=(_LEAVING, _PAGE, _SCAN_PERIOD, _SLOW_LINK),
    ),
    CommandSpec(
        'web',
        'page for a browser: machine, trees and map as pictures, decisions, commands and log',
        Mode.WEB,
        options=(_ROBOT, _PORT, _ADDRESS, _USERS, *_TLS, _STUDIO, _SCAN_PERIOD, _SLOW_LINK),
        details=(
            'It prints the address of the page and serves it until interrupted. The page has a line for each robot '
            'that is found, the most urgent first; ?robot=NAME opens one of them.',
            'At an address other than that of this computer, the page requires the token in the printed address. '
            'FLEXBT_WEB_TOKEN sets the token, which is then required on this computer, too. With --users, each user '
            'has a token and a role instead (see "users").',
            'Without --certificate nothing is encrypted: on an open network, use one, or a tunnel (ssh -L '
            '8465:localhost:8465 STATION).',
            'Programs have the same by HTTP, below /api/: /api/openapi.json describes it.',
        ),
    ),
    CommandSpec(
        'replay',
        'show a recording on the screen, with time line, steps, search and speed',
        Mode.REPLAY,
        (Argument('FILE'),),
        details=('Nothing is published; the executable `replay` publishes a recording for other consoles.',),
    ),
    CommandSpec(
        'incidents',
        'list the incidents on this computer, newest first, or print one of them',
        Mode.INCIDENTS,
        (Argument('NAME', required=False),),
        (Option('--directory', f'directory of the incidents (default: {INCIDENTS})', 'DIR'),),
        details=(
            'NAME is the beginning of a name, or "latest". The folder of an incident has the page as HTML, too, and a '
            'recording for "replay".',
        ),
    ),
    CommandSpec(
        'users',
        'list the users of a page, or add or remove one',
        Mode.USERS,
        (Argument('FILE'),),
        (
            Option('--add', 'add a user, or give him a new token and role, and print the token', 'NAME'),
            Option('--role', 'role of the added user: observer, operator (default) or maintainer', 'ROLE'),
            Option('--remove', 'remove a user', 'NAME'),
        ),
        details=(
            'An observer looks; an operator also starts, answers, pauses and stops; a maintainer also forces outcomes, '
            'debugs, switches and edits. The file has only hashes of tokens. A change counts at once.',
        ),
    ),
    CommandSpec(
        'run-tree',
        'run a behavior tree on the BT server, without a behavior, until it ends or Ctrl-C cancels it',
        Mode.RUN_TREE,
        (Argument('FILE'),),
        (
            Option('--tree', 'tree of the file (default: its main tree)', 'ID'),
            Option('--goal', 'goal pose: a place of --places, or "x y yaw"', 'POSE', repeated=True),
            Option('--input', 'entry of the blackboard before the first tick', 'KEY=TYPE:VALUE', repeated=True),
            Option('--output', 'entry of the blackboard to print at the end', 'KEY', repeated=True),
            Option('--blackboard', 'name of the blackboard (default: console)', 'NAME'),
        ),
        details=(
            'FILE is a file on this computer, package/path.xml on the robot, or the ID of a loaded tree.',
            'Active nodes are printed to standard error, the result and its reasons to standard output. The exit code '
            'is 0 if the tree succeeds, and 3 if it does not. The tree runs beside the behavior of the executive: no '
            'operator supervises it, but a STOP ends it.',
        ),
    ),
    CommandSpec(
        'completion',
        'print the completion script for a shell',
        Mode.COMPLETION,
        (Argument('SHELL', values=lambda typed: SHELLS, read=one_of(SHELLS)),),
        (Option('--line', 'print the completions of the last word of this line (for the script)', 'TEXT'),),
        details=(
            'In bash: . <(console completion bash); in zsh: . <(console completion zsh); in ~/.bashrc or ~/.zshrc for '
            'every shell. Names of behaviors, states, decisions and robots come from the robot, within 1.5 s.',
        ),
    ),
    CommandSpec(
        'prompt',
        'interactive prompt (default without a command if the terminal cannot show the screen or Textual is missing)',
        Mode.PROMPT,
        options=(_LEAVING, _PAGE),
    ),
)


MAINTENANCE: Final = frozenset(
    {
        'force',
        'repeat',
        'lock',
        'unlock',
        'breakpoint',
        'clear',
        'step',
        'switch',
        'synthesize',
        'break',
        *(spec.name for spec in COMMANDS if spec.name.startswith('tree ') and isinstance(spec.action, Send)),
    }
)
"""Commands that override, debug or change what runs."""


def role_for(command: CommandSpec) -> Role:
    """Return the least role for a command."""
    if command.name in MAINTENANCE:
        return Role.MAINTAINER
    acts = isinstance(command.action, Send) or command.name in ('incident', 'alerts acknowledge')
    return Role.OPERATOR if acts else Role.OBSERVER


def find(name: str) -> CommandSpec | None:
    """Return the command with this name, or None."""
    return next((spec for spec in COMMANDS if spec.name == name), None)


def begun(words: Sequence[str]) -> tuple[CommandSpec | None, Sequence[str]]:
    """Return the command with which the words begin, whose name may be two of them, and the words behind it."""
    longer = find(' '.join(words[:2])) if len(words) > 1 else None
    return (find(words[0]) if words else None, words[1:]) if longer is None else (longer, words[2:])


def build(line: CommandLine, view: View, builder: CommandBuilder) -> OperatorCommand:
    """Return the command for the executive that a line means, bound to ``view``.

    Raises:
        UsageError: the syntax is wrong.
        RefusedError: the command cannot work now.
    """
    assert isinstance(line.spec.action, Send)
    command = line.spec.action.build(line, view, builder)
    return replace(command, reason=line.value(_REASON.name))

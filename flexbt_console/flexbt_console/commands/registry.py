# SPDX-License-Identifier: BSD-3-Clause
"""The registry of commands: what the console parses, helps with, completes, builds, shows and documents.

A new command is one entry of :data:`COMMANDS` here, one handler on the robot (``flexbt_onboard.commands``), and its
effect in the engine; ``docs/tools/make_console.py`` writes its documentation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Final

from flexbt_console.errors import NoAnswerError, RefusedError, UsageError
from flexbt_console.mirror import (
    LIVENESS,
    NOTE_LENGTH,
    SYNTHESIS_SECONDS,
    AutonomyLevel,
    Command,
    CommandKind,
    DecisionKind,
    SynthesisRequest,
    TreeRun,
    View,
)
from flexbt_console.present import (
    behaviors_lines,
    event_line,
    log_lines,
    map_json,
    places_lines,
    status_json,
    status_lines,
    structure_json,
    structure_lines,
    synthesis_lines,
    tree_json,
    userdata_lines,
)
from flexbt_core.values import one_line

from .command_builder import CommandBuilder
from .operator_values import (
    SHELLS,
    assignment,
    autonomy_level,
    capability_text,
    line_count,
    liveness,
    map_size,
    port_number,
    retry_count,
    shell_name,
    start_input,
)
from .spec import (
    DECISION,
    Answers,
    Argument,
    Ask,
    AskedRobot,
    CommandLine,
    CommandSpec,
    Known,
    LinkNeed,
    Mode,
    Option,
    Send,
    Show,
    Shown,
    Typed,
    seconds,
)

LOG_COUNT: Final = 20
"""Lines of the log that are shown when no number is given."""

SCAN_PERIOD: Final = 0.5
"""Seconds from one scan on the map to the next when none are given."""

SURROUNDINGS_SECONDS: Final = 2.0
"""So long what is latched, and a plan that is told each second, is waited for."""


# What the words of a line may be


def _levels(typed: Typed) -> Iterable[str]:
    return (level.name.lower() for level in AutonomyLevel)


def _behaviors(typed: Typed) -> Iterable[str]:
    return (behavior.name for behavior in typed.view.behaviors or () if not behavior.error)


def _parameters(typed: Typed) -> Iterable[str]:
    chosen = (behavior for behavior in typed.view.behaviors or () if typed.words[:1] == (behavior.name,))
    return (f'{parameter.name}=' for behavior in chosen for parameter in behavior.parameters)


def _states(typed: Typed) -> Iterable[str]:
    view = typed.view
    return (state.path for state in view.structure.states) if view.structure else view.active_levels


def _active_states(typed: Typed) -> Iterable[str]:
    return typed.view.active_levels


def _locked(typed: Typed) -> Iterable[str]:
    return typed.view.snapshot.locked if typed.view.snapshot else ()


def _breakpoints(typed: Typed) -> Iterable[str]:
    return typed.view.snapshot.breakpoints if typed.view.snapshot else ()


def _outcomes(typed: Typed) -> Iterable[str]:
    view = typed.view
    if typed.words:
        return view.outcomes(typed.words[0])
    waiting = view.decision.outcomes if view.decision else ()
    return (*waiting, *(view.outcomes(view.active_paths[0]) if len(view.active_paths) == 1 else ()))


def _decisions(typed: Typed) -> Iterable[str]:
    return (decision.id for decision in typed.view.decisions)


def _input_requests(typed: Typed) -> Iterable[str]:
    return (decision.id for decision in typed.view.decisions if decision.kind is DecisionKind.INPUT)


def _requesters(typed: Typed) -> Iterable[str]:
    return typed.view.snapshot.authority_requests if typed.view.snapshot else ()


def _userdata_paths(typed: Typed) -> Iterable[str]:
    structure = typed.view.structure
    return (state.path for state in structure.states if state.children) if structure else ()


def robot_names(typed: Typed) -> Iterable[str]:
    """The namespaces of the robots of the domain."""
    return typed.robots


def short_answers(typed: Typed) -> Iterable[str]:
    """What may be typed in short, without a command: the choices of the oldest decision, or the places."""
    decision = typed.view.decision
    if decision is None:
        return ()
    return decision.choices or (sorted(typed.view.places) if decision.wants_pose else ())


# What has to have arrived


def _behaviors_known(view: View) -> bool:
    return view.behaviors is not None


def _places_known(view: View) -> bool:
    return view.has_places


def _all_for_a_start_known(view: View) -> bool:
    return _behaviors_known(view) and _places_known(view)


def _structure_known(view: View) -> bool:
    return view.structure is not None or view.snapshot is None or not view.snapshot.run_id


# What is sent


def _send(*kinds: CommandKind) -> Send:
    """Commands that have no arguments of their own."""
    return Send(kinds, lambda line, view, make: make.command(view, kinds[0]))


def _at_path(kind: CommandKind) -> Send:
    return Send((kind,), lambda line, view, make: make.at_path(kind, view, line.words[0]))


def _build_start(line: CommandLine, view: View, make: CommandBuilder) -> Command:
    inputs = [start_input(text, view.places) for text in line.values('--input')]
    level = autonomy_level(line.value('--autonomy')) if line.has('--autonomy') else None
    return make.start(view, line.words[0], _assignments(line), level, inputs)


def _assignments(line: CommandLine) -> list[tuple[str, str]]:
    return [assignment(word) for word in line.words[1:]]


def _build_autonomy(line: CommandLine, view: View, make: CommandBuilder) -> Command:
    return make.autonomy(view, autonomy_level(line.words[0]), line.words[1] if len(line.words) > 1 else '')


def _build_force(line: CommandLine, view: View, make: CommandBuilder) -> Command:
    path, outcome = line.words if len(line.words) == 2 else ('', line.words[0])
    return make.force(view, path, outcome, line.value(DECISION))


def _build_input(line: CommandLine, view: View, make: CommandBuilder) -> Command:
    decision_id = line.value(DECISION)
    if line.has('--decline'):
        return make.decline(view, decision_id or line.first_word)
    if not decision_id and len(line.words) > 1:
        if view.pending(line.words[0]) is not None:
            return make.answer(view, line.words[0], ' '.join(line.words[1:]))
        if any(decision.wants_text for decision in view.decisions):
            # The first word might be meant as the name of a request that is gone: it must not become the answer.
            raise RefusedError('a text of several words is one word in quotes, or goes with --decision ID')
    return make.answer(view, decision_id, line.text)


def _check_input(line: CommandLine) -> None:
    if not line.has('--decline') and not line.words:
        assert line.spec is not None
        raise UsageError(f'usage: {line.spec.usage}')


def _check_note(line: CommandLine) -> None:
    if len(line.text) > NOTE_LENGTH:
        raise UsageError(f'the note has {len(line.text)} characters; at most {NOTE_LENGTH} are taken')
    if not line.text.strip():
        raise UsageError('the note is empty')


def _check_screen(line: CommandLine) -> None:
    if line.has('--port') and not line.has('--web'):
        raise UsageError('--port is of the screen in a browser: give --web, too')


def _names_decision(line: CommandLine, view: View) -> bool:
    return bool(line.words)


def _names_state(line: CommandLine, view: View) -> bool:
    return len(line.words) == 2


def _names_input_request(line: CommandLine, view: View) -> bool:
    return bool(line.words) and view.pending(line.words[0]) is not None


_OUTCOMES_OF = frozenset({DecisionKind.TRANSITION, DecisionKind.CHOICE})
_VALUES_OF = frozenset({DecisionKind.INPUT})


# What is shown


def _show_status(line: CommandLine, view: View, known: Known) -> Shown:
    return Shown(status_json(view), status_lines(view))


def _show_behaviors(line: CommandLine, view: View, known: Known) -> Shown:
    if view.behaviors is None:
        raise NoAnswerError('the executive has not said which behaviors it has')
    return Shown(view.behaviors, behaviors_lines(view.behaviors))


def _show_structure(line: CommandLine, view: View, known: Known) -> Shown:
    if view.snapshot is None or not view.snapshot.run_id:
        raise RefusedError('nothing has run yet: there is no state machine to show')
    if view.structure is None:
        raise NoAnswerError('the state machine of the run has not arrived')
    return Shown(structure_json(view.structure), structure_lines(view.structure, view))


def _show_log(line: CommandLine, view: View, known: Known) -> Shown:
    entries = known.log(line_count(line.words[0]) if line.words else LOG_COUNT)
    text = [text for entry in entries for text in log_lines(entry, with_time=True)]
    return Shown(entries, text or ['the log is empty'])


def _show_events(line: CommandLine, view: View, known: Known) -> Shown:
    events = known.events(line_count(line.words[0]) if line.words else LOG_COUNT)
    return Shown(events, [event_line(event, with_time=True) for event in events] or ['nothing has happened yet'])


def _show_places(line: CommandLine, view: View, known: Known) -> Shown:
    return Shown(view.places, places_lines(view.places))


def _ask_userdata(line: CommandLine, robot: AskedRobot, timeout: float, tell: Callable[[str], None]) -> Shown:
    path, *keys = line.words or ('',)
    scopes = robot.userdata(path, keys, timeout)
    return Shown(scopes, userdata_lines(scopes))


def _ask_tree(line: CommandLine, robot: AskedRobot, timeout: float, tell: Callable[[str], None]) -> Shown:
    from flexbt_console.pictures import chains_of_failures, glyphs, whole_tree_lines  # what only this needs

    def told(view: View) -> list[TreeRun]:
        return [run for run in view.trees if run.sequence > 0]

    def missing(view: View) -> set[str]:
        named = {state.tree_run_id for state in view.snapshot.active_states} if view.snapshot else set()
        return named - {'', *(run.run_id for run in told(view))}

    # Where no state names its tree there may be none at all.
    view = robot.surroundings(lambda view: bool(told(view)) and not missing(view), min(timeout, SURROUNDINGS_SECONDS))
    if missing(view):
        raise NoAnswerError('a tree runs, and its nodes have not arrived; is the BT server in the same namespace?')
    if not told(view):
        raise RefusedError('no tree has run yet, or the BT server is gone')
    runs = view.running_trees or told(view)[:1]
    shown = [line for run in runs for line in ('', *whole_tree_lines(run, glyphs()))][1:]
    return Shown([tree_json(run, chains_of_failures(run)) for run in runs], shown)


def _ask_map(line: CommandLine, robot: AskedRobot, timeout: float, tell: Callable[[str], None]) -> Shown:
    from flexbt_console.pictures import map_lines, save_map  # what only this needs

    wants_scan = line.has('--scan')

    def has_arrived(view: View) -> bool:
        around, snapshot = view.surroundings, view.snapshot
        drives = snapshot is not None and any(state.progress is not None for state in snapshot.active_states)
        wanted = (around.map, around.plan or not drives, around.scan or not wants_scan)
        return view.has_places and all(wanted)

    view = robot.surroundings(has_arrived, min(timeout, SURROUNDINGS_SECONDS), SCAN_PERIOD if wants_scan else 0.0)
    around, pose = view.surroundings, view.snapshot.robot_pose if view.snapshot else None
    if around.map is None and pose is None:
        raise NoAnswerError('neither a map nor the pose of the robot has arrived')
    value = map_json(view)
    if line.has('--png'):
        file = Path(line.value('--png'))
        save_map(file, around, pose, view.places)
        return Shown({**value, 'file': str(file)}, [f'the map is in {one_line(str(file))}'])
    return Shown(value, map_lines(view, map_size(line.value('--size'))))


def _ask_synthesis(line: CommandLine, robot: AskedRobot, timeout: float, tell: Callable[[str], None]) -> Shown:
    if line.has('--cancel'):
        count = robot.cancel_synthesis(timeout)
        if not count:
            raise RefusedError('no synthesis is under way')
        return Shown(count, ['the synthesis is canceled'])
    request = SynthesisRequest(
        line.first_word,
        capability_text(line.value('--file')) if line.has('--file') else '',
        line.value('--spec'),
        tuple(line.values('--goal')),
        tuple(line.values('--initial')),
        tuple(line.values('--outcome')),
        line.value('--liveness') or LIVENESS[0],
        retry_count(line.value('--retries')) if line.has('--retries') else -1,
        line.value('--name'),
        line.seconds('--time-limit') or SYNTHESIS_SECONDS,
    )
    made = robot.synthesis(request, timeout, tell)
    return Shown(made, synthesis_lines(made), is_refusal=not made.behavior)


def _check_synthesis(line: CommandLine) -> None:
    if line.has('--cancel'):
        own = {option.name for option in line.spec.options} if line.spec is not None else set()
        if line.words or own & line.options.keys() != {'--cancel'}:
            raise UsageError('--cancel stands alone: it ends the synthesis that is under way')
    elif line.has('--file') == bool(line.words):
        raise UsageError('name the SYSTEM that the robot knows, or a file of capabilities of this computer by --file')


# The commands

_REASON = Option('--reason', 'why, for the event log', 'TEXT')
_DECISION = Option(
    DECISION, 'the decision that is meant; refused when it is not pending any more', 'ID', values=_decisions
)
_LEAVING = Option('--leaving', 'what it tells of "quit" (default: the robot goes on), for who starts it', 'TEXT')
_IN_BROWSER = Option('--web', 'serve it to browsers on this computer (with --port), instead of this terminal')
_PORT = Option('--port', 'port of the page (default 8465; 0 takes a free one)', 'NUMBER', read=port_number)
_ADDRESS = Option(
    '--address', 'address to listen at (default 127.0.0.1: this computer only; beyond it a token is needed)', 'IP'
)
_SCAN_PERIOD = Option(
    '--scan-period',
    f'from one scan of the lidar on the map to the next (default {SCAN_PERIOD:g})',
    'SECONDS',
    read=seconds,
)
_SLOW_LINK = Option('--slow-link', 'show no scan: it and the transforms are most of what comes over the link')
_ROBOT = Option(
    '--robot', 'namespace of a robot (default: every robot that is found)', 'NAME', repeated=True, values=robot_names
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
        Show(_show_status),
        link=LinkNeed.HEARD,
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
        Show(_show_behaviors),
        has_arrived=_behaviors_known,
    ),
    CommandSpec(
        'structure',
        'show the state machine that runs: states, outcomes, targets, required autonomy',
        Show(_show_structure),
        has_arrived=_structure_known,
    ),
    CommandSpec(
        'tree',
        'show the trees that run, or the latest: each node with its status, and what has failed by what',
        Ask(_ask_tree),
        details=(
            'A node that was halted shows how it had ended before. Behind the nodes stands each that has failed by '
            'itself, with those above it that have failed by it.',
        ),
    ),
    CommandSpec(
        'map',
        'show the map: walls, places, the plan, and where the robot is',
        Ask(_ask_map),
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
        Ask(_ask_userdata),
        (Argument('PATH', required=False, values=_userdata_paths), Argument('KEY', required=False, repeated=True)),
        details=(
            'The values of every active machine, by the names of their keys in it; of the machine PATH only, "/" for '
            'the outermost, and of the KEYs only, when these are given. It is read between two steps of the run.',
        ),
    ),
    CommandSpec(
        'log',
        'show the latest lines of the log',
        Show(_show_log),
        (Argument('COUNT', required=False, read=line_count),),
        details=(f'COUNT lines at most, {LOG_COUNT} when it is left out.',),
    ),
    CommandSpec(
        'events',
        'show the latest transitions, and the commands of all operators',
        Show(_show_events),
        (Argument('COUNT', required=False, read=line_count),),
        details=(f'COUNT of them at most, {LOG_COUNT} when it is left out.',),
    ),
    CommandSpec(
        'start',
        'start a behavior',
        Send((CommandKind.START,), _build_start),
        (
            Argument('NAME', spaced=True, values=_behaviors),
            Argument('PARAMETER=VALUE', required=False, repeated=True, values=_parameters, read=assignment),
        ),
        (
            Option(
                '--autonomy',
                'off, low, high, full or 0 to 3 (default: as it is shown)',
                'LEVEL',
                values=_levels,
                read=autonomy_level,
            ),
            Option('--input', 'input userdata of the behavior', 'KEY=TYPE:VALUE', repeated=True),
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
        _send(CommandKind.STOP),
        options=(_REASON, _WAIT, _WAIT_TIMEOUT),
        link=LinkNeed.HEARD,
    ),
    CommandSpec(
        'autonomy',
        'set how much the robot decides alone',
        Send((CommandKind.AUTONOMY,), _build_autonomy),
        (Argument('LEVEL', values=_levels, read=autonomy_level), Argument('PATH', required=False, values=_states)),
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
        Send(
            (CommandKind.CONFIRM,),
            lambda line, view, make: make.confirm(view, line.value(DECISION) or line.first_word),
            Answers(_OUTCOMES_OF, _names_decision),
        ),
        (Argument('ID', required=False, values=_decisions),),
        (_REASON,),
        details=('Without ID: the only pending decision; when there are several, they are listed.',),
    ),
    CommandSpec(
        'force',
        "leave a state by an outcome of the operator's choice",
        Send((CommandKind.FORCE,), _build_force, Answers(_OUTCOMES_OF, _names_state, also_alone=True)),
        (Argument('PATH', required=False, values=_active_states), Argument('OUTCOME', values=_outcomes)),
        (_DECISION, _REASON),
        details=(
            f'{_PATH_DETAILS} Without PATH: the state that waits for the operator, or else the only active state.',
        ),
        has_arrived=_structure_known,
    ),
    CommandSpec(
        'input',
        'answer an input request by a value',
        Send((CommandKind.ANSWER, CommandKind.DECLINE), _build_input, Answers(_VALUES_OF, _names_input_request)),
        (
            Argument('ID', required=False, values=_input_requests),
            Argument('VALUE', required=False, repeated=True, values=short_answers),
        ),
        (_DECISION, Option('--decline', 'decline to answer'), _REASON),
        details=('Without ID: the only pending input request.', *_VALUE_DETAILS),
        has_arrived=_places_known,
        check=_check_input,
    ),
    CommandSpec(
        'decline',
        'decline to answer an input request',
        Send(
            (CommandKind.DECLINE,),
            lambda line, view, make: make.decline(view, line.value(DECISION) or line.first_word),
            Answers(_VALUES_OF, _names_decision),
        ),
        (Argument('ID', required=False, values=_input_requests),),
        (_REASON,),
    ),
    CommandSpec(
        'pause',
        'let the run stand still',
        _send(CommandKind.PAUSE),
        options=(_REASON,),
        details=(
            'No state is executed or left, and time does not pass for them, until "resume". "stop" works as ever.',
        ),
    ),
    CommandSpec(
        'resume',
        'go on with a paused run, or with one that the end of the executive interrupted',
        Send((CommandKind.RESUME, CommandKind.RESUME_RUN), lambda line, view, make: make.resume(view)),
        options=(_REASON,),
        details=(
            'After a crash of the executive the states that were active are entered again. "abort" gives the run up.',
        ),
    ),
    CommandSpec(
        'abort',
        'give up a run that the end of the executive interrupted',
        _send(CommandKind.ABORT_RUN),
        options=(_REASON,),
    ),
    CommandSpec(
        'repeat',
        'leave a state and enter it again',
        Send((CommandKind.REPEAT,), lambda line, view, make: make.repeat(view, line.first_word)),
        (Argument('PATH', required=False, values=_active_states),),
        (_REASON,),
        details=('Without PATH: the state that waits for the operator, or else the only active state.',),
        has_arrived=_structure_known,
    ),
    CommandSpec(
        'lock',
        'keep a state or container from being left',
        _at_path(CommandKind.LOCK),
        (Argument('PATH', values=_states),),
        (_REASON,),
        details=(_PATH_DETAILS,),
        has_arrived=_structure_known,
    ),
    CommandSpec(
        'unlock',
        'undo lock',
        _at_path(CommandKind.UNLOCK),
        (Argument('PATH', values=_locked),),
        (_REASON,),
        has_arrived=_structure_known,
    ),
    CommandSpec(
        'breakpoint',
        'let every transition out of a state wait for the operator, whatever the autonomy',
        _at_path(CommandKind.BREAKPOINT),
        (Argument('PATH', values=_states),),
        (_REASON,),
        details=(_PATH_DETAILS,),
        has_arrived=_structure_known,
    ),
    CommandSpec(
        'clear',
        'clear a breakpoint',
        _at_path(CommandKind.CLEAR_BREAKPOINT),
        (Argument('PATH', values=_breakpoints),),
        (_REASON,),
        has_arrived=_structure_known,
    ),
    CommandSpec(
        'switch',
        'go on with another behavior, keeping the active states',
        Send((CommandKind.SWITCH,), lambda line, view, make: make.switch(view, line.words[0], _assignments(line))),
        (
            Argument('NAME', spaced=True, values=_behaviors),
            Argument('PARAMETER=VALUE', required=False, repeated=True, values=_parameters, read=assignment),
        ),
        (_REASON,),
        details=(
            'The other behavior has to have the active states at the same paths; the refusal names those it lacks.',
        ),
        has_arrived=_behaviors_known,
    ),
    CommandSpec(
        'synthesize',
        'have a behavior made of capabilities that reaches goals whatever fails, or be told why there is none',
        Ask(_ask_synthesis),
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
        check=_check_synthesis,
    ),
    CommandSpec(
        'claim',
        'claim the authority to command',
        _send(CommandKind.CLAIM_AUTHORITY),
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
        _send(CommandKind.RELEASE_AUTHORITY),
        options=(_REASON,),
    ),
    CommandSpec(
        'handover',
        'give the authority to another operator',
        Send(
            (CommandKind.HAND_OVER_AUTHORITY,),
            lambda line, view, make: make.hand_over_authority(view, line.first_word),
        ),
        (Argument('OPERATOR', required=False, values=_requesters),),
        (_REASON,),
        details=('Without OPERATOR: to the one who asks for it.',),
    ),
    CommandSpec(
        'note',
        'write a remark into the event log and the log of every console',
        Send(
            (CommandKind.NOTE,),
            lambda line, view, make: replace(make.command(view, CommandKind.NOTE), text=line.text),
        ),
        (Argument('TEXT', repeated=True),),
        details=(
            f'TEXT is what comes after "note", {NOTE_LENGTH} characters at most. It becomes part of the report of the '
            'run, and of its recording. It needs neither a run nor the authority.',
        ),
        check=_check_note,
    ),
    CommandSpec(
        'places',
        'list the named places: those of the robot, and those of --places',
        Show(_show_places),
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
        options=(_IN_BROWSER, _PORT, _LEAVING, _SCAN_PERIOD, _SLOW_LINK),
        details=(
            'With --web the same screen is in a browser: the address is printed, and each tab is an operator of its '
            'own, on this computer alone (from another: ssh -L 8465:localhost:8465 STATION).',
        ),
        check=_check_screen,
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
        options=(_LEAVING,),
        link=LinkNeed.NONE,
    ),
)


def find(name: str) -> CommandSpec | None:
    """The command of that name."""
    return next((spec for spec in COMMANDS if spec.name == name), None)


def build(line: CommandLine, view: View, make: CommandBuilder) -> Command:
    """Make the command for the executive that the line asks for, bound to what ``view`` shows.

    Raises:
        UsageError: it is not written as it has to be.
        RefusedError: it cannot work now.
    """
    assert line.spec is not None and isinstance(line.spec.action, Send)
    command = line.spec.action.build(line, view, make)
    return replace(command, reason=line.value(_REASON.name))

# SPDX-License-Identifier: BSD-3-Clause
"""Effects of commands: build a command for the executive, show the console's data, or query the robot."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from string import digits
from typing import Final

from flexbt_common.files import ALERTS, home_path
from flexbt_console.errors import NoAnswerError, NotShownError, RefusedError, UsageError
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import (
    LIVENESS,
    NOTE_LENGTH,
    SYNTHESIS_SECONDS,
    CommandKind,
    DecisionKind,
    OperatorCommand,
    SynthesisRequest,
)
from flexbt_console.mirror.trees import MirroredNode, MirroredTree
from flexbt_console.mirror.view import View
from flexbt_console.present.json_form import map_json, status_json, structure_json, tree_json
from flexbt_console.present.rendering import (
    behaviors_lines,
    event_line,
    log_lines,
    places_lines,
    status_lines,
    structure_lines,
    synthesis_lines,
    userdata_lines,
)
from flexbt_console.present.style import toned
from flexbt_core.values.text import did_you_mean, one_line, short_repr

from .command_builder import CommandBuilder, find_behavior
from .operator_values import assignment, autonomy_level, capability_text, line_count, map_size, retry_count, start_input
from .spec import DECISION, UNSEEN, Answers, CommandLine, Inquiry, Reading, Send


def alone(kind: CommandKind) -> Send:
    """Return a command without arguments."""
    return Send((kind,), lambda line, view, builder: builder.command(view, kind))


def at_path(kind: CommandKind) -> Send:
    """Return a command for the state or container that the line names."""
    return Send((kind,), lambda line, view, builder: builder.at_path(kind, view, line.words[0]))


def to_requester(kind: CommandKind) -> Send:
    """Return a command about an operator who requests the authority."""
    return Send((kind,), lambda line, view, builder: builder.to_requester(kind, view, line.first_word))


def check_input(line: CommandLine) -> None:
    """Raise UsageError: the line has neither a value nor the option that declines."""
    if not line.has('--decline') and not line.words:
        raise UsageError(f'usage: {line.spec.usage}')


def check_note(line: CommandLine) -> None:
    """Raise UsageError: the text is empty or too long."""
    if len(line.text) > NOTE_LENGTH:
        raise UsageError(f'the note has {len(line.text)} characters; the limit is {NOTE_LENGTH}')
    if not line.text.strip():
        raise UsageError('the note is empty')


def _assignments(line: CommandLine) -> list[tuple[str, str]]:
    return [assignment(word) for word in line.words[1:]]


def start(line: CommandLine, view: View, builder: CommandBuilder) -> OperatorCommand:
    """Return the command that starts a behavior now; of the mission queue it has the same words."""
    inputs = [start_input(text, view.places) for text in line.values('--input')]
    level = autonomy_level(line.value('--autonomy')) if line.has('--autonomy') else None
    _check_listed(line, view)
    command = builder.start(view, line.words[0], _assignments(line), level, inputs, unseen=line.has(UNSEEN))
    return replace(command, hold_queue=line.has('--hold-queue'))


def _switch(line: CommandLine, view: View, builder: CommandBuilder) -> OperatorCommand:
    _check_listed(line, view)
    return builder.switch(view, line.words[0], _assignments(line), unseen=line.has(UNSEEN))


def _check_listed(line: CommandLine, view: View) -> None:
    """Raise NotShownError: the behavior may be a synthesized one, whose machine no operator here has seen."""
    if view.behaviors is None and not line.has(UNSEEN):
        message = view.snapshot.message if view.snapshot is not None else ''
        why = f' ({one_line(message, 300)})' if message else ''
        raise NotShownError(
            f'the robot has not sent its list of behaviors and synthesized machines{why}; nothing was sent. '
            'Wait for it, or send it anyway with --unseen'
        )


def _autonomy(line: CommandLine, view: View, builder: CommandBuilder) -> OperatorCommand:
    return builder.autonomy(view, autonomy_level(line.words[0]), line.words[1] if len(line.words) > 1 else '')


def _force(line: CommandLine, view: View, builder: CommandBuilder) -> OperatorCommand:
    path, outcome = line.words if len(line.words) == 2 else ('', line.words[0])
    return builder.force(view, path, outcome, line.value(DECISION), unseen=line.has(UNSEEN))


def _input(line: CommandLine, view: View, builder: CommandBuilder) -> OperatorCommand:
    decision_id, unseen = line.value(DECISION), line.has(UNSEEN)
    if line.has('--decline'):
        return builder.decline(view, decision_id or line.first_word)
    if not decision_id and _names_input_request(line, view):
        return builder.answer(view, line.words[0], ' '.join(line.words[1:]), unseen=unseen)
    return builder.answer(view, decision_id, line.text, unseen=unseen)


def _names_decision(line: CommandLine, view: View) -> bool:
    return bool(line.words)


def _names_state(line: CommandLine, view: View) -> bool:
    return len(line.words) == 2


def _names_input_request(line: CommandLine, view: View) -> bool:
    """Return whether the first word names the request. Raise ConsoleError if it names one that has ended, or has no
    value behind it: it must not become the answer to another one."""
    named = line.first_word
    if line.has('--decline'):
        return bool(named)
    is_pending = view.pending(named) is not None
    if is_pending and len(line.words) == 1:
        raise UsageError(f'usage: {line.spec.usage}')
    if not is_pending and any(_is_numbered_as(one.id, named) for one in view.decisions):
        raise RefusedError(f'input request {short_repr(named)} is not pending; to answer this text, use --decision ID')
    return is_pending


def _is_numbered_as(decision_id: str, text: str) -> bool:
    """Return whether a text differs from the identifier of a decision only in the number at its end."""
    stem = decision_id.rstrip(digits)
    return bool(stem) and text.startswith(stem) and text.removeprefix(stem).isdigit()


_OUTCOMES: Final = frozenset({DecisionKind.TRANSITION, DecisionKind.CHOICE})
_VALUES: Final = frozenset({DecisionKind.INPUT})

START: Final = Send((CommandKind.START,), start)
SWITCH: Final = Send((CommandKind.SWITCH,), _switch)
AUTONOMY: Final = Send((CommandKind.AUTONOMY,), _autonomy)
CONFIRM: Final = Send(
    (CommandKind.CONFIRM,),
    lambda line, view, builder: builder.confirm(view, line.value(DECISION) or line.first_word, unseen=line.has(UNSEEN)),
    Answers(_OUTCOMES, _names_decision),
)
FORCE: Final = Send((CommandKind.FORCE,), _force, Answers(_OUTCOMES, _names_state, also_alone=True))
INPUT: Final = Send((CommandKind.ANSWER, CommandKind.DECLINE), _input, Answers(_VALUES, _names_input_request))
DECLINE: Final = Send(
    (CommandKind.DECLINE,),
    lambda line, view, builder: builder.decline(view, line.value(DECISION) or line.first_word),
    Answers(_VALUES, _names_decision),
)


def of_tree(kind: CommandKind) -> Send:
    """Return a command that sets or clears something at a tree: at the node, for the result, that the line names."""

    def build(line: CommandLine, view: View, builder: CommandBuilder) -> OperatorCommand:
        path, outcome = (*line.words, '', '')[:2]
        fields = {
            'path': path,
            'outcome': outcome.upper(),
            'text': line.value('--if'),
            'behavior': line.value('--tree'),
        }
        return builder.command(view, kind, tree_run_id=line.value('--run'), **fields)

    return Send((kind,), build)


def of_held_tree(kind: CommandKind) -> Send:
    """Return a command for the tree that is held, or that the line names."""

    def build(line: CommandLine, view: View, builder: CommandBuilder) -> OperatorCommand:
        return builder.at_hold(kind, view, line.value('--run'), line.first_word, line.value('--if'))

    return Send((kind,), build)


def _assign(line: CommandLine, view: View, builder: CommandBuilder) -> OperatorCommand:
    return builder.at_hold(CommandKind.TREE_SET, view, line.value('--run'), line.value('--at'), line.first_word)


ASSIGN: Final = Send((CommandKind.TREE_SET,), _assign)
"""The command that changes the blackboard of a tree that is held."""


def _step(line: CommandLine, view: View, builder: CommandBuilder) -> OperatorCommand:
    return builder.step(view, STEPS[line.words[0]], line.value(DECISION), unseen=line.has(UNSEEN))


STEPS: Final = {'into': CommandKind.STEP_INTO, 'over': CommandKind.STEP_OVER, 'out': CommandKind.STEP_OUT}
"""Kinds of steps of a state machine, by their words."""

STEP: Final = Send(tuple(STEPS.values()), _step, Answers(_OUTCOMES, lambda line, view: False))
RESUME: Final = Send((CommandKind.RESUME, CommandKind.RESUME_RUN), lambda line, view, builder: builder.resume(view))
REPEAT: Final = Send((CommandKind.REPEAT,), lambda line, view, builder: builder.repeat(view, line.first_word))
NOTE: Final = Send(
    (CommandKind.NOTE,), lambda line, view, builder: builder.command(view, CommandKind.NOTE, text=line.text)
)


# Lines that commands show: from the mirror (for :class:`.spec.Show`), or from an answer of the robot (for
# :class:`.spec.Ask`).

LOG_COUNT: Final = 20
"""Lines of the log that are shown when no number is given."""

SCAN_PERIOD: Final = 0.5
"""Seconds from one scan on the map to the next when none are given."""

SURROUNDINGS_SECONDS: Final = 2.0
"""Time for which latched messages, and a plan that is published each second, are awaited, s."""


def status(line: CommandLine, view: View, mirror: Mirror) -> Reading:
    shown = status_lines(view)
    if view.snapshot is not None and (view.snapshot.tree_holds or view.snapshot.tree_breakpoints):
        from flexbt_console.present.debugging import breakpoint_lines, held_lines  # what only this needs

        shown += [toned(f'held      {text}', text) for text in held_lines(view.snapshot)]
        shown += [toned(f'debugged  {text}', text) for text in breakpoint_lines(view.snapshot)]
    if view.snapshot is not None and (view.snapshot.queue_length or view.snapshot.queue_held):
        from flexbt_console.present.queue import queue_summary  # what only this needs

        summary = queue_summary(view)
        shown.append(toned(f'queue     {summary}', summary))
    return Reading(status_json(view), shown)


def behaviors(line: CommandLine, view: View, mirror: Mirror) -> Reading:
    if view.behaviors is None:
        raise NoAnswerError('the executive has not sent its list of behaviors')
    if line.words:
        found = (find_behavior(view.behaviors, line.text),)
        return Reading(found, behaviors_lines(found, with_machines=True))
    return Reading(view.behaviors, behaviors_lines(view.behaviors))


def structure(line: CommandLine, view: View, mirror: Mirror) -> Reading:
    if view.snapshot is None or not view.snapshot.run_id:
        raise RefusedError('nothing has run yet: there is no state machine to show')
    if view.structure is None:
        raise NoAnswerError('the state machine of the run has not arrived')
    return Reading(structure_json(view.structure), structure_lines(view.structure, view))


def log(line: CommandLine, view: View, mirror: Mirror) -> Reading:
    entries = mirror.log(line_count(line.words[0]) if line.words else LOG_COUNT)
    text = [text for entry in entries for text in log_lines(entry, with_time=True)]
    return Reading(entries, text or ['the log is empty'])


def events(line: CommandLine, view: View, mirror: Mirror) -> Reading:
    events = mirror.events(line_count(line.words[0]) if line.words else LOG_COUNT)
    return Reading(events, [event_line(event, with_time=True) for event in events] or ['nothing has happened yet'])


def places(line: CommandLine, view: View, mirror: Mirror) -> Reading:
    return Reading(view.places, places_lines(view.places))


def userdata(line: CommandLine, inquiry: Inquiry) -> Reading:
    path, keys = (line.words[0], line.words[1:]) if line.first_word.startswith('/') else ('', line.words)
    scopes = inquiry.robot.userdata(path, keys, inquiry.timeout)
    return Reading(scopes, userdata_lines(scopes))


def incident(_line: CommandLine, inquiry: Inquiry) -> Reading:
    folder = inquiry.robot.write_incident(inquiry.timeout)
    return Reading({'folder': folder}, [f'an incident is written, on the robot: {one_line(folder)}'])


def acknowledge(line: CommandLine, inquiry: Inquiry) -> Reading:
    acknowledged = inquiry.acknowledge(home_path(line.value('--state') or ALERTS), [*map(int, line.words)])
    return Reading({'acknowledged': acknowledged}, [f'acknowledged {text}' for text in acknowledged])


def tree(line: CommandLine, inquiry: Inquiry) -> Reading:
    from flexbt_console.present.debugging import marks_of_nodes  # what only this needs
    from flexbt_console.present.style import glyphs
    from flexbt_console.present.tree_lines import chains_of_failures, whole_tree_lines

    def told(view: View) -> list[MirroredTree]:
        return [run for run in view.trees if run.sequence > 0]

    def missing(view: View) -> set[str]:
        named = {state.tree_run_id for state in view.snapshot.active_states} if view.snapshot else set()
        return named - {'', *(run.run_id for run in told(view))}

    def has_arrived(view: View) -> bool:
        return bool(told(view)) and not missing(view)  # where no state names its tree there may be none at all

    view = inquiry.robot.surroundings(has_arrived, min(inquiry.timeout, SURROUNDINGS_SECONDS))
    if missing(view):
        raise NoAnswerError('a tree runs, but its nodes have not arrived; is the BT server in the same namespace?')
    if not told(view):
        raise RefusedError('no tree has run yet, or the BT server is gone')
    runs = view.running_trees or told(view)[:1]
    snapshot = view.snapshot
    trees = (whole_tree_lines(run, glyphs(), marks_of_nodes(snapshot, run)) for run in runs)
    shown = [line for lines in trees for line in ('', *lines)][1:]
    return Reading([tree_json(run, chains_of_failures(run)) for run in runs], shown)


def tree_why(line: CommandLine, inquiry: Inquiry) -> Reading:
    from flexbt_console.present.debugging import why_lines  # what only this needs

    run, node, view = _node_of_tree(line, inquiry)
    lines = why_lines(run, node.uid, view.snapshot)
    return Reading({'run_id': run.run_id, 'node': node.path, 'why': [str(one) for one in lines]}, lines)


def _node_of_tree(line: CommandLine, inquiry: Inquiry) -> tuple[MirroredTree, MirroredNode, View]:
    view = inquiry.robot.surroundings(lambda view: bool(view.running_trees), min(inquiry.timeout, SURROUNDINGS_SECONDS))
    runs = [run for run in view.trees if run.sequence > 0 and line.value('--run') in ('', run.run_id)]
    runs = [run for run in runs if run.is_running] or runs[:1]
    if not runs:
        raise RefusedError('no such tree has run, or the BT server is gone')
    name = line.words[0]
    nodes = [(run, node) for run in runs for node in run.nodes]
    found = [one for one in nodes if name == one[1].path] or [
        one for one in nodes if f'/{one[1].path}'.endswith(f'/{name}') or one[1].name == name
    ]
    if len(found) != 1:
        paths = ', '.join(one_line(node.path) for _, node in found[:10])
        hint = f'is ambiguous: {paths}' if found else 'is no node' + did_you_mean(name, {one.name for _, one in nodes})
        raise RefusedError(f'{short_repr(name)} {hint}')
    return (*found[0], view)


def tree_blackboard(line: CommandLine, inquiry: Inquiry) -> Reading:
    from flexbt_console.present.debugging import blackboard_lines  # what only this needs

    board = inquiry.robot.blackboard(line.value('--run'), line.words, inquiry.timeout)
    return Reading(board, blackboard_lines(board))


def map_of_robot(line: CommandLine, inquiry: Inquiry) -> Reading:
    from flexbt_console.present.maps import map_lines, save_map  # what only this needs

    wants_scan = line.has('--scan')

    def has_arrived(view: View) -> bool:
        around = view.drawn
        wanted = (around.map, around.plan or not view.drives, around.scan or not wants_scan)
        has_subject = view.decision is None or not view.lacks(view.decision)
        return view.has_places and has_subject and all(wanted)

    view = inquiry.robot.surroundings(
        has_arrived, min(inquiry.timeout, SURROUNDINGS_SECONDS), SCAN_PERIOD if wants_scan else 0.0
    )
    if view.drawn.map is None and view.robot_pose is None:
        raise NoAnswerError('neither a map nor the pose of the robot has arrived')
    value = map_json(view)
    if line.has('--png'):
        file = Path(line.value('--png'))
        save_map(file, view)
        return Reading({**value, 'file': str(file)}, [f'the map is in {one_line(str(file))}'])
    return Reading(value, map_lines(view, map_size(line.value('--size'))))


def synthesis(line: CommandLine, inquiry: Inquiry) -> Reading:
    if line.has('--cancel'):
        count = inquiry.robot.cancel_synthesis(inquiry.timeout)
        if not count:
            raise RefusedError('no synthesis is running')
        return Reading(count, ['the synthesis is canceled'])
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
    made = inquiry.robot.synthesis(request, inquiry.timeout, inquiry.tell, inquiry.left)
    return Reading(made, synthesis_lines(made), is_refusal=not made.behavior)


def check_synthesis(line: CommandLine) -> None:
    if line.has('--cancel'):
        own = {option.name for option in line.spec.options}
        if line.words or own & line.options.keys() != {'--cancel'}:
            raise UsageError('--cancel takes no other words: it ends the running synthesis')
    elif line.has('--file') == bool(line.words):
        raise UsageError('name a SYSTEM that the robot knows, or use --file with a capability file on this computer')

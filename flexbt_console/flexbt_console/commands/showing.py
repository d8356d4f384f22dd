# SPDX-License-Identifier: BSD-3-Clause
"""What lines show: of the picture that the console has (for :class:`.spec.Show`), or by asking the robot (for
:class:`.spec.Ask`)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

from flexbt_console.errors import NoAnswerError, RefusedError, UsageError
from flexbt_console.mirror import LIVENESS, SYNTHESIS_SECONDS, SynthesisRequest, TreeRun, View
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

from .command_builder import find_behavior
from .operator_values import capability_text, line_count, map_size, retry_count
from .spec import AskedRobot, CommandLine, Known, Shown

LOG_COUNT: Final = 20
"""Lines of the log that are shown when no number is given."""

SCAN_PERIOD: Final = 0.5
"""Seconds from one scan on the map to the next when none are given."""

SURROUNDINGS_SECONDS: Final = 2.0
"""So long what is latched, and a plan that is told each second, is waited for."""


def status(line: CommandLine, view: View, known: Known) -> Shown:
    return Shown(status_json(view), status_lines(view))


def behaviors(line: CommandLine, view: View, known: Known) -> Shown:
    if view.behaviors is None:
        raise NoAnswerError('the executive has not said which behaviors it has')
    if line.words:
        found = (find_behavior(view.behaviors, line.text),)
        return Shown(found, behaviors_lines(found, with_machines=True))
    return Shown(view.behaviors, behaviors_lines(view.behaviors))


def structure(line: CommandLine, view: View, known: Known) -> Shown:
    if view.snapshot is None or not view.snapshot.run_id:
        raise RefusedError('nothing has run yet: there is no state machine to show')
    if view.structure is None:
        raise NoAnswerError('the state machine of the run has not arrived')
    return Shown(structure_json(view.structure), structure_lines(view.structure, view))


def log(line: CommandLine, view: View, known: Known) -> Shown:
    entries = known.log(line_count(line.words[0]) if line.words else LOG_COUNT)
    text = [text for entry in entries for text in log_lines(entry, with_time=True)]
    return Shown(entries, text or ['the log is empty'])


def events(line: CommandLine, view: View, known: Known) -> Shown:
    events = known.events(line_count(line.words[0]) if line.words else LOG_COUNT)
    return Shown(events, [event_line(event, with_time=True) for event in events] or ['nothing has happened yet'])


def places(line: CommandLine, view: View, known: Known) -> Shown:
    return Shown(view.places, places_lines(view.places))


def userdata(line: CommandLine, robot: AskedRobot, timeout: float, tell: Callable[[str], None]) -> Shown:
    path, *keys = line.words or ('',)
    scopes = robot.userdata(path, keys, timeout)
    return Shown(scopes, userdata_lines(scopes))


def tree(line: CommandLine, robot: AskedRobot, timeout: float, tell: Callable[[str], None]) -> Shown:
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


def map_of_robot(line: CommandLine, robot: AskedRobot, timeout: float, tell: Callable[[str], None]) -> Shown:
    from flexbt_console.pictures import map_lines, save_map  # what only this needs

    wants_scan = line.has('--scan')

    def has_arrived(view: View) -> bool:
        around, snapshot = view.drawn, view.snapshot
        drives = snapshot is not None and any(state.progress is not None for state in snapshot.active_states)
        wanted = (around.map, around.plan or not drives, around.scan or not wants_scan)
        has_subject = view.decision is None or not view.lacks(view.decision)
        return view.has_places and has_subject and all(wanted)

    view = robot.surroundings(has_arrived, min(timeout, SURROUNDINGS_SECONDS), SCAN_PERIOD if wants_scan else 0.0)
    around, pose = view.drawn, view.snapshot.robot_pose if view.snapshot else None
    if around.map is None and pose is None:
        raise NoAnswerError('neither a map nor the pose of the robot has arrived')
    value = map_json(view)
    if line.has('--png'):
        file = Path(line.value('--png'))
        save_map(file, around, pose, view.places)
        return Shown({**value, 'file': str(file)}, [f'the map is in {one_line(str(file))}'])
    return Shown(value, map_lines(view, map_size(line.value('--size'))))


def synthesis(line: CommandLine, robot: AskedRobot, timeout: float, tell: Callable[[str], None]) -> Shown:
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


def check_synthesis(line: CommandLine) -> None:
    if line.has('--cancel'):
        own = {option.name for option in line.spec.options} if line.spec is not None else set()
        if line.words or own & line.options.keys() != {'--cancel'}:
            raise UsageError('--cancel stands alone: it ends the synthesis that is under way')
    elif line.has('--file') == bool(line.words):
        raise UsageError('name the SYSTEM that the robot knows, or a file of capabilities of this computer by --file')

# SPDX-License-Identifier: BSD-3-Clause
"""Counterexamples as files: sequence diagrams, and recordings for the console."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, Final

from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_formal.exploration.explorer import Moment, walk
from flexbt_formal.exploration.machine_system import MachineSystem
from flexbt_formal.exploration.model import OPERATOR, Counterexample, Move, Report, System
from flexbt_formal.exploration.tree_system import TreeSystem
from flexbt_tools.errors import UsageError
from flexbt_tools.files import write_text_file

from .sequence_picture import Arrow, Note, SequenceDiagram, sequence_as_mermaid, sequence_as_svg

_MERMAID: Final = ('.mmd', '.mermaid')
DIAGRAMS: Final = ('.svg', *_MERMAID)
"""Suffixes of the files of diagrams."""


def draw_diagram(file: str, diagram: SequenceDiagram) -> None:
    """Write a diagram: Mermaid for a file name in .mmd, otherwise SVG. Raises UsageError."""
    is_mermaid = Path(file).suffix.lower() in _MERMAID
    write_text_file(file, '\n'.join(sequence_as_mermaid(diagram)) + '\n' if is_mermaid else sequence_as_svg(diagram))


def draw_counterexamples(file: str, reports: Sequence[Report]) -> list[str]:
    """Write a diagram for each counterexample, and return the files: FILE, numbered before the suffix if several.

    Raises UsageError.
    """
    found = _found(reports)
    path = Path(file)
    files = [
        file if number == 1 else str(path.with_name(f'{path.stem}-{number}{path.suffix}'))
        for number in range(1, len(found) + 1)
    ]
    for one, (report, counterexample) in zip(files, found, strict=True):
        draw_diagram(one, counterexample_diagram(report, counterexample))
    return files


def record_counterexamples(file: str, reports: Sequence[Report]) -> None:
    """Write all counterexamples into one recording. Raises UsageError, also if the file exists."""
    from .recording import record  # a slow import: ROS and MCAP

    try:
        record(Path(file), _found(reports))
    except OSError as error:
        raise UsageError(f'{file}: cannot be written: {error.strerror or error}') from error


def _found(reports: Sequence[Report]) -> list[tuple[Report, Counterexample]]:
    return [(report, one) for report in reports for one in report.counterexamples]


# The shortest path to a violation, step by step, for a player on the graph.


def played(make: Callable[[], System], moves: Iterable[Move]) -> list[dict[str, Any]]:
    """Replay the way to something wrong or to a difference, and return its steps, from the beginning on, as plain data.

    ``step`` says what happens, ``lines`` what follows. ``statuses`` are those of the nodes by path: the latest result
    of a node that was ticked in this step, or RUNNING. In a machine, the active states are RUNNING.
    """
    made: list[System] = []
    statuses: dict[str, str] = {}

    def observed() -> System:
        system = make()
        made.append(system)
        if isinstance(system, TreeSystem):
            system.tree.observe(*system.tree.observers, note)
        return system

    def note(node: TreeNode, before: NodeStatus, after: NodeStatus) -> None:
        if after is not NodeStatus.IDLE:
            statuses[node.path] = after.name
        elif statuses.get(node.path) == NodeStatus.RUNNING.name:
            statuses[node.path] = after.name  # it was halted

    steps: list[dict[str, Any]] = [{'step': 'it begins', 'lines': [make().position()], 'statuses': {}}]
    for moment in walk(observed, moves):
        system = made[-1]
        if isinstance(system, MachineSystem):
            statuses = {state.path: NodeStatus.RUNNING.name for state in system.run.active_states()}
        steps.append({'step': str(moment), 'lines': moment.happened, 'statuses': dict(statuses)})
        for path in [path for path, status in statuses.items() if status != NodeStatus.RUNNING.name]:
            del statuses[path]
    return steps


# The shortest path to a violation as a sequence diagram: the actor of each step, and the events that followed.


def counterexample_diagram(report: Report, found: Counterexample) -> SequenceDiagram:
    """Replay a counterexample, and return its diagram."""
    assert report.make is not None
    system = report.make()
    engine = 'tree' if isinstance(system, TreeSystem) else 'machine'
    steps: list[Arrow | Note] = []
    actors: list[str] = []
    told = [system.position()]
    for moment in walk(report.make, found.moves):
        steps += [Note(engine, told)] if steps else []
        actor = moment.label.actor
        steps.append(Arrow(actor or engine, engine, _text(moment)))
        actors += [actor] if actor not in ('', OPERATOR, *actors) else []
        told = moment.happened
    steps.append(Note(engine, told))
    steps.append(
        Note(
            engine, [f'WRONG: {found.violation.text}', f'It should be: {found.violation.property.value}'], is_wrong=True
        )
    )
    with_operator = [OPERATOR] if any(isinstance(step, Arrow) and step.start == OPERATOR for step in steps) else []
    return SequenceDiagram(f'{report.name}: {found.violation.text}', [*with_operator, engine, *actors], steps)


def _text(moment: Moment) -> str:
    kind, _, value = moment.label
    chosen = f' ({moment.chosen})' if moment.chosen else ''
    what = kind.removeprefix(OPERATOR).strip()
    of = f' {moment.label.subject}' if moment.label.actor == OPERATOR and moment.label.subject else ''
    return f'{what}{of}{f": {value}" if value else ""}{chosen}'

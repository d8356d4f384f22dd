# SPDX-License-Identifier: BSD-3-Clause
"""The shortest way to what is wrong, as a sequence diagram: who made which step happen, and what followed."""

from __future__ import annotations

from flexbt_common.pictures import Arrow, Note, SequenceDiagram
from flexbt_formal.exploration import OPERATOR, Counterexample, Moment, Report, TreeSystem, walk


def counterexample_diagram(report: Report, found: Counterexample) -> SequenceDiagram:
    """The diagram of what an exploration has found; its steps are made anew."""
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

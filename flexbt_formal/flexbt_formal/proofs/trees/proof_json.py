# SPDX-License-Identifier: BSD-3-Clause
"""What a proof has found, for programs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from flexbt_formal.exploration import Counterexample, Property, Report, System, Violation

from .moves import moves_of, plain_moves


def report_as_json(report: Report) -> dict[str, Any]:
    """A report for programs."""
    return {
        'name': report.name,
        'bounds': report.bounds,
        'complete': report.is_complete,
        'stopped_by': report.stopped_by,
        'configurations': report.configurations,
        'steps': report.steps,
        'depth': report.depth,
        'seconds': round(report.seconds, 3),
        'ends': dict(report.ends),
        'written': {name: sorted(keys) for name, keys in sorted(report.written.items())},
        'covered': report.covered,
        'coverable': report.coverable,
        'never': list(report.uncovered),
        'notes': list(report.notes),
        'wrong': [
            {
                'property': found.violation.property.name,
                'where': found.violation.where,
                'text': found.violation.text,
                'moves': plain_moves(found.moves),
                'way': list(found.lines),
            }
            for found in report.counterexamples
        ],
    }


def report_of(plain: dict[str, Any], make: Callable[[], System]) -> Report:
    """The report of which this is the JSON, about what ``make`` makes.

    Raises KeyError, TypeError or ValueError when it is of none.
    """
    return Report(
        name=plain['name'],
        bounds=plain['bounds'],
        is_complete=plain['complete'],
        stopped_by=plain['stopped_by'],
        configurations=plain['configurations'],
        steps=plain['steps'],
        depth=plain['depth'],
        seconds=plain['seconds'],
        counterexamples=tuple(
            Counterexample(
                Violation(Property[one['property']], one['where'], one['text']),
                moves_of(one['moves']),
                tuple(one['way']),
            )
            for one in plain['wrong']
        ),
        notes=tuple(plain['notes']),
        ends=plain['ends'],
        covered=plain['covered'],
        coverable=plain['coverable'],
        uncovered=tuple(plain['never']),
        written={name: frozenset(keys) for name, keys in plain['written'].items()},
        make=make,
    )

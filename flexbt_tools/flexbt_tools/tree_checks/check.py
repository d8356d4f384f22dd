# SPDX-License-Identifier: BSD-3-Clause
"""Everything that is wrong, or suspicious, in tree files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from importlib.metadata import entry_points
from typing import Final

from flexbt_core.behavior_tree import NodeRegistry, TreeLibrary
from flexbt_core.skills import SkillLibrary
from flexbt_tools.errors import RefusedError
from flexbt_tools.trees import read_library, shown_name

from .copies import copies
from .diagnostics import REFUSED, Diagnostic
from .lint import findings
from .meanings import mixed_up

ENTRY_POINTS: Final = 'flexbt.tree_checks'
"""Group of the entry points by which a package adds checks: functions of library and registry that yield findings."""

_NO_SKILLS: Final = SkillLibrary()


def check_trees(
    files: Sequence[str],
    registry: NodeRegistry,
    inputs: Sequence[str] = (),
    *,
    shared: bool = False,
    skills: SkillLibrary = _NO_SKILLS,
) -> list[Diagnostic]:
    """What is found in the files, in the order of files and places. Findings that are no errors are looked for when
    there are no errors. ``skills`` are those that files declare, in the place of those of the classes."""
    try:
        library = read_library(files, registry)
    except RefusedError as error:
        found = [Diagnostic(REFUSED, reason) for reason in error.errors]
    else:
        own = findings(library, inputs, shared=shared, skills=skills)
        all_found = [*own, *copies(library, registry), *mixed_up(library, registry), *_added(library, registry)]
        found = list(dict.fromkeys(all_found))
    order = {shown_name(file): index for index, file in enumerate(files)}
    return sorted(
        found,
        key=lambda one: (order.get(one.place.file, len(order)), one.place.file, one.place.line, one.place.column),
    )


def _added(library: TreeLibrary, registry: NodeRegistry) -> Iterable[Diagnostic]:
    for point in sorted(entry_points(group=ENTRY_POINTS)):
        yield from point.load()(library, registry)


def joined(diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
    """Findings for people: node types that are not registered are one for each file, at the first of their nodes."""
    found: dict[tuple[str, int], list[Diagnostic]] = {}
    for number, one in enumerate(diagnostics):
        found.setdefault((one.place.file, -1 if one.place.unknown else number), []).append(one)
    return [one[0] if not one[0].place.unknown else _unknown_types(one) for one in found.values()]


def _unknown_types(errors: list[Diagnostic]) -> Diagnostic:
    nodes = [one.place for one in errors]
    types = list(dict.fromkeys(f'[{one.unknown}]' for one in nodes))
    told = nodes[0].message if len(types) == 1 else f'node types {", ".join(types)} are not registered'
    several = f' ({len(nodes)} nodes)' if len(nodes) > len(types) else ''
    remedy = 'install their package, describe them by --models FILE, or check the rest by --allow-unknown'
    message = f'{told}{several}; {remedy}'
    return Diagnostic(REFUSED, replace(nodes[0], node='' if len(types) > 1 else nodes[0].node, message=message))

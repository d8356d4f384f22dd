# SPDX-License-Identifier: BSD-3-Clause
"""Everything that is wrong, or suspicious, in tree files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final

from flexbt_core.behavior_tree import LoadError, NodeRegistry
from flexbt_core.skills import SkillLibrary
from flexbt_tools.errors import RefusedError
from flexbt_tools.trees import read_library, shown_name

from .diagnostics import REFUSED, Diagnostic
from .lint import findings

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
        found = [Diagnostic(REFUSED, reason) for reason in _joined(error.errors)]
    else:
        found = list(dict.fromkeys(findings(library, inputs, shared=shared, skills=skills)))
    order = {shown_name(file): index for index, file in enumerate(files)}
    return sorted(
        found,
        key=lambda one: (order.get(one.place.file, len(order)), one.place.file, one.place.line, one.place.column),
    )


def _joined(errors: Iterable[LoadError]) -> list[LoadError]:
    """The errors, those of node types that are not registered as one for each file, at the first of their nodes."""
    found: list[LoadError] = []
    unknown: dict[str, list[LoadError]] = {}
    for error in errors:
        (unknown.setdefault(error.file, []) if error.unknown else found).append(error)
    for nodes in unknown.values():
        types = list(dict.fromkeys(f'[{one.unknown}]' for one in nodes))
        told = nodes[0].message if len(types) == 1 else f'node types {", ".join(types)} are not registered'
        several = f' ({len(nodes)} nodes)' if len(nodes) > len(types) else ''
        remedy = 'install their package, describe them by --models FILE, or check the rest by --allow-unknown'
        found.append(
            replace(nodes[0], node='' if len(types) > 1 else nodes[0].node, message=f'{told}{several}; {remedy}')
        )
    return found

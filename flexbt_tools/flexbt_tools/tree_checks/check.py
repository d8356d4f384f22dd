# SPDX-License-Identifier: BSD-3-Clause
"""Everything that is wrong, or suspicious, in tree files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from flexbt_core.behavior_tree import NodeRegistry
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
        found = [Diagnostic(REFUSED, reason) for reason in error.errors]
    else:
        found = list(dict.fromkeys(findings(library, inputs, shared=shared, skills=skills)))
    order = {shown_name(file): index for index, file in enumerate(files)}
    return sorted(
        found,
        key=lambda one: (order.get(one.place.file, len(order)), one.place.file, one.place.line, one.place.column),
    )

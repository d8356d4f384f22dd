# SPDX-License-Identifier: BSD-3-Clause
"""Monitoring of runs: the requirements to watch, and the reports of violations."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

from .properties import Property, Violation
from .requirement_text import StatedRequirement, Vocabulary, problems_with
from .requirements import PROVED_ONLY, Requirement

MAX_REPORTED: Final = 20
"""Maximum number of reported violations per run, so that they do not fill the log."""


@dataclass(frozen=True)
class Monitoring:
    """The settings for monitoring runs. ``requirements`` are by the name of a behavior or the ID of a tree.

    ``stops``: stop a run on a violation.
    """

    is_on: bool = False
    stops: bool = False
    requirements: Mapping[str, tuple[StatedRequirement, ...]] = field(default_factory=dict)

    def requirements_of(self, name: str) -> tuple[Requirement, ...]:
        """Return the requirements that a monitor can watch in a run."""
        stated = (one.requirement for one in self.requirements.get(name, ()))
        return tuple(one for one in stated if not isinstance(one, PROVED_ONLY))

    def problems_of(self, name: str, known: Vocabulary) -> list[str]:
        """Return the problems with requirements that name missing parts, which no monitor can watch."""
        return problems_with(self.requirements.get(name, ()), known, name)


class Findings:
    """The violations found in one run; ``tell`` is called once for each, at most :data:`MAX_REPORTED` times."""

    def __init__(self, tell: Callable[[Violation], None]) -> None:
        self.first: Violation | None = None
        self._tell = tell
        self._told: set[Violation] = set()

    def add(self, violation: Violation) -> None:
        """Add a violation that a monitor has found."""
        if violation in self._told or len(self._told) >= MAX_REPORTED:
            return
        self._told.add(violation)
        self.first = self.first or violation
        self._tell(violation)


def violation_text(violation: Violation) -> str:
    """Return the text of a violation for operators."""
    rule = '' if violation.property is Property.REQUIREMENT else f' (it should be: {violation.property.value})'
    return f'monitor: {violation.text}{rule}'

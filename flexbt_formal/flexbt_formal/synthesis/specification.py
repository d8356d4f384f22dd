# SPDX-License-Identifier: BSD-3-Clause
"""A GR(1) specification: the possible moves of the world, and what is guaranteed against all of them.

In each step the world moves first (values of the inputs), then the system, which sees that move (values of the
outputs). The specification is (θe ∧ □ρe ∧ ⋀□◇A) → (θs ∧ □ρs ∧ ⋀□◇G), read step by step: the system keeps ρs as long
as the world has kept ρe. (Bloem, Jobstmann, Piterman, Pnueli, Sa'ar: Synthesis of reactive(1) designs, 2012.)
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import Enum

from .formulas import Formula, Ranges, VariableName


class Section(Enum):
    """The section of a line of a specification; the values are the names in files."""

    ENV_INIT = 'ENV_INIT'
    SYS_INIT = 'SYS_INIT'
    ENV_TRANS = 'ENV_TRANS'
    SYS_TRANS = 'SYS_TRANS'
    ENV_LIVENESS = 'ENV_LIVENESS'
    SYS_LIVENESS = 'SYS_LIVENESS'


@dataclass(frozen=True, slots=True)
class GameVariable:
    """An input or output: a Boolean, or (``bounds``) an integer from the least to the greatest value."""

    name: str
    is_input: bool
    bounds: tuple[int, int] | None = None

    @property
    def values(self) -> range:
        """All values; 0 and 1 for a Boolean."""
        low, high = self.bounds or (0, 1)
        return range(low, high + 1)


@dataclass(frozen=True, slots=True)
class SpecificationLine:
    """A formula of a section.

    ``origin`` is the author's own text, with its place in the file. It is None for a formula that every specification
    has, such as that exactly one capability is active; then ``rule`` describes it.
    """

    section: Section
    text: str
    formula: Formula
    origin: str | None = None
    rule: str = ''

    @property
    def meaning(self) -> str:
        """Text of the line for messages."""
        return self.origin or self.rule or self.text


@dataclass(frozen=True, slots=True)
class Specification:
    """The variables, and formulas about them.

    - ``live``: pairs of formulas, an activation and an outcome in the next step. If the activation holds infinitely
      often in the same state, the outcome follows at some time. The world chooses what comes with it.
    - ``last_resort``: holds for moves that give up. Such a move is allowed only where no outcome of the world lets
      ``hopes`` hold infinitely often.
    - ``idle``: outputs that stay false unless they are needed.
    """

    variables: Mapping[str, GameVariable]
    lines: tuple[SpecificationLine, ...]
    live: tuple[tuple[Formula, Formula], ...] = ()
    last_resort: Formula | None = None
    hopes: tuple[Formula, ...] = ()
    idle: frozenset[str] = frozenset()

    @property
    def ranges(self) -> Ranges:
        """Values that the variables of a formula may have."""
        return {name: variable.bounds for name, variable in self.variables.items()}

    def of(self, section: Section) -> list[Formula]:
        """Return the formulas of a section."""
        return [line.formula for line in self.lines if line.section is section]

    def names(self, *, inputs: bool, primed: bool = False) -> list[VariableName]:
        """Return the inputs, or the outputs, in the order of their declaration."""
        return [VariableName(one.name, primed) for one in self.variables.values() if one.is_input is inputs]

    def without(self, origins: Iterable[str]) -> Specification:
        """Return the specification without the lines of these origins."""
        dropped = set(origins)
        return replace(self, lines=tuple(line for line in self.lines if line.origin not in dropped))

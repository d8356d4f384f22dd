# SPDX-License-Identifier: BSD-3-Clause
"""Formulas as binary decision diagrams, by the library dd: CUDD where its wheel has it, else in pure Python."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Iterator, Mapping
from functools import reduce
from typing import Any, Final

from .errors import SynthesisError
from .formulas import COMPARE, Compare, Formula, Join, Not, Number, Sum, Term, Truth, Valuation, VariableName
from .specification import GameVariable, Specification

Diagram = Any
"""A set of valuations; ``&``, ``|`` and ``~`` are those of sets."""

MAX_VALUES: Final = 4096
"""Maximum number of values of an integer or a sum."""


class Encoding:
    """Diagrams over the variables of a specification, of this step and of the next."""

    def __init__(self, specification: Specification) -> None:
        self._variables = specification.variables
        self._bdd = _manager()
        self._bits: dict[VariableName, list[str]] = {}
        for _, variable in sorted(specification.variables.items()):  # those of a capability are beside each other
            self._declare(variable)
        self.true: Diagram = self._bdd.true
        self.false: Diagram = self._bdd.false
        self._prime = {
            now: then
            for name in self._bits
            if not name.primed
            for now, then in zip(self._bits[name], self._bits[VariableName(name.name, True)], strict=True)
        }
        self._of: dict[Formula, Diagram] = {}

    def _declare(self, variable: GameVariable) -> None:
        if len(variable.values) > MAX_VALUES:
            raise SynthesisError([f"'{variable.name}' has {len(variable.values)} values; {MAX_VALUES} are possible"])
        now, then = VariableName(variable.name), VariableName(variable.name, True)
        width = max(1, (len(variable.values) - 1).bit_length())
        self._bits[now] = [f'{now}@{bit}' for bit in range(width)]
        self._bits[then] = [f'{then}@{bit}' for bit in range(width)]
        for pair in zip(self._bits[now], self._bits[then], strict=True):
            self._bdd.declare(*pair)

    # -- sets --------------------------------------------------------------------------------------------------------

    def set_of(self, formula: Formula) -> Diagram:
        """Return the valuations that satisfy a formula."""
        known = self._of.get(formula)
        if known is None:
            known = self._of[formula] = self._made(formula)
        return known

    def all_of(self, formulas: Iterable[Formula]) -> Diagram:
        """Return the valuations that satisfy every formula."""
        return reduce(operator.and_, map(self.set_of, formulas), self.true)

    def in_range(self, names: Iterable[VariableName]) -> Diagram:
        """Return the valuations in which integers have no more than their values."""
        found = self.true
        for name in names:
            if len(self._values(name)) != 1 << len(self._bits[name]):
                found = found & self._any(self._values(name).values())
        return found

    def primed(self, states: Diagram) -> Diagram:
        """Return a set of valuations of this step, as valuations of the next step."""
        return self._bdd.let(self._prime, states)

    def unprimed(self, states: Diagram) -> Diagram:
        """Return a set of valuations of the next step, as valuations of this step."""
        return self._bdd.let({then: now for now, then in self._prime.items()}, states)

    def some(self, names: Iterable[VariableName], of: Diagram) -> Diagram:
        """Return the valuations for which values of ``names`` exist with which they are in the set."""
        return self._bdd.exist([bit for name in names for bit in self._bits[name]], of)

    def all(self, names: Iterable[VariableName], of: Diagram) -> Diagram:
        """Return the valuations that are in the set with all values of ``names``."""
        return self._bdd.forall([bit for name in names for bit in self._bits[name]], of)

    # -- valuations --------------------------------------------------------------------------------------------------

    def given(self, valuation: Valuation, of: Diagram) -> Diagram:
        """Return what remains of a set when some variables have values."""
        return self._bdd.let(
            {
                bit: bool((value - self._low(name)) >> index & 1)
                for name, value in valuation.items()
                for index, bit in enumerate(self._bits[name])
            },
            of,
        )

    def members(self, names: list[VariableName], of: Diagram) -> Iterator[dict[VariableName, int]]:
        """Yield the valuations of ``names`` in a set that depends on no others, in the order of names and values."""
        if of == self.false:
            return
        if not names:
            yield {}
            return
        name, rest = names[0], names[1:]
        for value in self._variables[name.name].values:
            for member in self.members(rest, self.given({name: value}, of)):
                yield {name: value, **member}

    def nearest(self, names: list[VariableName], of: Diagram, wanted: Valuation) -> dict[VariableName, int]:
        """Return the valuation in a set that differs last from what is ``wanted``, in the order of names."""
        found: dict[VariableName, int] = {}
        for name in names:
            values = self._variables[name.name].values
            for value in (wanted.get(name, values[0]), *values):
                remaining = self.given({name: value}, of)
                if remaining != self.false:
                    found[name], of = value, remaining
                    break
            else:
                raise ValueError('the set is empty')
        return found

    def has(self, valuation: Valuation, in_: Diagram) -> bool:
        """Return whether a valuation of all variables on which the set depends is in it."""
        return self.given(valuation, in_) == self.true

    # -- formulas ----------------------------------------------------------------------------------------------------

    def _made(self, formula: Formula) -> Diagram:
        match formula:
            case VariableName():
                return self._bdd.var(self._bits[formula][0])
            case Truth(value):
                return self.true if value else self.false
            case Not(part):
                return ~self.set_of(part)
            case Compare(op, left, right):
                ours, theirs = self._values(left), self._values(right)
                return self._any(a & b for x, a in ours.items() for y, b in theirs.items() if COMPARE[op](x, y))
            case Join('&', parts):
                return self.all_of(parts)
            case Join('|', parts):
                return self._any(map(self.set_of, parts))
            case Join(op, parts):
                found = self.set_of(parts[0])
                for part in parts[1:]:
                    other = self.set_of(part)
                    found = ~found | other if op == '->' else (found & ~other) | (~found & other)
                    found = ~found if op == '<->' else found
                return found

    def _values(self, term: Term) -> Mapping[int, Diagram]:
        """Return, for each value of a term, the valuations that give it this value."""
        match term:
            case Number(value):
                return {value: self.true}
            case VariableName():
                low = self._low(term)
                bits = list(enumerate(self._bits[term]))
                return {
                    value: self._bdd.cube({bit: bool((value - low) >> index & 1) for index, bit in bits})
                    for value in self._variables[term.name].values
                }
            case Sum(op, left, right):
                ours, theirs = self._values(left), self._values(right)
                if len(ours) * len(theirs) > MAX_VALUES:
                    raise SynthesisError([f"'{term}' has more than {MAX_VALUES} pairs of values"])
                found: dict[int, Diagram] = {}
                for x, a in ours.items():
                    for y, b in theirs.items():
                        value = x + y if op == '+' else x - y
                        found[value] = found.get(value, self.false) | (a & b)
                return found

    def _any(self, sets: Iterable[Diagram]) -> Diagram:
        return reduce(operator.or_, sets, self.false)

    def _low(self, name: VariableName) -> int:
        return self._variables[name.name].values[0]


def _manager() -> Any:
    try:
        from dd import cudd
    except ImportError:
        try:
            from dd import autoref
        except ImportError as error:
            raise SynthesisError(
                [f"synthesis needs the library dd: pip install 'flexbt_formal[synthesis]' ({error})"]
            ) from error
        return autoref.BDD()
    manager = cudd.BDD()
    manager.configure(reordering=True)
    return manager

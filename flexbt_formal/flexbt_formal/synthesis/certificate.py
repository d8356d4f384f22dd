# SPDX-License-Identifier: BSD-3-Clause
"""Check a strategy against its specification without the solver, by enumeration.

Formulas are evaluated as they were parsed, and the moves of the world are enumerated one variable after the other.
That each guarantee is met again and again follows from the ranks: a move that does not meet the guarantee of its node
leads to a node of lower rank, or waits at the same rank while the assumption of the node does not hold, or (nodes of
kind ``fair``) there is an outcome that has to follow at some time, with which each move leads on. If a guarantee were
never met again, the rank could sink only finitely often; in the lowest nodes that are visited forever, either the
assumption would fail forever or that outcome would never follow.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from .formulas import Formula, Valuation, VariableName, names_in, valuation, value_of
from .specification import GameVariable, Section, Specification


def check_certificate(specification: Specification, certificate: Mapping[str, Any]) -> list[str]:
    """Return the problems of a certificate (:meth:`Strategy.to_json`) of a specification; an empty list if it is
    valid."""
    try:
        return list(_Check(specification, certificate).problems())
    except (KeyError, TypeError, IndexError, ValueError, AttributeError) as error:
        return [f'the certificate is damaged: {type(error).__name__}: {error}']


class _Check:
    def __init__(self, specification: Specification, certificate: Mapping[str, Any]) -> None:
        self._specification = specification
        self._nodes: list[Mapping[str, Any]] = certificate['nodes']
        self._start: list[int] = certificate['start']
        self._inputs = specification.names(inputs=True)
        self._next = specification.names(inputs=True, primed=True)
        self._guarantees: list[Formula | None] = [*specification.of(Section.SYS_LIVENESS)] or [None]
        self._assumptions: list[Formula | None] = [*specification.of(Section.ENV_LIVENESS)] or [None]

    def problems(self) -> Iterator[str]:
        ill_formed = [number for number, node in enumerate(self._nodes) if not self._is_well_formed(node)]
        if ill_formed:
            yield from (f'node {number} is not of this specification' for number in ill_formed)
            return
        yield from self._at_the_start()
        for number, node in enumerate(self._nodes):
            yield from (f'node {number}: {problem}' for problem in self._of_node(node))

    def _is_well_formed(self, node: Mapping[str, Any]) -> bool:
        variables = self._specification.variables
        values = node['values']
        kinds = {*range(len(self._assumptions)), 'fair'}
        return (
            values.keys() == variables.keys()
            and all(type(values[name]) is int and values[name] in one.values for name, one in variables.items())
            and node['goal'] in range(len(self._guarantees))
            and type(node['rank']) is int
            and node['rank'] >= 0
            and node['kind'] in kinds
            and all(move['to'] in range(len(self._nodes)) for move in node['moves'])
        )

    def _at_the_start(self) -> Iterator[str]:
        section, variables = self._specification.of, self._specification.variables
        begun = [self._nodes[number] for number in self._start]
        for node in begun:
            here = valuation(node['values'])
            if not all(value_of(one, here) for one in section(Section.SYS_INIT)):
                yield 'a node at the start contradicts SYS_INIT'
        inputs = [{name: node['values'][name.name] for name in self._inputs} for node in begun]
        for expected in valuations(self._inputs, section(Section.ENV_INIT), {}, variables):
            if expected not in inputs:
                yield f'the world may start with {_text(expected)}, and no node does'

    def _of_node(self, node: Mapping[str, Any]) -> Iterator[str]:
        here = valuation(node['values'])
        moves = [(valuation(move['inputs'], primed=True), move['to']) for move in node['moves']]
        allowed = list(
            valuations(self._next, self._specification.of(Section.ENV_TRANS), here, self._specification.variables)
        )
        for expected in allowed:
            answers = [to for inputs, to in moves if inputs == expected]
            if len(answers) != 1:
                yield f'{len(answers)} answers to {_text(expected)}'
        leads_on: dict[int, bool] = {}  # by the outcomes that have to follow at some time
        is_fair = False
        for inputs, to in moves:
            if inputs not in allowed:
                yield f'an answer to {_text(inputs)}, which the world may not do'
                continue
            then = self._nodes[to]['values']
            after = {**here, **valuation(then, primed=True)}
            if any(after[name] != value for name, value in inputs.items()):
                yield f'the move {_text(inputs)} leads to a node with other inputs'
            for formula in self._specification.of(Section.SYS_TRANS):
                if not value_of(formula, after):
                    yield f'after {_text(inputs)} {formula} does not hold'
            progress, problem = self._progress(node, self._nodes[to], after)
            if problem:
                yield f'after {_text(inputs)} {problem}'
            is_fair |= not progress
            for number, (active, outcome) in enumerate(self._specification.live):
                if value_of(active, after) and value_of(outcome, after):
                    leads_on[number] = progress and leads_on.get(number, True)
        if node['kind'] == 'fair' and is_fair and not any(leads_on.values()):
            yield 'no outcome that has to follow at some time leads on in each case'

    def _progress(
        self, node: Mapping[str, Any], then: Mapping[str, Any], after: Mapping[VariableName, int]
    ) -> tuple[bool, str | None]:
        """Return whether a move comes closer to the guarantee, and its problems."""
        guarantee = self._guarantees[node['goal']]
        if then['goal'] == (node['goal'] + 1) % len(self._guarantees) and (
            guarantee is None or value_of(guarantee, after)
        ):
            return True, None
        if then['goal'] != node['goal']:
            return False, 'another guarantee is pursued before this one is met'
        if then['rank'] < node['rank']:
            return True, None
        if node['kind'] == 'fair':
            return False, None
        assumption = self._assumptions[node['kind']]
        fails = assumption is not None and value_of(assumption, after) is False
        if fails and then['rank'] == node['rank'] and then['kind'] == node['kind']:
            return False, None
        return False, 'the guarantee comes no closer'


def _text(inputs: Mapping[VariableName, int]) -> str:
    said = [str(name) if value == 1 else f'{name}={value}' for name, value in inputs.items() if value]
    return f'({", ".join(said) or "no input"})'


# All valuations that satisfy formulas, found one variable after the other.


def valuations(
    names: Sequence[VariableName], formulas: Iterable[Formula], known: Valuation, variables: Mapping[str, GameVariable]
) -> Iterator[dict[VariableName, int]]:
    """Yield all values of ``names`` with which every formula holds, given values of others (``known``).

    In order of the names, each from its least value. Formulas that do not depend on the names are checked
    once. Raises KeyError when a formula has variables that are in neither.
    """
    found = dict(known)
    position = {name: index for index, name in enumerate(names)}
    by_last: list[list[Formula]] = [[] for _ in names]  # a formula is checked whenever one of its names gets a value
    for formula in formulas:
        places = {position[name] for name in names_in(formula) if name in position}
        if not places and not value_of(formula, found):
            return
        for place in places:
            by_last[place].append(formula)

    def extended(place: int) -> Iterator[dict[VariableName, int]]:
        if place == len(names):
            yield {name: found[name] for name in names}
            return
        name = names[place]
        for value in variables[name.name].values:
            found[name] = value
            if all(value_of(formula, found) is not False for formula in by_last[place]):
                yield from extended(place + 1)
        del found[name]

    yield from extended(0)

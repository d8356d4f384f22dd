# SPDX-License-Identifier: BSD-3-Clause
"""Who wins a game, against two solvers that share nothing with ours: a parity game by Zielonka's algorithm, and all
strategies one after the other. And the checker of certificates against certificates that were damaged."""

from __future__ import annotations

import copy
import itertools
import sys
from collections.abc import Callable, Iterator
from itertools import product
from typing import Any, NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_formal.synthesis.certificate import check_certificate
from flexbt_formal.synthesis.formulas import (
    TRUE,
    Formula,
    FormulaError,
    Join,
    Not,
    VariableName,
    parse_formula,
    value_of,
)
from flexbt_formal.synthesis.solver import Game
from flexbt_formal.synthesis.specification import GameVariable, Section, Specification, SpecificationLine
from flexbt_formal.synthesis.strategy import strategy_of

IN, OUT = ('p', 'q'), ('a', 'b')


def formulas(names: tuple[str, ...], primed: tuple[str, ...] = ()) -> st.SearchStrategy[Formula]:
    atoms: st.SearchStrategy[Formula] = st.sampled_from(
        [*(VariableName(name) for name in names), *(VariableName(name, True) for name in primed), TRUE]
    )
    return st.recursive(
        atoms,
        lambda inner: st.one_of(
            inner.map(Not),
            st.tuples(st.sampled_from(['&', '|', '->', '<->', '^']), st.tuples(inner, inner)).map(
                lambda one: Join(*one)
            ),
        ),
        max_leaves=5,
    )


def specifications(inputs: int, outputs: int, assumptions: int, guarantees: int) -> st.SearchStrategy[Specification]:
    ins, outs = IN[:inputs], OUT[:outputs]
    everything = (*ins, *outs)
    variables = {name: GameVariable(name, name in ins) for name in everything}
    sections = {
        Section.ENV_INIT: st.lists(formulas(ins), max_size=1),
        Section.SYS_INIT: st.lists(formulas(everything), max_size=1),
        Section.ENV_TRANS: st.lists(formulas(everything, ins), max_size=2),
        Section.SYS_TRANS: st.lists(formulas(everything, everything), max_size=2),
        Section.ENV_LIVENESS: st.lists(formulas(everything, everything), max_size=assumptions),
        Section.SYS_LIVENESS: st.lists(formulas(everything, everything), min_size=1, max_size=guarantees),
    }
    return st.fixed_dictionaries(sections).map(
        lambda lines: Specification(
            variables,
            tuple(SpecificationLine(section, str(one), one) for section, found in lines.items() for one in found),
        )
    )


State = tuple[int, ...]


class Explicit:
    """A game with its states and moves one by one; ``moves[state]`` is by inputs the list of next states."""

    def __init__(self, specification: Specification) -> None:
        self.specification = specification
        self.inputs, self.outputs = specification.names(inputs=True), specification.names(inputs=False)
        self.names = [*self.inputs, *self.outputs]
        self.states: list[State] = list(product((0, 1), repeat=len(self.names)))
        width = len(self.inputs)
        self.moves: dict[State, dict[State, list[State]]] = {}
        for state in self.states:
            by_inputs: dict[State, list[State]] = {}
            for inputs in product((0, 1), repeat=width):
                if self._holds(Section.ENV_TRANS, state, (*inputs, *(0 for _ in self.outputs))):
                    answers = (then for then in self.states if then[:width] == inputs)
                    by_inputs[inputs] = [then for then in answers if self._holds(Section.SYS_TRANS, state, then)]
            self.moves[state] = by_inputs

    def _holds(self, section: Section, state: State, then: State) -> bool:
        return all(self.true(one, state, then) for one in self.specification.of(section))

    def true(self, formula: Formula, state: State, then: State | None = None) -> bool:
        values = dict(zip(self.names, state, strict=True))
        if then is not None:
            values |= {VariableName(name.name, True): value for name, value in zip(self.names, then, strict=True)}
        return bool(value_of(formula, values))

    def is_won_from(self, winning: Callable[[State], bool]) -> bool:
        section, width = self.specification.of, len(self.inputs)
        for inputs in product((0, 1), repeat=width):
            here = [state for state in self.states if state[:width] == inputs]
            if all(self.true(one, here[0]) for one in section(Section.ENV_INIT)) and not any(
                winning(state) and all(self.true(one, state) for one in section(Section.SYS_INIT)) for state in here
            ):
                return False
        return True


class Position(NamedTuple):
    kind: str  # world, system or lost
    state: State
    inputs: State | None
    assumed: int
    met: int
    priority: int


def parity_won(explicit: Explicit) -> set[State]:
    """Return the winning states by way of a parity game: counters for assumptions and guarantees, priorities 0, 1,
    2."""
    assumptions = explicit.specification.of(Section.ENV_LIVENESS) or [TRUE]
    guarantees = explicit.specification.of(Section.SYS_LIVENESS)
    edges: dict[Position, list[Position]] = {}
    lost, won = (Position(kind, (), None, 0, 0, priority) for kind, priority in (('lost', 1), ('won', 2)))
    edges[lost], edges[won] = [lost], [won]

    def step(one: Position, then: State) -> Position:
        assumed, met, priority = one.assumed, one.met, 0
        if explicit.true(assumptions[assumed], one.state, then):
            assumed = (assumed + 1) % len(assumptions)
            priority = 1 if assumed == 0 else priority
        if explicit.true(guarantees[met], one.state, then):
            met = (met + 1) % len(guarantees)
            priority = 2 if met == 0 else priority
        return Position('world', then, None, assumed, met, priority)

    waiting = [Position('world', state, None, 0, 0, 0) for state in explicit.states]
    while waiting:
        one = waiting.pop()
        if one in edges:
            continue
        moves = explicit.moves[one.state]
        if one.kind == 'world':
            edges[one] = [one._replace(kind='system', inputs=inputs, priority=0) for inputs in moves] or [won]
        else:
            assert one.inputs is not None
            edges[one] = [step(one, then) for then in moves[one.inputs]] or [lost]
        waiting += edges[one]
    of_system = {one for one in edges if one.kind == 'system'}
    winning = zielonka(set(edges), edges, of_system)
    return {state for state in explicit.states if Position('world', state, None, 0, 0, 0) in winning}


def zielonka(
    positions: set[Position], edges: dict[Position, list[Position]], of_system: set[Position]
) -> set[Position]:
    """Return the positions from which the system sees to it that the greatest priority that comes for ever is even."""
    if not positions:
        return set()
    greatest = max(one.priority for one in positions)
    is_even = greatest % 2 == 0
    ours = of_system if is_even else positions - of_system
    top = attracted({one for one in positions if one.priority == greatest}, positions, edges, ours)
    inner = zielonka(positions - top, edges, of_system)
    against = (positions - top) - inner if is_even else inner
    if not against:
        return positions if is_even else set()
    away = attracted(against, positions, edges, positions - ours)
    rest = zielonka(positions - away, edges, of_system)
    return rest if is_even else rest | away


def attracted(
    targets: set[Position], positions: set[Position], edges: dict[Position, list[Position]], ours: set[Position]
) -> set[Position]:
    found = set(targets)
    while True:
        more = {
            one
            for one in positions - found
            if (any if one in ours else all)(to in found for to in edges[one] if to in positions)
        }
        if not more:
            return found
        found |= more


@settings(max_examples=80)
@given(specification=specifications(2, 2, 2, 2))
def test_who_wins_is_what_a_parity_game_says(specification: Specification) -> None:
    explicit = Explicit(specification)
    solution = Game(specification).solved()
    winning = parity_won(explicit)
    of = solution.game.encoding
    ours = {
        state for state in explicit.states if of.has(dict(zip(explicit.names, state, strict=True)), solution.winning)
    }
    assert ours == winning
    assert solution.is_realizable() == explicit.is_won_from(winning.__contains__)
    if solution.is_realizable():
        assert check_certificate(specification, strategy_of(solution).to_json()) == []


# -- fairness ----------------------------------------------------------------------------------------------------------


Edges = dict[State, list[tuple[State | None, bool, list[bool]]]]
"""By state the moves: where they lead, whether they meet the goal, and which outcomes that have to follow they have."""


def fairly_won(explicit: Explicit, goal: Formula, live: list[Formula]) -> set[State]:
    """Return the states from which one of all positional strategies wins, if the world takes some move with each live
    outcome at some time."""
    choices = [(state, inputs) for state in explicit.states for inputs in explicit.moves[state]]
    winning: set[State] = set()
    nothing: list[State | None] = [None]
    for answers in product(*(explicit.moves[state][inputs] or nothing for state, inputs in choices)):
        graph: Edges = {state: [] for state in explicit.states}
        for (state, inputs), then in zip(choices, answers, strict=True):
            seen = then if then is not None else (*inputs, *(0 for _ in explicit.outputs))
            lively = [explicit.true(one, state, seen) for one in live]
            graph[state].append((then, then is not None and explicit.true(goal, state, then), lively))
        bad = {state for state in explicit.states if any(then is None for then, _, _ in graph[state])}
        bad |= set().union(*traps(graph, set(explicit.states)))
        while True:
            more = {state for state in graph if any(then in bad for then, _, _ in graph[state])} - bad
            if not more:
                break
            bad |= more
        winning |= set(explicit.states) - bad
    return winning


def traps(graph: Edges, among: set[State]) -> Iterator[set[State]]:
    """Yield sets of states in which the world can stay without ever meeting the goal, with each live outcome."""
    inside = set(among)

    def leaves(state: State) -> bool:
        """Return whether all moves with some live outcome lead away."""
        of_each = zip(*(lively for _, _, lively in graph[state]), strict=True)
        away = [met or then not in inside for then, met, _ in graph[state]]
        return any(any(one) and all(itertools.compress(away, one)) for one in of_each)

    while True:
        leaving = {state for state in inside if leaves(state)}
        if not leaving:
            break
        inside -= leaving
    reach = {state: _reached(graph, state, inside) for state in inside}
    groups = {frozenset(other for other in reach[state] if state in reach[other]) for state in inside}
    for group in groups - {frozenset()}:
        if group == inside:
            yield set(group)
        else:
            yield from traps(graph, set(group))


def _reached(graph: Edges, state: State, inside: set[State]) -> set[State]:
    found: set[State] = set()
    waiting = [state]
    while waiting:
        for then, met, _ in graph[waiting.pop()]:
            if then is not None and then in inside and not met and then not in found:
                found.add(then)
                waiting.append(then)
    return found


@settings(max_examples=60, deadline=None)
@given(
    specification=specifications(1, 1, 0, 1),
    live=st.lists(formulas(('p', 'a'), ('p',)), min_size=1, max_size=2),
)
def test_who_wins_a_fair_world_is_what_all_strategies_say(specification: Specification, live: list[Formula]) -> None:
    fair = Specification(specification.variables, specification.lines, tuple((TRUE, one) for one in live))
    explicit = Explicit(fair)
    solution = Game(fair).solved()
    of = solution.game.encoding
    ours = {
        state for state in explicit.states if of.has(dict(zip(explicit.names, state, strict=True)), solution.winning)
    }
    assert ours == fairly_won(explicit, fair.of(Section.SYS_LIVENESS)[0], live)
    if solution.is_realizable():
        assert check_certificate(fair, strategy_of(solution).to_json()) == []


def test_without_cudd_the_answer_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """dd in pure Python, where there is no wheel: the same strategy, node by node."""
    with_cudd = certificate()
    monkeypatch.setitem(sys.modules, 'dd.cudd', None)
    monkeypatch.delattr('dd.cudd', raising=False)
    assert certificate() == with_cudd


# -- certificates ------------------------------------------------------------------------------------------------------

DOOR = {
    Section.ENV_INIT: ['!open', '!stuck'],
    Section.SYS_INIT: ['!push', 'place=0'],
    Section.ENV_TRANS: ["push -> (open' <-> !stuck')", "!push -> !stuck' & (open' <-> open)"],
    Section.SYS_TRANS: ["place' != place -> open'", "place'=1 -> !push'"],
    Section.SYS_LIVENESS: ['place=1', "place=0 & !push'"],
}


def door() -> Specification:
    """To go in and out by a door that opens at some time when it is pushed."""
    variables = {
        'open': GameVariable('open', True),
        'stuck': GameVariable('stuck', True),
        'push': GameVariable('push', False),
        'place': GameVariable('place', False, (0, 1)),
    }
    ranges = {name: one.bounds for name, one in variables.items()}
    lines = tuple(
        SpecificationLine(section, text, parse_formula(text, ranges))
        for section, texts in DOOR.items()
        for text in texts
    )
    return Specification(variables, lines, ((VariableName('push'), parse_formula("open'", ranges)),))


def certificate() -> dict[str, Any]:
    return strategy_of(Game(door()).solved()).to_json()


def damages() -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the certificate of the door with each single thing in it changed."""
    whole = certificate()
    for number, node in enumerate(whole['nodes']):
        for key, value in (('goal', 1 - node['goal']), ('kind', 0 if node['kind'] == 'fair' else 7), ('rank', -1)):
            damaged = copy.deepcopy(whole)
            damaged['nodes'][number][key] = value
            yield f'{key} of node {number}', damaged
        for name, value in node['values'].items():
            damaged = copy.deepcopy(whole)
            damaged['nodes'][number]['values'][name] = 1 - value
            yield f'{name} in node {number}', damaged
        for index, move in enumerate(node['moves']):
            damaged = copy.deepcopy(whole)
            del damaged['nodes'][number]['moves'][index]
            yield f'no move {index} of node {number}', damaged
            for to in set(range(len(whole['nodes']))) - {move['to']}:
                damaged = copy.deepcopy(whole)
                damaged['nodes'][number]['moves'][index]['to'] = to
                yield f'move {index} of node {number} to {to}', damaged
    level = copy.deepcopy(whole)
    for node in level['nodes']:
        node['rank'] = 0
    yield 'all of the same rank', level
    fair = copy.deepcopy(level)
    for node in fair['nodes']:
        node['kind'] = 'fair'
    yield 'all of the same rank, by luck', fair
    shapes: list[dict[str, Any]] = [
        {},
        {'nodes': []},
        {**whole, 'start': []},
        {**whole, 'start': [99]},
        {**whole, 'nodes': [None]},
    ]
    for broken in shapes:
        yield f'{len(broken)} parts', broken


def test_a_damaged_certificate_is_refused() -> None:
    assert check_certificate(door(), certificate()) == []
    accepted = [what for what, damaged in damages() if not check_certificate(door(), damaged)]
    assert accepted == []


# -- formulas ----------------------------------------------------------------------------------------------------------

RANGES = {'a': None, 'b': None, 'c': None, 'n': (0, 3), 'm': (0, 7)}


@pytest.mark.parametrize(
    ('text', 'meaning'),
    [
        ('a & b | c', '((a & b) | c)'),
        ('a | b ^ c', '((a | b) ^ c)'),
        ("!a' -> b <--> c", "((!a' -> b) <-> c)"),
        ('a -> b -> c', '(a -> (b -> c))'),
        ('next(n=1 & a)', "((n' = 1) & a')"),
        ("n' + 1 <= m - 2", "(n' + 1 <= m - 2)"),
        ('(n)=1 | 0', None),
        ('TRUE & 1', '(TRUE & TRUE)'),
    ],
)
def test_a_formula_means_what_slugs_takes_it_for(text: str, meaning: str | None) -> None:
    if meaning is None:
        with pytest.raises(FormulaError):
            parse_formula(text, RANGES)
    else:
        assert str(parse_formula(text, RANGES)) == meaning


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        ('a & d', "there is no variable 'd' (a, b, c, m, n)"),
        ('a &', "a variable is missing after '&'"),
        ('(a', "'(' is not closed by ')'"),
        ('a b', "an operator is missing before 'b'"),
        ('n', "'n' is a number from 0 to 3: write n=VALUE"),
        ("a'=1", "'a' is true or false, and is not compared: write a' or !a'"),
        ('a % b', "unexpected '%'"),
        ('[]<> a', 'a formula is about one step: [] (always) and <> (eventually) cannot be in it'),
        ('a and b', "'and' is not a word of formulas: write &"),
        ("n'", "'n' is a number from 0 to 3: write n=VALUE"),
        ('', 'a variable is missing at the beginning'),
        ('5', "'5' is a number, and says nothing by itself: compare it"),
        ('!(' * 60 + 'a' + ')' * 60, 'nested more than 50 levels deep'),
        ('!' * 10_000 + 'a', 'nested more than 50 levels deep'),
        ('a & ' * 10_000 + 'a', 'more than 20,000 characters'),
        ('n = 99999999999999', 'is too great a number'),
    ],
)
def test_what_is_no_formula_is_refused_with_what_is_wrong(text: str, problem: str) -> None:
    with pytest.raises(FormulaError) as caught:
        parse_formula(text, RANGES)
    assert problem in str(caught.value)
    assert len(str(caught.value)) < 300

# SPDX-License-Identifier: BSD-3-Clause
"""Grounding against a brute force: whatever is asked, both reach the same, at the same cost."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexbt_core.behavior_tree.engine.registry import node_skill
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.skills.grounding import ground
from flexbt_core.skills.library import SkillLibrary
from flexbt_core.skills.literals import Literal, Predicate, SkillError, parse_literal
from flexbt_core.skills.skill import Outcome, OutcomeClass, Skill

State = frozenset[Literal]


def successors(library: SkillLibrary, state: State) -> Iterable[tuple[float, State]]:
    """Yield what a skill may make of a state: each binding tried, by what the manifest says and nothing else."""
    for skill in library.skills.values():
        for objects in itertools.product(library.objects, repeat=len(skill.parameters)):
            binding = dict(zip(skill.parameters, objects, strict=True))
            kinds = zip(binding.values(), skill.parameters.values(), strict=True)
            if not all(library.is_kind_of(library.objects[one], kind) for one, kind in kinds):
                continue
            if not all(holds(one.bound(binding), state) for one in skill.preconditions):
                continue
            for outcome in skill.outcomes.values():
                if outcome.kind is OutcomeClass.COMPLETED:
                    yield skill.cost, after(library, [one.bound(binding) for one in outcome.effects], state)


def holds(literal: Literal, state: State) -> bool:
    if literal.predicate == '=':
        return (literal.arguments[0] == literal.arguments[1]) == literal.positive
    return (literal.atom in state) == literal.positive


def after(library: SkillLibrary, effects: list[Literal], state: State) -> State:
    true = {one for one in effects if one.positive}
    gone = {one.atom for one in effects if not one.positive}
    for one in true:
        predicate = library.predicates[one.predicate]
        names = list(predicate.parameters)
        for other in state:
            if other.predicate == one.predicate and predicate.exclusive is not None:
                place = names.index(predicate.exclusive)
                rest = [own for index, own in enumerate(other.arguments) if index != place]
                if rest == [own for index, own in enumerate(one.arguments) if index != place]:
                    gone.add(other)
    return frozenset((state - gone) | true)


def reachable(library: SkillLibrary, start: State) -> dict[State, float]:
    cost, ahead = {start: 0.0}, [start]
    while ahead:
        state = ahead.pop(0)
        for price, following in successors(library, state):
            if cost[state] + price < cost.get(following, 1e9):
                cost[following] = cost[state] + price
                ahead.append(following)
    return cost


@st.composite
def worlds(draw: st.DrawFn) -> tuple[SkillLibrary, State, list[Literal]]:
    types = {'a': 'object', 'b': 'a'}
    objects = {'o1': 'a', 'o2': 'b'}
    kinds = st.sampled_from(['a', 'b', 'object'])
    predicates = [
        Predicate('p', {'x': draw(kinds)}, exclusive=draw(st.sampled_from([None, 'x']))),
        Predicate('q'),
        Predicate('r', {'x': draw(kinds), 'y': draw(kinds)}, exclusive=draw(st.sampled_from([None, 'x', 'y']))),
    ]
    library = SkillLibrary.of([], predicates, types=types, objects=objects)

    def literals(parameters: dict[str, str], most: int) -> list[Literal]:
        found = []
        for predicate in draw(st.lists(st.sampled_from(predicates), max_size=most)):
            fits = [
                [name for name, own in (parameters | objects).items() if library.is_kind_of(own, kind)]
                for kind in predicate.parameters.values()
            ]
            found.append(
                Literal(predicate.name, tuple(draw(st.sampled_from(one)) for one in fits), draw(st.booleans()))
            )
        return [one for one in found if ~one not in found]

    skills = []
    for number in range(draw(st.integers(1, 3))):
        parameters = draw(st.dictionaries(st.sampled_from(['v', 'w']), kinds, max_size=2))
        pre = literals(parameters, 2)
        if len(parameters) == 2 and draw(st.booleans()):
            pre.append(parse_literal('v != w'))
        outcomes = {
            name: Outcome(
                draw(st.sampled_from([OutcomeClass.COMPLETED, OutcomeClass.FAILED])), tuple(literals(parameters, 3))
            )
            for name in ('one', 'two')
        }
        skills.append(
            Skill(f's{number}', parameters, tuple(pre), outcomes, cost=draw(st.sampled_from([1.0, 2.0, 5.0])))
        )
    start = frozenset(one for one in literals({}, 4) if one.positive)
    library = SkillLibrary.of(skills, predicates, types=types, objects=objects)
    return library, start, literals({}, 2)


@given(worlds())
def test_the_ground_problem_is_that_of_the_manifests(world: tuple[SkillLibrary, State, list[Literal]]) -> None:
    library, start, goal = world
    problem = ground(library, start, goal)
    assert len({action.name for action in problem.actions}) == len(problem.actions)
    cost, ahead = {problem.start: 0.0}, [problem.start]
    while ahead:
        state = ahead.pop(0)
        for action in problem.actions:
            assert not action.add & action.delete
            if action.pre <= state:
                following = frozenset((state - action.delete) | action.add)
                if cost[state] + action.cost < cost.get(following, 1e9):
                    cost[following] = cost[state] + action.cost
                    ahead.append(following)
    expected = reachable(library, start)
    shown = {frozenset(map(str, state)): price for state, price in expected.items()}
    assert {
        frozenset(one for one in state if not one.startswith('not ')): price for state, price in cost.items()
    } == shown
    wanted = min((price for state, price in expected.items() if all(holds(one, state) for one in goal)), default=None)
    assert min((price for state, price in cost.items() if problem.goal <= state), default=None) == wanted


def test_ways_that_cannot_hold_are_not_tried() -> None:
    """Parameters are bound one after the other: with 200 places and 4 of them in a skill, 1.6e9 bindings are not gone
    through."""
    places = {f'p{number}': 'place' for number in range(200)}
    hop = Skill.of(
        'Hop',
        parameters={'a': 'place', 'b': 'place', 'c': 'place', 'd': 'place'},
        preconditions=['at(a)', 'next(a, b)', 'next(b, c)', 'next(c, d)'],
        outcomes={'done': ['at(d)', 'not at(a)']},
        arguments={'goal': '{$d}'},
    )
    known = [Predicate('at', {'x': 'place'}), Predicate('next', {'x': 'place', 'y': 'place'})]
    library = SkillLibrary.of([hop], known, objects=places)
    start = [parse_literal('at(p0)'), *(parse_literal(f'next(p{one}, p{one + 1})') for one in range(199))]
    problem = ground(library, start, [parse_literal('at(p9)')])
    assert len(problem.actions) == 197
    action = problem.actions[0]
    assert (action.name, action.arguments['goal']) == ('Hop(p0, p1, p2, p3)', '{p3}')
    assert [*action.pre, *action.add, *action.delete] == ['at(p0)', 'at(p3)', 'at(p0)']


def test_a_goal_of_which_nothing_is_known_is_refused() -> None:
    library = SkillLibrary.of([], [Predicate('open', {'door': 'door'})], objects={'front': 'door'})
    with pytest.raises(SkillError, match=r"goal: open\(frnt\): 'frnt' is not an object; did you mean"):
        ground(library, [], [parse_literal('open(frnt)')])
    with pytest.raises(SkillError, match=r"start: opn\(front\): there is no predicate 'opn'; did you mean 'open'"):
        ground(library, [parse_literal('opn(front)')], [])


def test_too_many_ways_are_told_and_not_tried_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('flexbt_core.skills.grounding.MAX_TRIED', 5000)
    names = [f'v{number}' for number in range(8)]
    wide = Skill.of('Wide', parameters=dict.fromkeys(names, 'thing'), outcomes={'done': ['seen(v0)']})
    objects = {f'o{number}': 'thing' for number in range(50)}
    library = SkillLibrary.of([wide], [Predicate('seen', {'x': 'thing'})], objects=objects)
    with pytest.raises(SkillError, match='skill Wide: more than 5,000 ways to bind v0, v1, v2'):
        ground(library, [], [])


def test_a_skill_that_is_bound_speaks_of_its_object() -> None:
    skill = Skill.of(
        'Open',
        parameters={'door': 'door', 'hand': 'hand'},
        preconditions=['not open(door)'],
        outcomes={'done': ['open(door)']},
        arguments={'which': '{$door}', 'by': '$hand'},
    ).bound(door='front')
    assert (list(skill.parameters), str(skill.preconditions[0])) == (['hand'], 'not open(front)')
    assert dict(skill.arguments) == {'which': '{front}', 'by': '$hand'}
    with pytest.raises(SkillError, match="Open has no parameter 'dor'"):
        skill.bound(dor='front')


def test_only_ports_that_there_are_are_given() -> None:
    drive = Skill.of('Drive', parameters={'from': 'place', 'goal': 'place'}, outcomes={'SUCCESS': ['at(goal)']})
    known = [Predicate('at', {'where': 'place'})]
    for ports, passed in [((), {'from': 'p', 'goal': 'p'}), (('goal', 'timeout'), {'goal': 'p'})]:
        skill = drive.completed_by('', {}, reads=ports)
        library = SkillLibrary.of([skill], known, objects={'p': 'place'})
        assert ground(library, [], []).actions[0].arguments == passed


def test_a_leaf_without_ports_is_given_none() -> None:
    (manifest,) = (one for one in builtin_registry() if one.id == 'AlwaysSuccess')
    known = node_skill(manifest)
    assert known is not None
    skill = replace(known, parameters={'from': 'place'}, outcomes={'SUCCESS': Outcome.of('completed', 'left(from)')})
    library = SkillLibrary.of([skill], [Predicate('left', {'where': 'place'})], objects={'p': 'place'})
    assert ground(library, [], []).actions[0].arguments == {}

# SPDX-License-Identifier: BSD-3-Clause
"""The trees of plans, run by the engine in worlds that do what the model says, and in worlds that do not."""

from __future__ import annotations

from functools import cache
from itertools import count, groupby
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from planning_support import World, action, led_by

from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_formal.planning.planner import Plan, plan
from flexbt_formal.planning.problem import Action, Leaf, PlanningError, PlanningProblem
from flexbt_formal.planning.search import SearchOutcome
from flexbt_formal.planning.tree_xml import tree_xml

ERRAND = (
    action('to_kitchen', 'at_hall open', 'at_kitchen', 'at_hall', 15),
    action('to_hall', 'at_kitchen open', 'at_hall', 'at_kitchen', 15),
    action('open_hall', 'at_hall shut', 'open', 'shut', 8),
    action('open_kitchen', 'at_kitchen shut', 'open', 'shut', 8),
    action('grab_kitchen', 'at_kitchen cup_kitchen', 'held', 'cup_kitchen', 5),
    action('grab_hall', 'at_hall cup_hall', 'held', 'cup_hall', 5),
    action('put_hall', 'at_hall held', 'cup_hall', 'held', 6),
)
DISTURBANCES = (
    action('the door is shut', 'open', 'shut', 'open'),
    action('the cup is taken back', 'cup_hall', 'cup_kitchen', 'cup_hall'),
    action('the cup is taken away', 'held', 'cup_kitchen', 'held'),
)


def errand(start: str = 'at_hall open cup_kitchen', goal: str = 'cup_hall', attempts: int = 2) -> PlanningProblem:
    goals = tuple(frozenset(part.split()) for part in goal.split('|'))
    return led_by(PlanningProblem(ERRAND, frozenset(start.split()), goals, DISTURBANCES), attempts)


def planned(problem: PlanningProblem, disturbed: int = 1) -> tuple[Plan, str]:
    found = plan(problem, disturbed=disturbed)
    assert found.coverage is not None
    assert not found.coverage.uncovered
    return found, tree_xml(found)


def test_the_tree_does_the_plan() -> None:
    problem = errand()
    found, xml = planned(problem)
    world = World(problem, set(problem.initial))
    assert world.run(xml) is NodeStatus.SUCCESS
    assert tuple(world.done) == found.actions == ('to_kitchen', 'grab_kitchen', 'to_hall', 'put_hall')
    assert world.started == world.done


def test_what_somebody_else_has_done_is_not_done_again_and_what_runs_is_left() -> None:
    problem = errand()
    _, xml = planned(problem)
    world = World(problem, set(problem.initial))

    def helped(tick: int) -> None:
        if world.started == ['to_kitchen'] and not world.done:
            world.true = {'at_hall', 'open', 'cup_hall'}

    assert world.run(xml, helped) is NodeStatus.SUCCESS
    assert world.started == ['to_kitchen']
    assert world.done == []


@cache
def planned_for_all() -> tuple[PlanningProblem, str]:
    problem = errand(attempts=5)  # what is undone at once each time looks as if it had no effects
    return problem, planned(problem, disturbed=4)[1]


@given(st.dictionaries(st.integers(0, 30), st.sampled_from(DISTURBANCES), max_size=4))
def test_it_comes_to_the_goal_however_it_is_disturbed(when: dict[int, Action]) -> None:
    problem, xml = planned_for_all()
    world = World(problem, set(problem.initial))

    def disturb(tick: int) -> None:
        if tick in when and when[tick].needs <= world.true:
            world.true = (world.true - when[tick].deletes) | when[tick].adds

    assert world.run(xml, disturb) is NodeStatus.SUCCESS
    assert 'cup_hall' in world.true


def test_an_action_is_tried_as_often_as_it_may_and_then_the_tree_says_that_it_failed() -> None:
    problem = errand()
    _, xml = planned(problem)
    world = World(problem, set(problem.initial), fails=lambda name: name == 'to_kitchen')
    assert world.run(xml) is NodeStatus.FAILURE
    assert world.started == ['to_kitchen', 'to_kitchen']
    assert world.reason == 'to_kitchen failed 2 times'


def test_an_action_without_effect_is_done_as_often_as_it_may_be_tried() -> None:
    problem = errand(attempts=4)
    world = World(problem, set(problem.initial), idle=lambda name: name == 'to_kitchen')
    assert world.run(planned(problem)[1]) is NodeStatus.FAILURE
    assert world.done == ['to_kitchen'] * 4
    assert world.reason == 'to_kitchen succeeded without its effects 4 times'


def test_what_is_undone_while_the_next_action_is_under_way_had_its_effects() -> None:
    problem = errand(attempts=1)
    world = World(problem, set(problem.initial), lasts=lambda name: 3)
    times: list[int] = []

    def disturb(tick: int) -> None:
        if len(times) < 2 and world.done[-1:] == ['grab_kitchen'] and world.started[-1] == 'to_hall':
            times.append(tick)
            world.true = (world.true - {'held'}) | {'cup_kitchen'}

    assert world.run(planned(problem)[1], disturb) is NodeStatus.SUCCESS
    assert world.done.count('grab_kitchen') == 3


def round_trip(places: str) -> PlanningProblem:
    """Through a city: a search looks into many conditions, of which few matter."""
    streets = tuple(
        action(f'{a}{b}', f'at_{a}', f'at_{b} seen_{b}', f'at_{a}', 1 + (5 * i + 3 * k) % 11 + (i * k) % 7)
        for i, a in enumerate(places)
        for k, b in enumerate(places)
        if a != b
    )
    carried_off = action('carried off', '', f'at_{places[-1]}', ' '.join(f'at_{one}' for one in places[:-1]))
    goal = frozenset(f'seen_{one}' for one in places)
    return led_by(PlanningProblem(streets, frozenset({f'at_{places[0]}'}), (goal,), (carried_off,)))


def test_a_tree_has_no_more_branches_than_its_ways_need_and_some_others(monkeypatch: pytest.MonkeyPatch) -> None:
    trip = round_trip('abcdefghi')
    every = planned(trip)[0]
    monkeypatch.setattr('flexbt_formal.planning.policy.MOST_BRANCHES', 10)
    found, xml = planned(trip)
    assert every.policy is not None and found.policy is not None
    assert len(found.policy.branches) < len(every.policy.branches) / 2
    assert (found.cost, found.actions) == (every.cost, every.actions)
    assert World(trip, set(trip.initial)).run(xml) is NodeStatus.SUCCESS


def test_where_the_time_does_not_suffice_for_the_cheapest_plan_there_is_another_one() -> None:
    """Half of the time is kept for any plan; and its tree may do as many actions as that needs."""
    trip = round_trip('abcdefghi')
    ticks = count()
    found = plan(trip, time_limit=1000.0, clock=lambda: float(next(ticks)))
    assert found.outcome is SearchOutcome.TIME_LIMIT
    assert found.cost is not None and found.bound < found.cost
    assert found.coverage is not None and found.coverage.longest >= len(found.actions) >= 9
    assert World(trip, set(trip.initial)).run(tree_xml(found)) is NodeStatus.SUCCESS


TWO_DOORS = (
    action('front', 'outside front_open', 'inside', 'outside', 5),
    action('back', 'outside back_open', 'inside', 'outside', 6),
    action('ring', 'outside', 'front_open', '', 9),
)
SHUT = action('the front door is shut', 'front_open', '', 'front_open')


@pytest.mark.parametrize('how', ['fails', 'idle'])
@pytest.mark.parametrize('lasts', [1, 3])
def test_what_has_failed_does_not_keep_another_way_from_its_end(how: str, lasts: int) -> None:
    start = frozenset({'outside', 'front_open', 'back_open'})
    problem = led_by(PlanningProblem(TWO_DOORS, start, (frozenset({'inside'}),), (SHUT,)))
    world = World(problem, set(start), lasts=lambda name: lasts, **{how: lambda name: name == 'front'})  # type: ignore[arg-type]
    assert world.run(planned(problem)[1]) is NodeStatus.SUCCESS
    assert world.started == ['front', 'front', 'back']


STEPS = (('p', ''), ('q', 'p'), ('r', 'p'), ('s', 'q r'), ('s', 'r'))
MANY_WAYS = [
    action(f'{literal} with tool {number}', f'{needs} tool_{number}', literal, '', 3 + number % 4)
    for number, (literal, needs) in enumerate(one for one in STEPS for _ in range(2))
]
LOST_TOOLS = [action(f'tool {number} is lost', f'tool_{number}', '', f'tool_{number}') for number in range(10)]
GONE = [action(f'{one} is gone', one, '', one) for one in 'pqr']


@cache
def planned_with_ways(attempts: int) -> tuple[PlanningProblem, str]:
    start = frozenset(f'tool_{number}' for number in range(10))
    problem = led_by(PlanningProblem(tuple(MANY_WAYS), start, (frozenset('s'),), (*GONE, *LOST_TOOLS)), attempts)
    return problem, planned(problem)[1]


@given(
    st.integers(1, 3),
    st.dictionaries(st.sampled_from([one.name for one in MANY_WAYS]), st.sampled_from(['fails', 'idle']), max_size=6),
    st.integers(1, 3),
    st.dictionaries(st.integers(0, 40), st.sampled_from(GONE), max_size=3),
)
def test_it_ends_whatever_is_broken_and_says_why(
    attempts: int, broken: dict[str, str], lasts: int, when: dict[int, Action]
) -> None:
    problem, xml = planned_with_ways(attempts)
    world = World(
        problem,
        set(problem.initial),
        fails=lambda name: broken.get(name) == 'fails',
        idle=lambda name: broken.get(name) == 'idle',
        lasts=lambda name: lasts,
    )

    def disturb(tick: int) -> None:
        if tick in when:
            world.true -= when[tick].deletes

    status = world.run(xml, disturb)
    assert (status is NodeStatus.SUCCESS) is ('s' in world.true)
    for name, how in broken.items():
        if how == 'idle':
            assert max((len(list(row)) for one, row in groupby(world.done) if one == name), default=0) <= attempts
    if status is NodeStatus.FAILURE and not when:
        assert any(str(world.reason).startswith(name) for name in broken) or 'the last one was' in str(world.reason)


def test_where_no_branch_holds_it_gives_up_and_says_so() -> None:
    problem = errand()
    _, xml = planned(problem)
    world = World(problem, {'open', 'cup_kitchen'})
    assert world.run(xml) is NodeStatus.FAILURE
    assert world.started == []
    assert world.reason == 'no way to the goal is planned from here'


def test_the_nearer_of_several_goals_is_reached() -> None:
    problem = errand(start='at_kitchen open cup_kitchen', goal='cup_hall|held')
    found, xml = planned(problem)
    assert found.actions == ('grab_kitchen',)
    world = World(problem, set(problem.initial))
    assert world.run(xml) is NodeStatus.SUCCESS
    assert world.done == ['grab_kitchen']


def test_a_goal_that_holds_needs_nothing() -> None:
    problem = errand(start='at_hall open cup_hall')
    found, xml = planned(problem)
    assert (found.cost, found.actions) == (0.0, ())
    world = World(problem, set(problem.initial))
    assert world.run(xml) is NodeStatus.SUCCESS
    assert world.started == []


def test_behaviortree_cpp_loads_the_tree_and_does_the_plan() -> None:
    library: Any = pytest.importorskip('behaviortreepy')
    given_ = errand()
    leaves = {literal: Leaf(f'Is_{literal}') for one in ERRAND for literal in one.needs | one.adds | one.deletes}
    problem = PlanningProblem(given_.actions, given_.initial, given_.goal, given_.disturbances, leaves)
    found, xml = planned(problem)
    true, done = set(problem.initial), []
    factory = library.BehaviorTreeFactory()
    success, failure, running = (getattr(library.NodeStatus, name) for name in ('SUCCESS', 'FAILURE', 'RUNNING'))
    for literal, leaf in leaves.items():
        factory.register_simple_condition(leaf.type, lambda node, one=literal: success if one in true else failure)
    for one in problem.actions:

        def do(node: object, one: Action = one) -> object:
            done.append(one.name)
            true.difference_update(one.deletes)
            true.update(one.adds)
            if len(done) == 1:  # somebody shuts the door when the robot is in the kitchen
                true.symmetric_difference_update({'open', 'shut'})
            return success

        factory.register_simple_action(one.name, do)
    tree = factory.create_tree_from_text(xml)
    status = running
    for _ in range(20):
        if status == running:
            status = tree.tick_exactly_once()
    assert status == success
    assert done == ['to_kitchen', 'grab_kitchen', 'open_kitchen', 'to_hall', 'put_hall']
    assert found.actions == ('to_kitchen', 'grab_kitchen', 'to_hall', 'put_hall')


@pytest.mark.parametrize(
    'leaf',
    [Leaf('put it'), Leaf(''), *(Leaf('Put', {port: '1'}) for port in ('a b', '><', 'name', 'ID', '_skipIf'))],
)
def test_what_cannot_be_a_leaf_in_xml_is_refused(leaf: Leaf) -> None:
    given_ = errand()
    problem = PlanningProblem(given_.actions, given_.initial, given_.goal, leaves={'put_hall': leaf})
    with pytest.raises(PlanningError, match=r'put_hall: .* cannot be a type or port of a leaf'):
        tree_xml(plan(problem))


def test_no_action_is_done_to_test_a_literal() -> None:
    given_ = errand()
    leaves = {'put_hall': Leaf('Put'), 'cup_hall': Leaf('Put')}
    problem = PlanningProblem(given_.actions, given_.initial, given_.goal, leaves=leaves)
    with pytest.raises(PlanningError, match='Put is a leaf that acts, and would test a literal, too'):
        tree_xml(plan(problem))

# SPDX-License-Identifier: BSD-3-Clause
"""Plans for several robots: their trees, run side by side by the engine, whichever robot is done first."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable, Collection
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from planning_support import World, action, led_by

from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_formal.planning.problem import Action, Condition, PlanningError, PlanningProblem
from flexbt_formal.planning.team import Team, TeamPlan, plan_team
from flexbt_formal.planning.tree_xml import tree_xml

ROBOTS = ('red', 'blue')


def fetching(robots: Collection[str] = ROBOTS) -> Team:
    """Return each robot can go to both shelves, take what is there, and bring it back; none can carry two things."""
    actions: list[Action] = []
    doers: dict[str, str] = {}
    for robot, thing in itertools.product(robots, ('cup', 'pan')):
        here, there, held = f'{robot}_home', f'{robot}_at_{thing}', f'{robot}_has_{thing}'
        own = [
            action(f'{robot} goes for {thing}', here, there, here, 10),
            action(f'{robot} takes {thing}', f'{there} {thing}_on_shelf', held, f'{thing}_on_shelf', 5),
            action(f'{robot} returns with {thing}', there, here, there, 10),
            action(f'{robot} puts {thing}', f'{here} {held}', f'{thing}_home', held, 5),
        ]
        actions += own
        doers |= {one.name: robot for one in own}
    start = frozenset({'cup_on_shelf', 'pan_on_shelf', *(f'{robot}_home' for robot in robots)})
    problem = PlanningProblem(tuple(actions), start, (frozenset({'cup_home', 'pan_home'}),))
    return Team(led_by(problem), tuple(robots), doers)


def world_of(team: Team, **how: Callable[[str], int] | Callable[[str], bool]) -> World:
    return World(team.problem, set(team.problem.initial), **how)  # type: ignore[arg-type]


def test_two_robots_divide_what_is_to_be_done_and_are_done_in_half_the_time() -> None:
    team = fetching()
    found = plan_team(team)
    assert (found.cost, found.duration, found.least_duration) == (60.0, 30.0, 30.0)
    assert found.alone == {'red': 60.0, 'blue': 60.0}
    assert {task.robot for task in found.tasks if 'cup' in task.action} != {
        task.robot for task in found.tasks if 'pan' in task.action
    }
    lasts = {one.name: round(one.cost) for one in team.problem.actions}
    world = world_of(team, lasts=lasts.__getitem__)
    assert world.run(tree_xml(found)) is NodeStatus.SUCCESS
    assert world.started == sorted(world.started, key=world.done.index)  # nothing was begun twice
    assert len(world.done) == 8
    assert world.ticks <= 30 + 4 + 1  # an action and the next one have a tick in between


def test_one_goes_on_with_what_it_does_while_the_other_one_is_done_first() -> None:
    team = fetching()
    found = plan_team(team)
    world = world_of(team, lasts=lambda name: 1 if name.startswith('red') else 20)
    assert world.run(tree_xml(found)) is NodeStatus.SUCCESS
    assert len(world.started) == len(set(world.started)) == 8


def test_who_is_done_begins_nothing_when_another_one_reaches_the_goal() -> None:
    """Blue is asked after red in each tick, also in that in which red brings about what was missing."""
    both = [action('red makes p', '', 'p', '', 3), action('blue makes q', '', 'q', '')]
    problem = led_by(PlanningProblem(tuple(both), frozenset(), (frozenset('pq'),)))
    team = Team(problem, ROBOTS, {one.name: one.name.split()[0] for one in both})
    world = world_of(team, lasts=lambda name: 3 if name.startswith('red') else 1)
    assert world.run(tree_xml(plan_team(team))) is NodeStatus.SUCCESS
    assert world.started == ['red makes p', 'blue makes q']


def test_what_a_robot_cannot_do_the_other_one_does_in_its_place() -> None:
    team = fetching()
    world = world_of(team, fails=lambda name: name.startswith('red goes'))
    assert world.run(tree_xml(plan_team(team))) is NodeStatus.SUCCESS
    assert {name.split()[0] for name in world.done} == {'blue'}
    assert len([name for name in world.started if name.startswith('red')]) == 2  # as often as it may be tried


def test_what_is_done_again_since_others_have_used_it_is_not_done_in_vain() -> None:
    fills = [action('red fills', '', 'full', '')]
    loads = [action(f'blue takes {n}', f'full {n - 1}', f'{n}', f'full {n - 1}', 3) for n in range(1, 6)]
    problem = led_by(PlanningProblem((*fills, *loads), frozenset({'0'}), (frozenset({'5'}),)))
    team = Team(problem, ROBOTS, {one.name: one.name.split()[0] for one in problem.actions})
    world = world_of(team, lasts=lambda name: 1 if name == 'red fills' else 3)
    assert world.run(tree_xml(plan_team(team))) is NodeStatus.SUCCESS
    assert world.done.count('red fills') == 5  # each is tried twice


def test_a_robot_whose_action_has_no_effects_is_lost_too() -> None:
    team = fetching()
    world = world_of(team, idle=lambda name: name.startswith('red goes'))
    assert world.run(tree_xml(plan_team(team))) is NodeStatus.SUCCESS
    assert len([name for name in world.done if name.startswith('red')]) == 2


def test_nobody_waits_for_a_robot_longer_than_until_the_deadline_of_its_action() -> None:
    team = fetching()
    assert plan_team(team).unlimited == ('Do',)

    def limited(seconds: float) -> TeamPlan:
        leaves = {name: replace(leaf, deadline=seconds) for name, leaf in team.problem.leaves.items()}
        return plan_team(replace(team, problem=replace(team.problem, leaves=leaves)))

    assert 'msec="1"' in tree_xml(limited(1e-4)), '0 is no limit'
    found = limited(5.0)
    assert found.unlimited == ()
    world = world_of(team, lasts=lambda name: 1000 if name.startswith('red') else 2)
    assert world.run(tree_xml(found)) is NodeStatus.SUCCESS
    assert {name.split()[0] for name in world.done} == {'blue'}
    assert len([name for name in world.started if name.startswith('red')]) == 2


def test_where_the_lost_robot_has_what_is_needed_the_trees_say_why_they_give_up() -> None:
    team = fetching()
    found = plan_team(team)
    assert any('red takes' in way[-2] and way[-1] == 'red is lost' for way in found.hopeless)
    world = world_of(team, fails=lambda name: 'returns' in name and name.startswith('red'))
    assert world.run(tree_xml(found)) is NodeStatus.FAILURE
    assert str(world.reason).startswith('red returns with ')


LITERALS = [*'pqrstuv']


@st.composite
def teams(draw: st.DrawFn) -> Team:
    """Literals that are had one after the other, in part by either robot; what one does may undo what was had."""
    actions: list[Action] = []
    doers: dict[str, str] = {}
    for place, literal in enumerate(LITERALS):
        needs, deletes = (draw(st.sets(st.integers(0, place - 1), max_size=most)) if place else () for most in (2, 1))
        for robot in draw(st.sampled_from([('red',), ('blue',), ROBOTS])):
            name = f'{robot} makes {literal}'
            effects = frozenset(literal), frozenset(LITERALS[one] for one in deletes)
            actions.append(Action(name, frozenset(LITERALS[one] for one in needs), *effects, draw(st.integers(1, 4))))
            doers[name] = robot
    goals = st.frozensets(st.sampled_from(LITERALS[2:]), min_size=2, max_size=3)
    others = [
        Action(f'{one} is gone', frozenset(), frozenset(), frozenset(one))
        for one in draw(st.sets(st.sampled_from(LITERALS), max_size=2))
    ]
    problem = PlanningProblem(
        tuple(actions), frozenset(), tuple(draw(st.lists(goals, min_size=1, max_size=2))), tuple(others)
    )
    return Team(led_by(problem), ROBOTS, doers)


def least_cost(team: Team, state: Condition, lost: Collection[str] = ()) -> float:
    """Dijkstra through the states, forward."""
    queue: list[tuple[float, int, Condition]] = [(0.0, 0, state)]
    number = itertools.count(1)
    done = set()
    while queue:
        cost, _, at = heapq.heappop(queue)
        if any(goal <= at for goal in team.problem.goal):
            return cost
        if at not in done:
            done.add(at)
            for one in team.problem.actions:
                if one.needs <= at and team.doers[one.name] not in lost:
                    heapq.heappush(queue, (cost + one.cost, next(number), (at - one.deletes) | one.adds))
    return math.inf


@settings(max_examples=40)
@given(teams(), st.lists(st.integers(1, 4), min_size=7, max_size=7), st.integers(0, 12), st.integers(0, 3))
def test_they_reach_the_goal_whoever_is_done_first_and_whatever_happens_once(
    team: Team, lasts: list[int], when: int, what: int
) -> None:
    found: TeamPlan = plan_team(team)
    least = least_cost(team, team.problem.initial)
    assert (found.cost is None) is (least == math.inf) is bool(found.reason)
    if found.cost is None or found.duration is None or found.coverage is None:
        return
    assert found.bound == least <= found.cost
    assert found.least_duration <= found.duration <= found.cost
    assert found.coverage.complete
    world = world_of(team, lasts=lambda name: lasts[LITERALS.index(name[-1])])
    lost: set[str] = set()
    happens: list[str | Action] = [*ROBOTS, *team.problem.disturbances]
    chosen = happens[what] if what < len(happens) else None

    def disturb(tick: int) -> None:
        if tick != when or chosen is None:
            return
        if isinstance(chosen, str):
            lost.add(chosen)
            assert world.tree is not None
            world.tree.blackboard.set(f'lost_{chosen}', True)
        elif chosen.needs <= world.true:
            world.true = (world.true - chosen.deletes) | chosen.adds

    # A robot can be lost from the second tick on: the first one says that none is.
    status = world.run(tree_xml(found), disturb if when else lambda tick: None)
    reached = any(goal <= world.true for goal in team.problem.goal)
    assert (status is NodeStatus.SUCCESS) is reached
    assert reached or least_cost(team, frozenset(world.true), lost) == math.inf


@pytest.mark.parametrize(
    ('robots', 'problem'),
    [
        ((), '0 robots: name 1 to 8'),
        (('red', 'red'), '2 robots: name 1 to 8, each once'),
        (('r.1', 'r_1'), 'two differ in punctuation only'),
        (('blue',), 'action red goes for cup: none of the robots blue does it'),
    ],
)
def test_what_is_no_team_is_told(robots: tuple[str, ...], problem: str) -> None:
    team = fetching()
    with pytest.raises(PlanningError, match=problem):
        Team(team.problem, robots, team.doers)

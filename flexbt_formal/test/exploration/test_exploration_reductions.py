# SPDX-License-Identifier: BSD-3-Clause
"""What a proof leaves out makes no difference: the same is found, and the same ends, with it and without."""

from __future__ import annotations

import re
from dataclasses import replace
from random import Random
from typing import Any
from unittest.mock import patch

import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from flexbt_core.behavior_tree.model.definition import TreeKey, TreeLibrary
from flexbt_core.behavior_tree.model.ports import STRING, UINT16, input_port, output_port
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.monitors.machine_monitor import Visits
from flexbt_core.monitors.requirement_text import parse_requirement
from flexbt_core.monitors.requirements import Requirement
from flexbt_core.skills.skill import Skill
from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.authoring.machine import ConcurrencyContainer, OperatableStateMachine, PriorityContainer
from flexbt_core.state_machine.model.definition import MachineDefinition, StateDefinition
from flexbt_core.state_machine.model.userdata import MachineError
from flexbt_formal.exploration import machine_system
from flexbt_formal.exploration.configuration import Configuration
from flexbt_formal.exploration.explorer import ExplorationLimits, explore
from flexbt_formal.exploration.machine_system import MachineBounds, MachineSystem, Operator
from flexbt_formal.exploration.model import EnvironmentChoices, Label, Report
from flexbt_formal.exploration.state_models import (
    MachineEnvironment,
    ModelState,
    StateModel,
    interchangeable,
    modelled,
    state_model,
)
from flexbt_formal.exploration.tree_system import TreeSystem
from flexbt_testing.seeded_missions import IsClear, StandIn, Turn
from flexbt_testing.state_machines.bench import Scripted
from flexbt_testing.state_machines.random_machines import build, random_machine


class Plan(StandIn):
    ports = {'path': output_port(STRING), 'error_code_id': output_port(UINT16)}


class Drive(StandIn):
    skill = Skill.of(resources=['base'])
    ports = {'path': input_port(STRING), 'error_code_id': output_port(UINT16)}


class Clear(StandIn):
    skill = Skill.of(ignores_cancel=True)


REGISTRY = builtin_registry()
REGISTRY.register_classes([Plan, Drive, Turn, Clear, IsClear])
KEYS = some.sampled_from('ab')
LEAVES = some.one_of(
    some.sampled_from(('<IsClear/>', '<Turn/>', '<Clear/>', '<AlwaysSuccess/>')),
    KEYS.map('<Plan path="{{{0}}}" error_code_id="{{{0}_code}}"/>'.format),
    KEYS.map('<Drive path="{{{0}}}" error_code_id="{{drive_code}}"/>'.format),
    KEYS.map('<ScriptCondition code="{0}_code == 0"/>'.format),
)
DECORATORS = ('Inverter', 'RetryUntilSuccessful num_attempts="2"', 'Timeout msec="50"', 'Delay delay_msec="5"')
CONTROLS = ('Sequence', 'Fallback', 'ReactiveSequence', 'ReactiveFallback', 'Parallel success_count="1"')


def around(inner: some.SearchStrategy[str]) -> some.SearchStrategy[str]:
    return some.one_of(
        some.builds(element, some.sampled_from(DECORATORS), some.tuples(inner)),
        some.builds(element, some.sampled_from(CONTROLS), some.lists(inner, min_size=2, max_size=3)),
    )


def element(name: str, children: list[str]) -> str:
    return f'<{name}>{"".join(children)}</{name.split()[0]}>'


TREES = some.recursive(LEAVES, around, max_leaves=6)


def proved(body: str, *, reduces: bool) -> Report:
    xml = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    library = TreeLibrary([load_xml(xml, 'main.xml', REGISTRY)])
    key = TreeKey('main.xml', 'Main')
    limits = ExplorationLimits(seconds=600, configurations=300)
    return explore(lambda: TreeSystem(library, key, reduces=reduces), '', limits=limits)


def verdict(report: Report) -> tuple[object, ...]:
    found = sorted((one.violation.property.name, one.violation.where) for one in report.counterexamples)
    return found, sorted(report.ends), report.uncovered, report.depth


@settings(max_examples=30, deadline=None, derandomize=True)
@given(TREES)
def test_keys_that_nothing_reads_make_no_difference(body: str) -> None:
    without = proved(body, reduces=False)
    reduced = proved(body, reduces=True)
    assert reduced.configurations <= without.configurations
    if without.is_complete:
        assert verdict(reduced) == verdict(without)


def test_keys_that_nothing_reads_do_not_tell_situations_apart() -> None:
    body = '<Fallback><Drive path="{a}" error_code_id="{c}"/><Plan path="{b}" error_code_id="{d}"/><Turn/></Fallback>'
    body = f'<RetryUntilSuccessful num_attempts="-1"><ForceFailure>{body}</ForceFailure></RetryUntilSuccessful>'
    assert proved(body, reduces=True).configurations < proved(body, reduces=False).configurations


# -- machines --------------------------------------------------------------------------------------------------------

BOUNDS = (MachineBounds(), MachineBounds(faults=2), MachineBounds(Operator.ALL, forces=1), MachineBounds(Operator.NONE))


def some_machine(random: Random) -> MachineDefinition:
    while True:
        try:
            return define(build(random_machine(random, states=4))[0])
        except MachineError:
            continue


@pytest.mark.parametrize('seed', [1, 5, 9, 10, 22, 24, 29, 35])  # small enough to be followed to their end
def test_what_came_before_a_stop_makes_no_difference_after_it(seed: int) -> None:
    """Some have a state that the engine forgets to leave, or that works on: that shows after a stop, too."""
    random = Random(seed)
    definition, bounds = some_machine(random), random.choice(BOUNDS)
    paths = [node.path for node in definition.nodes() if isinstance(node, StateDefinition)]
    driving = frozenset(path for path in paths if random.random() < 0.3)
    not_left, works_on = random.choice([('', ''), (random.choice(paths), ''), ('', random.choice(paths))])
    exited, on_exit = Visits.exited, ModelState.on_exit

    def model(state: StateDefinition) -> StateModel:
        return replace(state_model(state), resources=frozenset(['base'] if state.path in driving else []))

    def explored(*, reduces: bool) -> Report:
        limits = ExplorationLimits(seconds=600, configurations=200)
        return explore(lambda: MachineSystem(definition, model, bounds, reduces=reduces), '', limits=limits)

    with (
        patch.object(Visits, 'exited', lambda one, path: None if path == not_left else exited(one, path)),
        patch.object(ModelState, 'on_exit', lambda one, data: None if one.own_path == works_on else on_exit(one, data)),
    ):
        reduced, without = explored(reduces=True), explored(reduces=False)
    assert without.is_complete
    assert reduced.configurations <= without.configurations
    assert verdict(reduced)[:3] == verdict(without)[:3]
    lengths = [[len(one.moves) for one in report.counterexamples] for report in (reduced, without)]
    assert lengths[0] == lengths[1]


def two_legs(requirement: Requirement | None = None, *, reduces: bool = True) -> Report:
    machine = OperatableStateMachine(outcomes=['finished', 'failed'])
    with machine:
        for label, following in (('Out', 'Home'), ('Home', 'finished')):
            leg = Scripted('done', 'failed')
            OperatableStateMachine.add(
                label, leg, {'done': following, 'failed': 'Out' if label == 'Home' else 'failed'}
            )
    definition, required = define(machine), [] if requirement is None else [requirement]

    def model(state: StateDefinition) -> StateModel:
        return replace(state_model(state), ends_later=True)

    bounds = MachineBounds(faults=2)
    return explore(lambda: MachineSystem(definition, model, bounds, required, reduces=reduces), '')


def test_situations_after_a_stop_differ_only_in_what_has_not_halted() -> None:
    never = parse_requirement('/Out at most 3 times', 'test').requirement
    assert two_legs(never).configurations < two_legs(never, reduces=False).configurations


def test_after_a_stop_no_requirement_is_waited_for() -> None:
    soon = parse_requirement('after /Out, /Home within 1 s', 'test').requirement
    assert 'error' in two_legs(soon).ends  # what ignores its cancel has all the time that the run waits for it


def side_by_side(random: Random, number: int) -> MachineDefinition:
    """So many robots that do the same: a random machine each, or a state."""
    body = random.randrange(10**6)

    def robot() -> OperatableStateMachine | Scripted:
        own = Random(body)
        return Scripted('x', 'y') if own.random() < 0.5 else build(random_machine(own, states=2))[0]

    while True:
        body += 1
        robots = {label: robot() for label in 'ABC'[:number]}
        outcomes = list(robots['A'].outcomes)
        ends = [('x', [(label, outcomes[0])]) for label in robots]
        if random.random() < 0.5:
            ends = [('x', [(label, outcomes[0]) for label in robots])]
        ends += [('y', [(label, outcome)]) for outcome in outcomes[1:] for label in robots]
        both = ConcurrencyContainer(outcomes=['x', 'y'], conditions=ends)
        machine = OperatableStateMachine(outcomes=['finished', 'failed'])
        try:
            with both:
                for label, one in robots.items():
                    OperatableStateMachine.add(label, one)
            with machine:
                OperatableStateMachine.add('Robots', both, {'x': 'finished', 'y': 'failed'})
            return define(machine)
        except MachineError:
            continue


class Seen(MachineSystem):
    """Notes in which situations it was, whichever of its robots is where."""

    def __init__(self, *given: Any, **options: Any) -> None:
        super().__init__(*given, **options)
        self.situations = set[tuple[str, ...]]()

    def capture(self) -> Configuration:
        places = (
            re.sub(r'/(Robots/[ABC]|Fleet/Robot\d)', '/one', place)
            for place in self.position().removeprefix('active: ').split(', ')
        )
        self.situations.add(tuple(sorted(places)))
        return super().capture()


def beside(seed: int, *, is_mirrored: bool) -> tuple[Report, set[tuple[str, ...]]]:
    situations = set[tuple[str, ...]]()
    random = Random(seed)
    definition, bounds = side_by_side(random, random.choice([2, 3])), random.choice(BOUNDS)
    resources = frozenset(['base'] if random.random() < 0.3 else [])

    def model(state: StateDefinition) -> StateModel:
        return replace(state_model(state), resources=resources, server='fleet')

    def system() -> Seen:
        made = Seen(definition, model, bounds)
        made.situations = situations
        return made

    with patch.object(machine_system, 'interchangeable', interchangeable if is_mirrored else lambda machine: []):
        return explore(system, '', limits=ExplorationLimits(600, 300)), situations


@pytest.mark.parametrize('seed', [0, 1, 2, 4, 11, 19, 20, 23, 24, 37])  # small enough to be followed to their end
def test_robots_that_do_the_same_are_followed_once(seed: int) -> None:
    """What is found of one of them might be told of another one, at the same distance."""
    mirrored, seen = beside(seed, is_mirrored=True)
    without, all_seen = beside(seed, is_mirrored=False)
    assert without.is_complete
    assert seen == all_seen
    assert mirrored.configurations <= without.configurations
    nearest = [
        {one.violation.property: len(one.moves) for one in reversed(report.counterexamples)}
        for report in (mirrored, without)
    ]
    assert nearest[0] == nearest[1]
    assert verdict(mirrored)[1:3] == verdict(without)[1:3]


def fleet(number: int, *, reduces: bool) -> Seen:
    """Robots that drive, look and return, each in a machine of its own."""
    labels = [f'Robot{place}' for place in range(number)]
    together = ConcurrencyContainer(
        outcomes=['done', 'failed'],
        conditions=[
            ('done', [(label, 'done') for label in labels]),
            *(('failed', [(label, 'failed')]) for label in labels),
        ],
    )
    for label in labels:
        robot = OperatableStateMachine(outcomes=['done', 'failed'])
        with robot:
            for state, following in (('Drive', 'Look'), ('Look', 'Return'), ('Return', 'done')):
                OperatableStateMachine.add(state, Scripted('done', 'failed'), {'done': following, 'failed': 'failed'})
        with together:
            OperatableStateMachine.add(label, robot)
    machine = OperatableStateMachine(outcomes=['finished', 'failed'])
    with machine:
        OperatableStateMachine.add('Fleet', together, {'done': 'finished', 'failed': 'failed'})
    definition = define(machine)

    def model(state: StateDefinition) -> StateModel:
        return replace(state_model(state), server='BT server')

    return Seen(definition, model, reduces=reduces)


def test_of_a_fleet_of_robots_that_do_the_same_few_situations_are_left() -> None:
    systems: list[Seen] = []

    def explored(*, reduces: bool) -> tuple[Report, set[tuple[str, ...]]]:
        systems.clear()

        def make() -> Seen:
            systems.append(fleet(2, reduces=reduces))
            return systems[-1]

        report = explore(make, '')
        return report, set().union(*(one.situations for one in systems))

    (reduced, seen), (without, all_seen) = explored(reduces=True), explored(reduces=False)
    assert reduced.holds and without.holds and not reduced.uncovered
    assert (reduced.ends.keys(), seen) == (without.ends.keys(), all_seen)
    assert reduced.configurations < without.configurations


def first_of_two(kind: type[OperatableStateMachine], *, reduces: bool) -> Report:
    """Return the first that is done ends it, and one of them may be forced to search."""
    both = ConcurrencyContainer(outcomes=['done'], conditions=[('done', [(label, 'done')]) for label in 'AB'])
    for label in 'AB':
        robot = kind(outcomes=['done'])
        with robot:
            for state, other in (('Drive', 'Search'), ('Search', 'Drive')):
                OperatableStateMachine.add(state, Scripted('done', 'lost'), {'done': 'done', 'lost': other})
        with both:
            OperatableStateMachine.add(label, robot)
    machine = OperatableStateMachine(outcomes=['done'])
    with machine:
        OperatableStateMachine.add('Both', both, {'done': 'done'})
    definition = define(machine)

    def model(state: StateDefinition) -> StateModel:
        return replace(state_model(state), outcomes=('done',), server='fleet')

    bounds = MachineBounds(Operator.ALL, forces=1, stops=False)
    return explore(lambda: MachineSystem(definition, model, bounds, reduces=reduces), '')


@pytest.mark.parametrize(('kind', 'is_alike'), [(OperatableStateMachine, True), (PriorityContainer, False)])
def test_what_one_of_them_comes_to_counts_for_each_unless_the_first_has_priority(
    kind: type[OperatableStateMachine], is_alike: bool
) -> None:
    reduced, without = first_of_two(kind, reduces=True), first_of_two(kind, reduces=False)
    assert reduced.uncovered == without.uncovered
    assert '/Both/A/Search > done' not in without.uncovered
    assert ('/Both/B/Search > done' in without.uncovered) is not is_alike
    assert (reduced.configurations < without.configurations) is is_alike


@pytest.mark.parametrize('reduces', [True, False])
def test_a_way_of_any_of_them_can_be_made(reduces: bool) -> None:
    """As a saved test makes it, which may be older than that they are the same."""
    system = fleet(2, reduces=reduces)
    system.step(system.labels()[0], EnvironmentChoices())
    subjects = {label.subject for label in system.labels()}
    assert ('/Fleet/Robot1/Drive' in subjects) is not reduces
    system.step(Label('outcome', '/Fleet/Robot0/Drive', 'done'), EnvironmentChoices())
    assert '/Fleet/Robot1/Drive' in {label.subject for label in system.labels()}


@pytest.mark.parametrize(
    ('conditions', 'other', 'is_alike'),
    [
        ([('x', [('A', 'done'), ('B', 'done')]), ('y', [('A', 'other')]), ('y', [('B', 'other')])], '', True),
        ([('y', [('B', 'other')]), ('y', [('A', 'other')]), ('x', [('A', 'done')]), ('x', [('B', 'done')])], '', True),
        ([('x', [('A', 'done')]), ('y', [('A', 'other')])], '', False),
        ([('x', [('A', 'done')]), ('y', [('B', 'done')]), ('y', [('A', 'other')]), ('y', [('B', 'other')])], '', False),
        ([('x', [('A', 'done'), ('B', 'done')]), ('y', [('A', 'other')]), ('y', [('B', 'other')])], 'base', False),
    ],
)
def test_interchangeable_is_what_is_the_same_and_ends_its_container_alike(
    conditions: list[tuple[str, list[tuple[str, str]]]], other: str, is_alike: bool
) -> None:
    both = ConcurrencyContainer(outcomes=['x', 'y'], conditions=conditions)
    with both:
        for label in 'AB':
            OperatableStateMachine.add(label, Scripted('done', 'other'))
    machine = OperatableStateMachine(outcomes=['x', 'y'])
    with machine:
        OperatableStateMachine.add('Both', both, {'x': 'x', 'y': 'y'})

    def model(state: StateDefinition) -> StateModel:
        has = frozenset([other] if other and state.label == 'B' else [])
        return replace(state_model(state), resources=has, server='')

    modelled_machine = modelled(define(machine), model, MachineEnvironment(lambda violation: None))
    assert interchangeable(modelled_machine) == ([('/Both/A', '/Both/B')] if is_alike else [])

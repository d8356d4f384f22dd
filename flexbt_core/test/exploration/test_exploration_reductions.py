# SPDX-License-Identifier: BSD-3-Clause
"""What a proof leaves out makes no difference: the same is found, and the same ends, with it and without."""

from __future__ import annotations

from dataclasses import replace
from random import Random
from unittest.mock import patch

import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from flexbt_core.behavior_tree import TreeKey, TreeLibrary, builtin_registry, input_port, load_xml, output_port
from flexbt_core.behavior_tree.model import STRING, UINT16
from flexbt_core.exploration import (
    Bounds,
    Limits,
    MachineSystem,
    Operator,
    Report,
    StateModel,
    TreeSystem,
    explore,
    state_model,
)
from flexbt_core.exploration.state_models import ModelState
from flexbt_core.monitors import MachineMonitor, Requirement, parse_requirement
from flexbt_core.skills import Skill
from flexbt_core.state_machine import (
    MachineDefinition,
    MachineError,
    OperatableStateMachine,
    StateDefinition,
    define,
)
from flexbt_testing.behavior_trees.seeded_trees import IsClear, StandIn, Turn
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
    limits = Limits(seconds=600, configurations=300)
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

BOUNDS = (Bounds(), Bounds(faults=2), Bounds(Operator.ALL, forces=1), Bounds(Operator.NONE))


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
    exited, on_exit = MachineMonitor.exited, ModelState.on_exit

    def model(state: StateDefinition) -> StateModel:
        return replace(state_model(state), resources=frozenset(['base'] if state.path in driving else []))

    def explored(*, reduces: bool) -> Report:
        limits = Limits(seconds=600, configurations=200)
        return explore(lambda: MachineSystem(definition, model, bounds, reduces=reduces), '', limits=limits)

    with (
        patch.object(MachineMonitor, 'exited', lambda one, path: None if path == not_left else exited(one, path)),
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

    bounds = Bounds(faults=2)
    return explore(lambda: MachineSystem(definition, model, bounds, required, reduces=reduces), '')


def test_situations_after_a_stop_differ_only_in_what_has_not_halted() -> None:
    never = parse_requirement('/Out at most 3 times', 'test').requirement
    assert two_legs(never).configurations < two_legs(never, reduces=False).configurations


def test_after_a_stop_no_requirement_is_waited_for() -> None:
    soon = parse_requirement('after /Out, /Home within 1 s', 'test').requirement
    assert 'error' in two_legs(soon).ends  # what ignores its cancel has all the time that the run waits for it

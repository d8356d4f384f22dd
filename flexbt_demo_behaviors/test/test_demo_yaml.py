# SPDX-License-Identifier: BSD-3-Clause
"""Every behavior of the demonstrations can be written in YAML, and is then the same."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from flexbt_core import Autonomy, MachineDefinition, OperatableStateMachine, StateDefinition
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest, BehaviorParameter, ParameterValue
from flexbt_onboard.behaviors.behavior_library import BehaviorEntry, BehaviorLibrary, machine_entry
from flexbt_onboard.behaviors.run_building import definition_of
from flexbt_states import BtExecuteState, BtLoaderState, OperatorDecisionState
from flexbt_testing.behavior_trees.bt_tool import behavior_tool as tool

TEXTS = Path(__file__).parent / 'behaviors'
SHIPPED = Path(__file__).parents[1] / 'flexbt_demo_behaviors/goals/reach_goal.yaml'
PLACES = 'flexbt_demo_behaviors/night_watch/places.yaml'


class ReachGoal(Behavior):
    """The behavior that is shipped in YAML, in Python."""

    manifest = BehaviorManifest(
        name='Reach Goal',
        description='Reach the goal of a mission; where there is no way, ask a person.',
        author='The FlexBT developers',
        parameters=[
            BehaviorParameter(
                'tree',
                'flexbt_demo_behaviors/goals/bring_cup.xml',
                'behavior tree that reaches the goal, as package/path',
            )
        ],
    )

    tree: str

    def create(self) -> OperatableStateMachine:
        return_to = {'done': 'reached', 'canceled': 'given_up', 'failed': 'Ask'}
        ask = OperatorDecisionState(outcomes=['again', 'give_up'], hint='There is no way to the goal. And now?')
        with OperatableStateMachine(['reached', 'given_up', 'failed'], autonomy=Autonomy.Off) as machine:
            machine.add('LoadTree', BtLoaderState(filepaths=[self.tree]), {'done': 'Reach', 'failed': 'failed'})
            machine.add('Reach', BtExecuteState(bt_file=self.tree), return_to)
            levels = {'again': Autonomy.Full, 'give_up': Autonomy.Full}
            machine.add('Ask', ask, {'again': 'Reach', 'give_up': 'given_up'}, levels)
        return machine


PYTHON: dict[str, BehaviorEntry | None] = {**BehaviorLibrary.discover().entries, 'Reach Goal': None}
FILES = {
    'Ask Operator': TEXTS / 'ask_operator.yaml',
    'Inspect Site': TEXTS / 'inspect_site.yaml',
    'Inspection': TEXTS / 'inspection.yaml',
    'Navigate': TEXTS / 'navigate.yaml',
    'Navigate Split': TEXTS / 'navigate_split.yaml',
    'Night Watch': TEXTS / 'night_watch.yaml',
    'Reach Goal': SHIPPED,
}
OTHERS: dict[str, dict[str, ParameterValue]] = {  # values beside the defaults
    'Ask Operator': {'question': '$5?', 'tree': 'flexbt_demo_behaviors/navigate/navigate.xml'},
    'Inspect Site': {'duration': 7.5},
    'Inspection': {'site': 'off', 'duration': 1.0},
    'Navigate': {'tree': 'flexbt_demo_behaviors/nav2_robot/navigate_to_pose.xml'},
    'Navigate Split': {'recovery': 'flexbt_demo_behaviors/navigate/navigate.xml'},
    'Night Watch': {'rooms': 'lab archive', 'home': 'beta_dock', 'partner': 'beta'},
    'Reach Goal': {'tree': 'flexbt_demo_behaviors/navigate/navigate.xml'},
}


def in_yaml(name: str) -> BehaviorEntry:
    return machine_entry('none', FILES[name].read_text(), 'flexbt_demo_behaviors', FILES[name].name)


def in_python(name: str) -> Behavior:
    entry = PYTHON[name]
    return ReachGoal() if entry is None else entry.instantiate()


def plain(value: Any) -> Any:
    """Return what a state was made of, as far as it can be compared."""
    if isinstance(value, Mapping):
        return {name: plain(one) for name, one in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(one) for one in value]
    return value if isinstance(value, str | int | float | bool | None) else type(value)


def contents(definition: MachineDefinition) -> list[Any]:
    """Return all of a machine: structure, keys, values, transitions, conditions, and what its states were made of."""
    rows: list[Any] = []
    for node, entry in zip(definition.nodes(), definition.structure(), strict=True):
        if isinstance(node, StateDefinition):
            state = node.state.unwrapped
            own: Any = node.state.input_keys, node.state.output_keys, type(state), plain(vars(state))
        else:
            own = node.input_keys, node.output_keys, dict(node.defaults), node.initial, node.conditions
        rows.append((entry, dict(node.transitions), dict(node.remap), own))
    return rows


def test_the_texts_are_of_all_behaviors_of_the_package() -> None:
    installed = {one.name for one in BehaviorLibrary.discover().entries.values() if 'demo' in one.package}
    assert installed - FILES.keys() == {'Check Room'}, 'which is written in YAML only'
    assert FILES.keys() <= installed


@pytest.mark.parametrize('name', FILES)
def test_a_behavior_in_yaml_is_the_same_as_in_python(name: str) -> None:
    entry, behavior = in_yaml(name), in_python(name)
    assert (entry.name, entry.manifest) == (name, behavior.manifest)
    assert entry.parameters == tuple(behavior.parameters.values())
    assert entry.machine == '', 'it was not synthesized'
    for values in ({}, OTHERS[name]):
        made, expected = entry.instantiate(), in_python(name)
        for parameter, value in values.items():
            made.set_parameter(parameter, value)
            expected.set_parameter(parameter, value)
        assert (made.operator_gone, made.operator_gone_after) == (expected.operator_gone, expected.operator_gone_after)
        written = contents(definition_of(made))
        assert written == contents(definition_of(expected))
        assert not values or written != contents(definition_of(entry.instantiate())), 'the parameters matter'


@pytest.mark.parametrize('name', FILES)
def test_a_file_is_checked_as_the_behavior_is(name: str) -> None:
    done, expected = (tool('check', one, '--json') for one in (str(FILES[name]), name))
    assert done.code == expected.code == 0
    assert done.out == expected.out


def test_the_shipped_one_is_installed_from_its_file() -> None:
    entry = BehaviorLibrary.discover().find('Reach Goal')
    assert entry.error == ''
    assert contents(definition_of(entry.instantiate())) == contents(definition_of(ReachGoal()))


@pytest.mark.parametrize(
    ('parameter', 'value', 'place'),
    [('rooms', 'store cellar', "52:39: /Watch/Round/NextRoom: .* 'cellar'"), ('home', 'cellar', '25:27: /FindHome: ')],
)
def test_a_value_that_a_state_refuses_is_told_where_it_is_used(parameter: str, value: str, place: str) -> None:
    behavior = in_yaml('Night Watch').instantiate()
    behavior.set_parameter(parameter, value)
    with pytest.raises(Exception, match=f'^night_watch.yaml:{place}'):
        behavior.create()

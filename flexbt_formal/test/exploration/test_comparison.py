# SPDX-License-Identifier: BSD-3-Clause
"""Two versions of a tree side by side: what was written otherwise does the same, and what does not is shown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from flexbt_core.behavior_tree.engine.leaf import Condition, SyncAction
from flexbt_core.behavior_tree.model.definition import NodeDefinition, TreeKey, TreeLibrary
from flexbt_core.behavior_tree.model.ports import FLOAT, STRING, input_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_formal.exploration.comparison import Comparison, compare, names_of
from flexbt_formal.exploration.explorer import ExplorationLimits
from flexbt_formal.exploration.leaf_models import LeafModel, LeafModels, leaf_model
from flexbt_formal.exploration.machine_system import MachineSystem
from flexbt_formal.exploration.tree_system import TreeSystem
from flexbt_testing.seeded_missions import Plan, StandIn


class Drive(StandIn):
    ports = {'path': input_port(STRING), 'speed': input_port(STRING, default='slow')}


class IsSafe(Condition):
    def tick(self) -> NodeStatus:
        raise AssertionError('a proof runs no real leaf')


class IsNear(IsSafe):
    ports = {'distance': input_port(FLOAT, default=0.5)}


class Note(SyncAction):
    ports = {'text': input_port(STRING)}

    def tick(self) -> NodeStatus:
        raise AssertionError('a proof runs no real leaf')


def wheels(definition: NodeDefinition) -> LeafModel:
    model = leaf_model(definition)
    return replace(model, resources=frozenset(('wheels',))) if definition.manifest.id == 'Drive' else model


class Work(EventState):
    def __init__(self) -> None:
        super().__init__(['done', 'failed'], desired_rate=None)


class OtherWork(Work):
    pass


add = OperatableStateMachine.add


def versions(
    before: str,
    now: str,
    limits: ExplorationLimits | None = None,
    models: LeafModels | tuple[LeafModels, LeafModels] = leaf_model,
) -> Comparison:
    def maker(tree: str, model: LeafModels) -> Callable[[], TreeSystem]:
        registry = builtin_registry()
        registry.register_classes([Plan, Drive, Note, IsSafe, IsNear])
        text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{tree}</BehaviorTree></root>'
        library = TreeLibrary([load_xml(text, 'main.xml', registry)])
        return lambda: TreeSystem(library, TreeKey('main.xml', 'Main'), model, given=('goal', 'path'))

    first, second = models if isinstance(models, tuple) else (models, models)
    return compare(maker(before, first), maker(now, second), limits)


DRIVE = '<Drive path="{path}"/>'


@pytest.mark.parametrize(
    ('before', 'now'),
    [
        (DRIVE, f'<Sequence><AlwaysSuccess/>{DRIVE}</Sequence>'),  # other numbers of nodes without a name
        (f'<Inverter><Inverter>{DRIVE}</Inverter></Inverter>', DRIVE),
        ('<Sequence><IsSafe/><IsNear/></Sequence>', '<Sequence><IsNear/><IsSafe/></Sequence>'),
        (f'<ReactiveSequence><IsSafe/>{DRIVE}</ReactiveSequence>',
         f'<WhileDoElse><IsSafe/>{DRIVE}<AlwaysFailure/></WhileDoElse>'),
    ],
    ids=['deeper', 'inverted twice', 'order of conditions', 'another control'],
)  # fmt: skip
def test_what_is_only_written_otherwise_does_the_same(before: str, now: str) -> None:
    found = versions(before, now)
    assert found.is_complete and found.is_same, found.differences


@pytest.mark.parametrize(
    ('before', 'now', 'seen_before', 'seen_now', 'steps'),
    [
        ('<RetryUntilSuccessful num_attempts="2"><Drive path="{path}"/></RetryUntilSuccessful>', DRIVE,
         ['Drive begins'], ['the tree ends: FAILURE'], 2),
        ('<ReactiveSequence><IsSafe/><Drive path="{path}"/></ReactiveSequence>',
         '<Sequence><IsSafe/><Drive path="{path}"/></Sequence>',
         ['Drive is being canceled', 'the tree ends: FAILURE'], ['the tree ends: SUCCESS'], 2),
        ('<Timeout msec="1000"><Drive path="{path}"/></Timeout>',
         '<Timeout msec="2000"><Drive path="{path}"/></Timeout>',
         ['1 s go by', 'Drive is being canceled', 'the tree ends: FAILURE'],
         ['2 s go by', 'Drive is being canceled', 'the tree ends: FAILURE'], 2),
        ('<Timeout msec="1000"><Drive path="{path}"/></Timeout>', DRIVE,
         ['Drive begins', 'can happen next, only here: time goes by'], ['Drive begins'], 1),
        ('<Drive name="go" path="{path}"/>', '<Plan name="go" path="{path}"/>',
         ['go begins', 'go: Drive path="{path}" (\'\') speed="slow"'], ['go begins', 'go: Plan path="{path}"'], 1),
        ('<Sequence><Script code="v:=\'fast\'"/><Drive path="{path}" speed="{v}"/></Sequence>',
         '<Sequence><Script code="v:=\'faster\'"/><Drive path="{path}" speed="{v}"/></Sequence>',
         ['Drive begins', 'Drive: speed="{v}" (\'fast\')'], ['Drive begins', 'Drive: speed="{v}" (\'faster\')'], 1),
    ],
    ids=['attempts', 'memory', 'time', 'no time limit', 'another leaf', 'another value'],
)  # fmt: skip
def test_a_difference_is_shown_by_the_shortest_way(
    before: str, now: str, seen_before: list[str], seen_now: list[str], steps: int
) -> None:
    found = versions(before, now)
    first = found.differences[0]
    assert (list(first.before), list(first.now)) == (seen_before, seen_now)
    assert first.lines[-1].startswith(f'{steps}. ')
    other_way = versions(now, before).differences[0]
    assert (other_way.before, other_way.now) == (first.now, first.before)


def test_of_machines_transitions_and_types_of_states_are_compared() -> None:
    def maker(after_plan: str, driver: type[EventState]) -> Callable[[], MachineSystem]:
        with OperatableStateMachine(['finished', 'failed']) as machine:
            add('Plan', Work(), {'done': 'Drive', 'failed': after_plan})
            add('Drive', driver(), {'done': 'finished', 'failed': 'failed'})
        definition = define(machine)
        return lambda: MachineSystem(definition)

    before = maker('failed', Work)
    assert compare(before, maker('failed', Work)).is_same
    (wrong_target, *_) = compare(before, maker('Drive', Work)).differences
    assert wrong_target.lines[-1] == '2. outcome /Plan failed'
    assert wrong_target.now[0] == '/Plan > failed -> /Drive'
    (other_type,) = compare(before, maker('failed', OtherWork)).differences
    assert (other_type.before[-1], other_type.now[-1]) == ('/Drive: Work', '/Drive: OtherWork')


def test_what_comes_after_a_violation_is_compared_and_so_is_the_violation_itself() -> None:
    # Two leaves that have the wheels at once: wrong in both, and followed.
    both = '<Parallel success_count="2"><Drive name="a" path="{path}"/><Drive name="b" path="{path}"/></Parallel>'
    tail = '<Plan/>'
    before = f'<Sequence>{both}{tail}{tail}</Sequence>'
    assert (same := versions(before, before, models=wheels)).is_same and same.is_complete
    found = versions(before, f'<Sequence>{both}{tail}</Sequence>', models=wheels)
    assert found.differences[0].now[-1] == 'the tree ends: SUCCESS'
    wrong_only_now = versions(before, before, models=(leaf_model, wheels)).differences[0]
    assert any('has two owners at once' in line for line in wrong_only_now.now)
    assert not any(line.startswith('wrong') for line in wrong_only_now.before)


def script(value: str) -> str:
    return f'<Sequence><Script code="k:={value}"/><Drive path="{{path}}" speed="{{k}}"/></Sequence>'


def noted(value: str) -> str:
    script = '<Script code="k:=\'{}\'"/>'.format
    return f'<Sequence>{script(value)}<Note text="{{k}}"/>{script("0")}{DRIVE}</Sequence>'


@pytest.mark.parametrize(
    ('before', 'now', 'seen'),
    [
        (noted('1'), noted('2'),
         "Note: text=\"{k}\" ('2')"),
        (script("'0'"), script("''"), "Drive: speed=\"{k}\" ('')"),
    ],
    ids=['input that is written over', 'empty text'],
)  # fmt: skip
def test_inputs_are_those_with_which_a_leaf_begins(before: str, now: str, seen: str) -> None:
    assert seen in versions(before, now).differences[0].now


def near(distance: str) -> str:
    return f'<Sequence><IsNear{distance}/>{DRIVE}</Sequence>'


def watched(distance: str) -> str:
    return f'<ReactiveSequence><IsNear{distance}/>{DRIVE}</ReactiveSequence>'


def scripted(distance: str) -> str:
    return f'<Sequence><Script code="d:={distance}"/>{near(""" distance="{d}" """.rstrip())}</Sequence>'


@pytest.mark.parametrize(
    ('before', 'now', 'seen'),
    [
        (near(' distance="1.0"'), near(' distance="2.0"'), 'IsNear: distance="2.0"'),
        (near(''), near(' distance="2.0"'), 'IsNear: distance="2.0"'),
        (near(' distance="{near}"'), near(' distance="{far}"'), 'IsNear: distance="{far}" (0.0)'),
        (scripted('1.5'), scripted('2.5'), 'IsNear: distance="{d}" (2.5)'),
        (watched(' distance="1.0"'), watched(' distance="2.0"'), 'IsNear: distance="2.0"'),
        ('<Script code="mode:=1"/>', '<Script code="mode:=2"/>', 'after the end, {mode} is 2'),
    ],
    ids=['literal', 'default', 'other key', 'value on the blackboard', 'reactive', 'handed over'],
)  # fmt: skip
def test_what_conditions_are_asked_with_and_what_is_handed_over_is_compared(before: str, now: str, seen: str) -> None:
    assert seen in versions(before, now).differences[0].now
    assert versions(now, now).is_same


@pytest.mark.parametrize('distance', ['', ' distance="0.50"'], ids=['default', 'other digits'])
def test_the_same_number_written_otherwise_is_the_same_input(distance: str) -> None:
    assert versions(near(' distance="0.5"'), near(distance)).is_same


class Timed(EventState):
    def __init__(self, seconds: float, places: list[str], judge: Callable[[int], bool]) -> None:
        super().__init__(['done'], desired_rate=None)
        self._seconds, self._places, self._judge, self._running = seconds, places, judge, object()
        self._bounds, self._kind = ExplorationLimits(seconds), ExplorationLimits  # a dataclass, and its class


def test_of_machines_parameters_of_states_and_given_userdata_are_compared() -> None:
    def maker(seconds: float, place: str, least: int, count: int) -> Callable[[], MachineSystem]:
        with OperatableStateMachine(['finished']) as machine:
            machine.userdata['count'] = count
            add('Look', Timed(seconds, ['dock', place], lambda number: number > least), {'done': 'finished'})
        definition = define(machine)
        return lambda: MachineSystem(definition)

    before = maker(1.0, 'door', 3, 0)
    assert compare(before, maker(1.0, 'door', 3, 0)).is_same
    for other in (
        maker(2.0, 'door', 3, 0),
        maker(1.0, 'desk', 3, 0),
        maker(1.0, 'door', 4, 0),
        maker(1.0, 'door', 3, 1),
    ):
        assert not compare(before, other).is_same
    (seconds,) = compare(before, maker(2.0, 'door', 3, 0)).differences
    state = Timed(2.0, ['dock'], bool)
    assert state.made_with == {'configurations': str(ExplorationLimits().configurations), 'seconds': '2.0'}
    assert seconds.now[-1] == '/Look: seconds=2.0 bounds=ExplorationLimits(2.0, 200000, None)'


def test_a_node_without_a_name_is_not_taken_for_one_that_has_its_name() -> None:
    assert names_of(['Sequence::1', 'Plan::2', 'Plan', 'Sub::4', 'Sub::4/Plan::5', 'Sub::4/Plan']) == {
        'Sequence::1': 'Sequence', 'Plan::2': 'Plan (2)', 'Plan': 'Plan',
        'Sub::4': 'Sub', 'Sub::4/Plan::5': 'Sub/Plan (2)', 'Sub::4/Plan': 'Sub/Plan',
    }  # fmt: skip


def test_what_is_cut_off_is_said() -> None:
    found = versions(DRIVE, DRIVE, ExplorationLimits(configurations=1))
    assert found.is_same and not found.is_complete and 'limit of 1 situations' in found.stopped_by

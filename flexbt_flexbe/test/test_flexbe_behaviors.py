# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE behaviors: found by their manifests, started with parameters, and run by the executive."""

from __future__ import annotations

import itertools
import math
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from flexbe_packages import GREET, HOLD, PARAMS, PATROL, TREES, manifest, write_package

from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_flexbe import EventState, OperatableStateMachine, discovery, shim
from flexbt_flexbe.api.behavior import converted
from flexbt_flexbe.hosted_behavior import without_harmless_faults
from flexbt_onboard.behaviors.behavior_library import BehaviorEntry, BehaviorLibrary
from flexbt_onboard.behaviors.run_building import RunRequest, check_given, definition_of
from flexbt_onboard.behaviors.run_context import building
from flexbt_onboard.errors import OnboardError, ParameterError
from flexbt_testing.hostile_yaml import HOSTILE_YAML
from flexbt_testing.nodes.state_bench import StateBench
from flexbt_testing.waiting import processor_time, wait_until

_numbers = itertools.count()


OF_ROS_1 = """
from flexbe_core import Behavior


class OldSM(Behavior):
    def __init__(self):
        super().__init__()
"""


@dataclass
class Installed:
    """A package with the behaviors Patrol and Greet."""

    name: str
    prefix: Path

    def entries(self) -> dict[str, BehaviorEntry]:
        """Return the behaviors that are found, by name."""
        return {entry.name: entry for entry in discovery.entries() if entry.package == self.name}

    def add(self, **files: str) -> None:
        """More manifests."""
        write_package(self.prefix, self.name, manifests={f'{k}.xml': v for k, v in files.items()}, sources={})


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Installed]:
    name = f'patrol_behaviors_{next(_numbers)}'  # Python remembers modules by their names
    before = set(sys.modules)
    path = list(sys.path)
    python = write_package(
        tmp_path,
        name,
        manifests={
            'patrol.xml': manifest(name, 'Patrol', 'patrol_sm', 'PatrolSM', PARAMS),
            'inner/greet.xml': manifest(name, 'Greet', 'greet_sm', 'GreetSM'),
        },
        sources={
            'patrol_sm.py': PATROL.replace('{package}', name),
            'greet_sm.py': GREET,
            'old_sm.py': OF_ROS_1,
            'ros_1_sm.py': 'import rospy',
            'mixin_sm.py': 'import flexbe_core.core.lockable_state',
        },
    )
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path), prepend=':')
    monkeypatch.syspath_prepend(str(python))
    yield Installed(name, tmp_path)
    for module in set(sys.modules) - before:
        if module.partition('.')[0] in (name, *shim.PACKAGES):
            del sys.modules[module]
    sys.path[:] = path


def run(bench: StateBench, entry: BehaviorEntry, *arguments: tuple[str, str]) -> list[str]:
    """Return what the operator is told; the run has to finish."""
    going = bench.run_behavior(entry, *arguments)
    assert going.wait() == 'finished', going.lines
    return [text for _, _, text in going.lines]


def test_behaviors_are_found_by_their_manifests_with_all_kinds_of_parameters(package: Installed) -> None:
    entries = package.entries()
    assert set(entries) == {'Patrol', 'Greet'}
    message = entries['Patrol'].to_message()
    assert (message.name, message.package, message.author) == ('Patrol', package.name, 'Somebody')
    assert message.description == 'Goes round. And greets.'
    assert [
        (one.name, one.type, one.default_value, list(one.choices), one.label, one.description)
        for one in message.parameters
    ] == [
        ('rounds', 'float', '2.0', [], 'Rounds', 'How often'),
        ('speed', 'float', '0.5', [], 'Speed', 'm/s'),
        ('is_loud', 'bool', 'false', [], 'Loud', ''),
        ('mode', 'string', 'slow', ['slow', 'fast'], 'Mode', ''),
        ('title', 'string', '', [], 'Title', ''),
        ('places', 'string', '', [], 'Places', ''),
    ]
    assert (message.parameters[0].minimum, message.parameters[0].maximum) == ('1', '5')
    assert message.error == ''


def test_the_executives_library_has_them(package: Installed) -> None:
    library = BehaviorLibrary(discovery.entries())
    assert library.find('Patrol') is library.find(f'{package.name}/Patrol')


def test_a_behavior_runs_with_embedded_ones_and_a_container(package: Installed, bench: StateBench) -> None:
    lines = run(bench, package.entries()['Patrol'])
    assert [line for line in lines if 'left out' not in line and 'no effect' not in line] == [
        'Hello operator!',
        "[2, 0.5, False, 'slow', '', {}] 2",
        'both',
        'Goodbye operator2',
    ]


def test_what_does_no_harm_is_told_and_left_out(package: Installed, bench: StateBench) -> None:
    lines = run(bench, package.entries()['Patrol'])
    assert lines[0].startswith('/Forgotten: left out')


def test_a_state_that_only_an_outcome_of_no_state_leads_to_is_left_out_too() -> None:
    made = OperatableStateMachine(outcomes=['ended'])
    with made:
        OperatableStateMachine.add('A', EventState(['done']), {'done': 'ended', 'renamed': 'B'})
        OperatableStateMachine.add('B', EventState(['done']), {'done': 'ended'})
    told: list[str] = []
    without_harmless_faults(made, told.append)
    assert list(define(made).children) == ['A']
    assert [line.partition(',')[0] for line in told] == [
        '/B: left out',
        "/A: its transition of 'renamed' has no effect",
    ]


def test_arguments_are_values_of_the_types_that_the_code_declares(package: Installed, bench: StateBench) -> None:
    (package.prefix / 'share' / package.name / 'config' / 'places.yaml').write_text(
        'usual: &usual {home: [1, 2]}\nall: {<<: *usual}\nhome: 3\n'
    )
    entry = package.entries()['Patrol']
    words = [('rounds', '3'), ('speed', '1'), ('is_loud', 'True'), ('mode', 'fast'), ('title', 'Dr. ')]
    lines = run(bench, entry, *words, ('places', '{home: [1]}'))
    assert "[3, 1.0, True, 'fast', 'Dr. ', {'home': [1]}] 3" in lines
    assert 'Dr. Hello operator!' in lines, 'a parameter is set in embedded behaviors, too'
    for name, text in (
        ('places', f'{package.name}/config/places.yaml:all'),
        ('/YAML:places', f'{package.name}/config/places.yaml:all'),
    ):
        assert any("{'home': [1, 2]}" in line for line in run(bench, entry, (name, text)))


def test_a_path_sets_the_parameter_of_one_embedded_behavior_only(package: Installed, bench: StateBench) -> None:
    entry = package.entries()['Patrol']
    check_given(RunRequest(entry, (('/Hello/word', 'Moin'),), (), 3))  # in the mission queue as at a start
    assert 'Moin operator!' in run(bench, entry, ('/Hello/word', 'Moin'))
    lines = run(bench, entry, ('/Hello/title', 'Dr. '))
    assert 'Dr. Hello operator!' in lines and 'Goodbye operator2' in lines


def test_fixed_parameters_of_an_embedded_behavior_are_not_the_operators(package: Installed, bench: StateBench) -> None:
    assert 'Goodbye operator2' in run(bench, package.entries()['Patrol'], ('/Goodbye/word', 'Moin'))


@pytest.mark.parametrize(
    ('name', 'text', 'words'),
    [
        ('rounds', '6', 'outside of its limits 1 to 5'),
        ('rounds', '2.5', 'write a whole number'),
        ('rounds', 'two', 'write a number'),
        ('is_loud', 'perhaps', 'write true or false'),
        ('mode', 'fastest', 'none of its choices'),
        ('places', 'word', 'it is a str'),
        ('places', '{a: ', 'not a value of type dict'),
        ('places', '!!python/object/apply:os.getcwd []', 'not a value of type dict'),
        ('places', 'nowhere_at_all/x.yaml:key', "no installed package 'nowhere_at_all'"),
        ('/YAML:places', '/etc/passwd:x', 'not a package/relative/path.yaml'),
        ('unknown', '1', "no parameter 'unknown'"),
        ('/Hello/unknown', '1', "no parameter '/Hello/unknown'"),
        ('/Hell/word', 'x', "no parameter '/Hell/word'; there is no embedded behavior '/Hell', there are: /Goodbye,"),
        ('/Hello/times', 'x', "parameter '/Hello/times': 'x' is not a value of type int"),
    ],
)
def test_a_value_that_cannot_be_is_refused_before_anything_runs(
    package: Installed, bench: StateBench, name: str, text: str, words: str
) -> None:
    going = bench.run_behavior(package.entries()['Patrol'], (name, text))
    wait_until(lambda: going.refusal, 'refused')
    assert words in str(going.refusal)


@pytest.mark.parametrize('text', HOSTILE_YAML.values(), ids=HOSTILE_YAML)
@pytest.mark.parametrize('like', [{}, []], ids=['dict', 'list'])
def test_a_value_that_is_meant_to_do_harm_is_refused_in_time(like: object, text: str) -> None:
    began = processor_time()
    with pytest.raises(ParameterError) as caught:
        converted('places', text, like)
    assert processor_time() - began < 10.0
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize(('text', 'number'), [(' -7 ', -7), ('2e3', 2000), ('4.0', 4), (str(2**63 - 1), 2**63 - 1)])
def test_an_int_is_read_without_loss(text: str, number: int) -> None:
    """Also a stamp in nanoseconds, which no double is."""
    assert converted('stamp', text, 1) == number


@pytest.mark.parametrize('text', ['inf', 'nan', '2.5', str(2**63), '1e19', '9' * 400, '1e400', '9' * 10_000])
def test_a_number_that_is_no_int_is_refused(text: str) -> None:
    with pytest.raises(ParameterError):
        converted('rounds', text, 1)


@pytest.mark.parametrize('value', ['nan', math.nan])
def test_what_is_no_number_is_refused_where_the_code_declares_one(value: str | float) -> None:
    with pytest.raises(ParameterError, match='write a number'):
        converted('/Inner/speed', value, 0.5)


@pytest.mark.parametrize(
    ('name', 'key', 'words'),
    [
        ('rounds', 'often', 'outside of its limits 1 to 5'),
        ('rounds', 'none', 'write a number'),
        ('mode', 'often', 'none of its choices'),
        ('is_loud', 'often', 'write true or false'),
    ],
)
def test_a_value_in_a_file_is_within_the_limits_of_the_manifest(
    package: Installed, name: str, key: str, words: str
) -> None:
    (package.prefix / 'share' / package.name / 'config' / 'site.yaml').write_text('often: 6\nnone: .nan\nonce: 1\n')
    behavior = package.entries()['Patrol'].instantiate()
    file = f'{package.name}/config/site.yaml'
    behavior.set_arguments([('/YAML:rounds', f'{file}:once')])
    with pytest.raises(ParameterError, match=words):
        behavior.set_arguments([(f'/YAML:{name}', f'{file}:{key}')])


def test_nothing_is_set_twice(package: Installed) -> None:
    behavior = package.entries()['Patrol'].instantiate()
    with pytest.raises(ParameterError, match='given twice'):
        behavior.set_arguments([('/Hello/word', 'a'), ('Hello/word', 'b')])


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('<behavior name="Bad">', 'no element found'),
        ('<?xml version="1.0" encoding="utf-88"?><behavior name="Bad"/>', 'unknown encoding'),
        ('<?xml version="1.0" encoding="gbk"?><behavior name="Bad"/>', 'encoding'),
        ('<behaviour name="Bad"/>', 'not a manifest'),
        ('<behavior name=""><executable package_path="a.b" class="C"/></behavior>', 'not a manifest'),
        ('<behavior name="Bad"><executable package_path="a" class="C"/></behavior>', 'package_path'),
        (
            '<behavior name="Bad"><executable package_path="{p}.x" class="C"/>'
            '<params><param type="float" name="f"/></params></behavior>',
            "'float', not text, numeric, boolean, enum, yaml",
        ),
        (
            '<behavior name="Bad"><executable package_path="{p}.x" class="C"/>'
            '<params><param type="numeric" name="f" default="x"/></params></behavior>',
            'could not convert',
        ),
        (
            '<behavior name="Bad"><executable package_path="{p}.x" class="C"/>'
            '<params><param type="enum" name="f" default="x"><option value="y"/></param></params></behavior>',
            'not one of its choices',
        ),
        (
            '<behavior name="Bad"><executable package_path="{p}.missing_sm" class="C"/></behavior>',
            'build or install the package that has {p}.missing_sm',
        ),
        (
            '<behavior name="Bad"><executable package_path="{p}.ros_1_sm" class="C"/></behavior>',
            'ros_1_sm.py:1); rospy is of ROS 1: bring the behavior and its states to rclpy',
        ),
        (
            '<behavior name="Bad"><executable package_path="{p}.mixin_sm" class="C"/></behavior>',
            'mixin_sm.py:1); "Coming from FlexBE" says what is there of FlexBE',
        ),
        ('<behavior name="Bad"><executable package_path="{p}.greet_sm" class="Nope"/></behavior>', 'no such class'),
        ('<behavior name="Bad"><executable package_path="{p}.greet_sm" class="Logger"/></behavior>', 'not a Behavior'),
        (
            '<behavior name="Bad"><executable package_path="{p}.old_sm" class="OldSM"/></behavior>',
            'for ROS 1 take none',
        ),
    ],
)
def test_a_manifest_that_cannot_be_used_is_listed_with_the_reason(package: Installed, text: str, words: str) -> None:
    package.add(bad=text.replace('{p}', package.name))
    (bad,) = [entry for entry in package.entries().values() if entry.error]
    assert words.replace('{p}', package.name) in bad.error
    assert set(package.entries()) >= {'Patrol', 'Greet'}, 'the others continue working'


@pytest.mark.parametrize('encoding', ['utf-88', 'gbk'])
def test_a_package_whose_encoding_is_not_known_does_not_hide_the_others(package: Installed, encoding: str) -> None:
    write_package(package.prefix, 'of_others', manifests={}, sources={})
    other = package.prefix / 'share' / 'of_others' / 'package.xml'
    other.write_text(f'<?xml version="1.0" encoding="{encoding}"?>{other.read_text()}')
    assert set(package.entries()) == {'Patrol', 'Greet'}


def test_a_manifest_that_is_a_pipe_is_not_waited_for(package: Installed) -> None:
    package.add(bad='')
    (file,) = package.prefix.rglob('bad.xml')
    file.unlink()
    os.mkfifo(file)
    (bad,) = [entry for entry in package.entries().values() if entry.error]
    assert 'it is a pipe or device; give a regular file' in bad.error


def test_manifests_about_other_packages_and_disabled_ones_are_not_taken(package: Installed) -> None:
    package.add(**{'other': manifest('elsewhere', 'Other', 'x', 'X'), '#old': '<'})
    assert set(package.entries()) == {'Patrol', 'Greet'}


def test_an_installed_flexbe_is_named_as_the_reason(package: Installed, monkeypatch: pytest.MonkeyPatch) -> None:
    real = package.prefix / 'real' / 'flexbe_core'
    real.mkdir(parents=True)
    (real / '__init__.py').touch()
    monkeypatch.syspath_prepend(str(real.parent))
    assert f'flexbe_core is installed in {real}' in package.entries()['Greet'].error


def test_a_behavior_can_be_built_without_a_run_by_tools_that_look_at_its_machine(package: Installed) -> None:
    entry = package.entries()['Patrol']
    with building():
        behavior = entry.instantiate()
        behavior.set_arguments([('rounds', '3')])
        paths = [node.path for node in definition_of(behavior).nodes()]
    assert {'/Hello/Say', '/Both/Wait', '/Goodbye/Say'} <= set(paths)
    with pytest.raises(OnboardError, match='only where a behavior is built or run'):
        behavior.create()


def test_behaviors_with_the_states_of_the_paper_s_package_get_ours(package: Installed) -> None:
    sources = {'trees_sm.py': TREES.replace('{package}', package.name)}
    manifests = {'trees.xml': manifest(package.name, 'Trees', 'trees_sm', 'TreesSM')}
    write_package(package.prefix, package.name, manifests=manifests, sources=sources)
    (package.prefix / 'share' / package.name / 'config' / 'plan.xml').write_text('<root BTCPP_format="4"/>')
    with building():
        machine = definition_of(package.entries()['Trees'].instantiate())
    uses = {child.label: child.state.bt_use for child in machine.children.values()}  # type: ignore[union-attr]
    assert uses['Load'].files == (f'{package.name}/config/plan.xml',)
    assert uses['Set'].writes == {'limit': 'float64'}
    assert uses['Plan'].writes == {'goal': 'geometry_msgs/msg/PoseStamped'}
    assert uses['Plan'].reads == uses['Get'].reads == {'path': 'nav_msgs/msg/Path'}
    assert uses['Follow'].tree == f'{package.name}/config/plan.xml'


def test_a_running_behavior_is_switched_to_another_and_keeps_its_active_state(
    package: Installed, bench: StateBench
) -> None:
    title = '<params><param type="text" name="title" default="" label="" hint="" /></params>'
    manifests = {'hold.xml': manifest(package.name, 'Hold', 'hold_sm', 'HoldSM', title)}
    write_package(package.prefix, package.name, manifests=manifests, sources={'hold_sm.py': HOLD})
    entry = package.entries()['Hold']
    going = bench.run_behavior(entry, ('title', 'first'))
    wait_until(going.active, 'active')
    going.behavior_run.switch(RunRequest(entry, [('title', 'second')], (), 3))
    wait_until(lambda: going.answers, 'switched')
    assert going.answers == [None]
    wait_until(lambda: 'holding' in [text for _, _, text in going.lines], 'entered')
    going.force('/Hold', 'done')
    assert going.wait() == 'finished'
    assert [text for _, _, text in going.lines if text in ('holding', 'first', 'second')] == ['holding', 'second']


OF_CODE = """
from flexbe_core import Autonomy, Behavior, OperatableStateMachine
from flexbe_states.log_state import LogState
import math

TURN = 0.5


class RoundsBase(Behavior):
    greeting = 'Hello'
    LEGS = [[1, 2], 'home']

    def __init__(self, node):
        super().__init__()
        self.add_parameter('rounds', 2)
        self.extra = 0.5


class RoundsSM(RoundsBase):
    def __init__(self, node):
        super().__init__(node)
        self.name = 'Rounds'
        self.add_parameter('is_loud', False)
        self.add_parameter('places', dict())
        self.add_parameter('legs', self.LEGS)
        self.add_parameter('more', {1: [True, TURN]})
        self.add_parameter('turn', -2 * math.pi + TURN)
        self.add_parameter('most', float('inf'))
        own = 3
        self.add_parameter('own', own)
        self.add_parameter('nothing', None)
        for name in ('left', 'right'):
            self.add_parameter(name, 1)

    def create(self):
        machine = OperatableStateMachine(outcomes=['finished'])
        values = [self.rounds, self.is_loud, self.places, self.left, self.right, self.greeting, self.extra, self.legs]
        with machine:
            OperatableStateMachine.add('Say', LogState(text=str(values)), {'done': 'finished'}, {'done': Autonomy.Off})
        return machine
"""


@pytest.fixture
def rounds(package: Installed) -> BehaviorEntry:
    """Return a behavior most of whose parameters are in its code only."""
    (package.prefix / 'python' / package.name / 'rounds_sm.py').write_text(OF_CODE)
    params = '<parameter name="rounds" type="numeric" default="3" label="Rounds"/>'
    package.add(rounds=manifest(package.name, 'Rounds', 'rounds_sm', 'RoundsSM', params))
    return package.entries()['Rounds']


def test_parameters_of_the_code_are_offered_and_have_their_types(rounds: BehaviorEntry, bench: StateBench) -> None:
    offered = [(one.name, one.type, one.default_value) for one in rounds.to_message().parameters]
    assert offered == [
        ('rounds', 'float', '3.0'),
        ('is_loud', 'bool', 'false'),
        ('places', 'dict', '{}'),
        ('legs', 'list', '[[1, 2], home]'),
        ('more', 'dict', '{1: [true, 0.5]}'),
        ('turn', 'float', str(0.5 - 2 * math.pi)),
        ('most', 'float', 'inf'),
        ('own', 'string', ''),
        ('nothing', 'string', ''),
    ]
    assert run(bench, rounds) == ["[3, False, {}, 1, 1, 'Hello', 0.5, [[1, 2], 'home']]"]
    words = [('is_loud', 'true'), ('places', '{home: 1}'), ('left', '7'), ('/right', '8'), ('greeting', 'Hi')]
    more = [('legs', '[3]'), ('own', '4'), ('turn', '0'), ('extra', '2')]
    assert run(bench, rounds, *words, *more) == ["[3, True, {'home': 1}, 7, 8, 'Hi', 2.0, [3]]"]


@pytest.mark.parametrize(
    ('name', 'text', 'words'),
    [
        ('lefd', '1', "its code has no parameter 'lefd'; did you mean 'left'?"),
        ('left', 'many', "parameter 'left': 'many' is not a value of type int"),
        ('legs', '{a: 1}', "parameter 'legs': '{a: 1}' is not a value of type list: it is a dict; write [1, 2]"),
        ('places', '{a', "parameter 'places': '{a' is not a value of type dict: line 1: no YAML"),
        ('turn', 'left', "parameter 'turn': 'left' is not a value of type float"),
        ('create', 'x', "no parameter 'create'"),
        ('contains', 'x', "no parameter 'contains'"),
        ('_state_machine', 'x', "no parameter '_state_machine'"),
    ],
)
def test_what_is_no_parameter_of_the_code_is_refused(
    rounds: BehaviorEntry, bench: StateBench, name: str, text: str, words: str
) -> None:
    going = bench.run_behavior(rounds, (name, text))
    wait_until(lambda: going.refusal, 'refused')
    assert words in str(going.refusal)

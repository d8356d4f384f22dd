# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors in YAML, installed by real distributions with real entry points, found, refused and run."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from flexbt_core.state_machine.model.definition import MachineDefinition
from flexbt_core.state_machine.model.userdata import MachineError
from flexbt_onboard.behaviors.behavior import OperatorGone
from flexbt_onboard.behaviors.behavior_library import BehaviorLibrary, machine_entry
from flexbt_onboard.behaviors.machine_store import MachineStore
from flexbt_onboard.behaviors.run_building import definition_of
from flexbt_testing.nodes.state_bench import StateBench

HEAD = """
behavior:
  name: Count
  description: 7
  author: off
  parameters:
    most: {default: 3, description: how far, label: Most, unit: m, minimum: 1, maximum: 9}
    step: {default: one, choices: [one, two]}
    l: {default: [1, {a: b}]}
  inputs:
    start: {type: int, description: where to begin, needed: true}
  operator_gone: hold
  operator_gone_after: 2
"""
COUNT = (
    HEAD
    + """
machine:
  outcomes: [end, failed]
  input_keys: [start]
  output_keys: [start]
  states:
    Add:
      state: AddState
      parameters: {most: $most, step: $step}
      timeout: {after: 60, outcome: failed}
      transitions: {more: Add, enough: end, failed: failed}
      remapping: {value: start}
"""
)
TWICE = """# Count in another behavior.
behavior: {name: Twice, parameters: {far: {default: 5}}}
machine:
  outcomes: [end]
  userdata: {n: 0}
  output_keys: [n]
  states:
    In:
      behavior: {use: Count, parameters: {most: $far, step: two}}
      transitions: {end: end, failed: end}
      remapping: {start: n}
"""
STATES = """
from enum import Enum
from flexbt_core import EventState

class Step(Enum):
    one = 1
    two = 2

class AddState(EventState):
    def __init__(self, most: int, step: Step):
        super().__init__(['more', 'enough'], io_keys=['value'])
        self.most, self.step = most, step

    def execute(self, userdata):
        userdata.value += self.step.value
        return 'more' if userdata.value < self.most else 'enough'
"""

Install = Callable[..., Path]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Installs a distribution with files, and with entry points of behaviors (file) and states (module)."""
    before = set(sys.modules)

    def install_distribution(package: str, files: dict[str, str], states: bool = True) -> Path:
        site = tmp_path / package
        info = site / f'{package}-1.0.dist-info'
        info.mkdir(parents=True)
        (site / package).mkdir()
        (info / 'METADATA').write_text(f'Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n')
        for name, text in {'__init__.py': '', **files}.items():
            (site / package / name).write_text(text)
        named = [f'{Path(name).stem} = {package}:{name}' for name in files if name.endswith('.yaml')]
        lines = ['[flexbt.behaviors]', *named, '[flexbt.states]', *([f's = {package}.states'] if states else [])]
        (info / 'entry_points.txt').write_text('\n'.join(lines) + '\n')
        monkeypatch.syspath_prepend(str(site))
        return site / package

    yield install_distribution
    for name in set(sys.modules) - before:
        del sys.modules[name]


def test_a_file_is_a_behavior_like_any_other(install: Install) -> None:
    install('counts', {'count.yaml': COUNT, 'states.py': STATES})
    entry = BehaviorLibrary.discover().find('Count')
    message = entry.to_message()
    assert (message.name, message.package, message.description, message.author) == ('Count', 'counts', '7', 'off')
    assert (message.error, message.machine) == ('', '')
    assert [(p.name, p.type, p.default_value, list(p.choices), p.unit, p.minimum) for p in message.parameters] == [
        ('most', 'int', '3', [], 'm', '1'),
        ('step', 'string', 'one', ['one', 'two'], '', ''),
        ('l', 'list', '[1, {a: b}]', [], '', ''),
    ]
    assert [(one.key, one.type, one.needed) for one in message.inputs] == [('start', 'int', True)]
    behavior = entry.instantiate()
    assert (behavior.operator_gone, behavior.operator_gone_after) == (OperatorGone.HOLD, 2)
    assert 'counts.states' not in sys.modules, 'listing behaviors does not import states'
    assert definition_of(behavior).input_keys == ('start',)


def test_a_changed_file_counts_from_the_next_start_or_switch(install: Install) -> None:
    file = install('counts', {'count.yaml': COUNT, 'states.py': STATES}) / 'count.yaml'
    entry = BehaviorLibrary.discover().find('Count')
    file.write_text(COUNT.replace('[end, failed]', '[end, failed, given_up]'))
    assert definition_of(entry.instantiate()).outcomes == ('end', 'failed', 'given_up')
    file.write_text(COUNT.replace('AddState', 'AdState'))
    with pytest.raises(MachineError, match=r"count\.yaml:21:14: /Add: there is no state 'AdState'"):
        definition_of(entry.instantiate())
    file.unlink()
    with pytest.raises(FileNotFoundError):
        entry.instantiate()


def test_a_file_is_run_with_its_parameters_and_embedded(install: Install) -> None:
    install('counts', {'count.yaml': COUNT, 'twice.yaml': TWICE, 'states.py': STATES})
    library = BehaviorLibrary.discover()
    assert library.find('Twice').manifest.description == 'Count in another behavior.'
    with StateBench() as bench:
        run = bench.run_behavior(library.find('Twice'), ('far', '7'))
        assert run.wait() == 'end', run.message
        assert run.outputs == {'n': 8}
        again = bench.run_behavior(library.find('Twice'))
        assert again.wait() == 'end', again.message
        assert again.outputs == {'n': 6}


@pytest.mark.parametrize(
    ('wrong', 'right', 'problem'),
    [
        ('nme: Count', 'name: Count', "count.yaml:3:3: behavior cannot have 'nme'; did you mean 'name'?"),
        ('name: a/b', 'name: Count', 'count.yaml:3:9: behavior \'a/b\': the name must not be empty or contain "/"'),
        ('default: null', 'default: 3', "count.yaml:7:5: parameter 'most': the default None is a NoneType"),
        ('defalt: 3', 'default: 3', 'count.yaml:7:5: parameter most has no default; it determines the type'),
        ('default: 1e3', 'default: 3', 'count.yaml:7:21: default of parameter most: versions of YAML read'),
        ('default: $step', 'default: 3', "count.yaml:7:21: default of parameter most: there is no parameter 'step'"),
        ('minimum: low', 'minimum: 1', 'count.yaml:7:77: minimum of parameter most has to be a number'),
        ('choices: one', 'choices: [one, two]', 'count.yaml:8:35: choices of parameter step has to be a list'),
        ('choices: [1]', 'choices: [one, two]', "count.yaml:8:5: parameter 'step': the choice 1 is not a string"),
        ('create:', 'most:', "count.yaml:3:9: behavior 'Count': a parameter cannot have the name 'create'"),
        ('class:', 'most:', "count.yaml:7:5: parameter 'class': the name must be a Python identifier"),
        ('needed: 1', 'needed: true', 'count.yaml:11:61: needed of input start has to be true or false'),
        ('type: [int]', 'type: int', 'count.yaml:11:19: type of input start has to be a text, not a list'),
        ('operator_gone: hld', 'operator_gone: hold', "12:18: operator_gone is none of continue, hold, stop: 'hld'"),
        ('gone_after: 0', 'gone_after: 2', 'count.yaml:13:24: operator_gone_after has to be a number of seconds'),
        ('gone_after: .inf', 'gone_after: 2', 'count.yaml:13:24: operator_gone_after has to be a number of'),
        ('behavior: [x]', HEAD[1:], 'count.yaml:2:11: behavior has to be a mapping, not a list'),
        ('{', 'behavior:', 'no YAML: '),
        ('', COUNT, 'count.yaml:1:1: the text is empty'),
    ],
)  # fmt: skip
def test_a_head_with_problems_is_listed_with_them(install: Install, wrong: str, right: str, problem: str) -> None:
    text = COUNT.replace(right, wrong, 1)
    assert text != COUNT
    install('counts', {'count.yaml': text, 'twice.yaml': TWICE, 'states.py': STATES})
    library = BehaviorLibrary.discover()
    entry = library.find('count')
    assert entry.make is None and problem in entry.error, entry.error
    assert library.find('Twice').error == '', 'others are not concerned'


def test_a_file_that_is_not_installed_is_told(install: Install) -> None:
    folder = install('counts', {'count.yaml': COUNT, 'states.py': STATES})
    (folder / 'count.yaml').unlink()
    assert 'counts has no file count.yaml; name it in package_data' in BehaviorLibrary.discover().find('count').error


def test_states_of_one_name_need_their_package(install: Install) -> None:
    install('counts', {'count.yaml': COUNT, 'states.py': STATES})
    install('others', {'states.py': STATES})
    install(
        'third', {'states.py': 'from counts.states import AddState\nfrom counts.states import AddState as SameState'}
    )
    entry = BehaviorLibrary.discover().find('Count')
    with pytest.raises(
        MachineError, match="several packages have a state 'AddState'; write counts/AddState or others/Add"
    ):
        entry.instantiate().create()
    for name in ('counts/AddState', 'others/AddState', 'third/AddState', 'SameState'):
        made = machine_entry('x', COUNT.replace('state: AddState', f'state: {name}'), 'x').instantiate()
        state = definition_of(made).children['Add']
        assert not isinstance(state, MachineDefinition) and state.state.unwrapped.type_name == 'AddState'


def test_a_broken_package_of_states_is_told_only_to_those_who_need_it(install: Install) -> None:
    install('counts', {'count.yaml': COUNT, 'states.py': STATES})
    install('broken', {'states.py': 'import nothing_of_this_name'})
    assert definition_of(BehaviorLibrary.discover().find('Count').instantiate()).children
    needing = machine_entry('x', COUNT.replace('AddState', 'BrokenState'), 'x').instantiate()
    with pytest.raises(MachineError) as caught:
        needing.create()
    assert "there is no state 'BrokenState'" in caught.value.problems[0]
    assert 'nothing_of_this_name' in caught.value.problems[1]
    assert len(caught.value.records) == 2


@pytest.mark.parametrize('inner', ['Loop', 'Twice'])
def test_a_behavior_that_embeds_itself_is_refused(install: Install, inner: str) -> None:
    loop = TWICE.replace('Twice', 'Loop').replace('use: Count, parameters: {most: $far, step: two}', f'use: {inner}')
    twice = TWICE.replace('use: Count, parameters: {most: $far, step: two}', 'use: Loop')
    install('counts', {'loop.yaml': loop, 'twice.yaml': twice, 'states.py': STATES})
    behavior = BehaviorLibrary.discover().find('Loop').instantiate()
    for _ in range(2):
        with pytest.raises(MachineError, match="'Loop' embeds itself: Loop in "):
            behavior.create()


def test_a_stored_machine_may_have_a_head_and_keeps_the_name_of_its_file(tmp_path: Path) -> None:
    (tmp_path / 'mine.yaml').write_text(COUNT)
    (tmp_path / 'bad.yaml').write_text(COUNT.replace('name:', 'nam:'))
    (entry,), (problem,) = MachineStore(tmp_path).entries()
    assert (entry.name, entry.machine, [one.name for one in entry.parameters]) == ('mine', COUNT, ['most', 'step', 'l'])
    assert "bad.yaml is not a synthesized behavior: bad:3:3: behavior cannot have 'nam'" in problem

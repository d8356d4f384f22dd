# SPDX-License-Identifier: BSD-3-Clause
"""``behavior_tool synthesize``: what it prints, writes and returns."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from rosidl_adapter.parser import parse_message_string

import flexbt_states
from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.authoring.yaml_form import read_machine
from flexbt_formal.requests.synthesis import StateInterfaces, SynthesisFiles, flexbe_messages, read_problem
from flexbt_formal.synthesis.request_files import MachineRequest
from flexbt_formal.synthesis.synthesis import synthesize
from flexbt_formal.synthesis.translation import Options
from flexbt_testing.behavior_trees.bt_tool import behavior_tool as tool

COFFEE = """\
state_outcome_mappings: {grind: completed, brew: completed, fail: failure}
sm_outcome_mappings: {finished: finished}
capabilities:
  grind:
    interface: OperatorDecisionState
    parameters: {outcomes: [grind, fail]}
    postconditions: [grind]
    autonomy: {grind: 2, fail: 3}
  brew:
    interface: OperatorDecisionState
    parameters: {outcomes: [brew, fail]}
    preconditions: [grind]
    postconditions: [brew]
"""
STATES = {'OperatorDecisionState': flexbt_states.OperatorDecisionState}


@pytest.fixture
def coffee(tmp_path: Path) -> str:
    file = tmp_path / 'coffee.yaml'
    file.write_text(COFFEE, encoding='utf-8')
    return str(file)


def test_the_machine_is_printed_so_that_the_executive_reads_it(coffee: str) -> None:
    done = tool('synthesize', coffee, '--goal', 'brew')
    assert (done.code, done.err) == (0, '')
    structure = read_machine(done.out, STATES).structure()
    assert [(one.path, one.targets) for one in structure[1:]] == [
        ('/grind', ('/brew', '/grind')),
        ('/brew', ('=finished', '/brew')),
    ]
    assert structure[1].autonomy == (2, 3)


@pytest.mark.parametrize(
    ('file', 'name'),
    [
        ('coffee', 'Coffee'),
        ('operator_decision_state', 'MachineOperatorDecisionState'),  # the class of the states
        ('none', 'MachineNone'),  # a word of Python
    ],
)
def test_as_python_it_is_the_same_behavior(coffee: str, tmp_path: Path, file: str, name: str) -> None:
    named = Path(coffee).rename(tmp_path / f'{file}.yaml')
    words = ('synthesize', str(named), '--goal', 'brew', '--retries', '2')
    python = tmp_path / 'made.py'
    assert tool(*words, '--form', 'python', '-o', str(python)).code == 0
    made: dict[str, type] = {}
    exec(python.read_text(encoding='utf-8'), made)  # noqa: S102
    assert define(made[name]().create()).structure() == read_machine(tool(*words).out, STATES).structure()


def test_for_programs_everything_is_in_one_document(coffee: str, tmp_path: Path) -> None:
    certificate = tmp_path / 'certificate.json'
    done = tool('synthesize', coffee, '--goal', 'brew', '--json', '--certificate', str(certificate))
    answer = json.loads(done.out)
    assert answer['realizable']
    assert answer['figures']['nodes'] == len(json.loads(certificate.read_text(encoding='utf-8'))['nodes'])
    refused = tool('synthesize', coffee, '--goal', 'brew & !grind', '--json')
    assert refused.code == 1
    assert json.loads(refused.out)['explanation']['conflict'] == [
        f"postcondition 'grind' of grind after completed ({coffee}:7)",
        f"precondition 'grind' of brew ({coffee}:12)",
        "goal 'brew & !grind' (request)",
    ]


def test_why_there_is_none_is_told_in_the_words_of_the_files(
    coffee: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ends = tmp_path / 'ends.yaml'
    ends.write_text('specs: {SYS_TRANS: ["brew_f\' -> finished\'"]}', encoding='utf-8')
    answers = iter(['1', 'x', '1', '1', 'q'])
    monkeypatch.setattr('builtins.input', lambda prompt: next(answers))
    done = tool('synthesize', coffee, '--goal', 'brew', '--liveness', 'fair-outcomes', '--spec', str(ends), '--step')
    assert done.code == 1
    assert done.out.startswith('No machine can do that: ')
    assert f"  - SYS_TRANS 'brew_f' -> finished'' ({ends}:1)" in done.out
    assert 'You are the machine' in done.out


@pytest.mark.parametrize(
    ('words', 'code', 'text'),
    [
        (('--goal', 'brewn'), 3, "request: goal 'brewn': there is no variable 'brewn'; did you mean 'brew'?"),
        (('--goal', 'brew', '--mappings', '/nowhere'), 2, '/nowhere: cannot be read: No such file'),
        (
            ('--goal', 'brew', '--states', 'nowhere'),
            2,
            "module 'nowhere' cannot be had: ModuleNotFoundError",
        ),
        (('--goal', 'brew', '--retries', '-1'), 2, '--retries -1: write a number from 0 to 1000'),
        (('--goal', 'brew', '--time-limit', 'nan'), 2, "argument --time-limit: 'nan' is not a number above 0"),
        (('--goal', 'brew', '--time-limit', '1e-9'), 5, 'no answer within 1e-09 s'),
        (('--goal', 'brew', '-o', '/nowhere/x'), 2, '/nowhere/x: cannot be written: No such file'),
    ],
)
def test_what_is_wrong_is_told_with_the_exit_code_for_it(coffee: str, words: list[str], code: int, text: str) -> None:
    done = tool('synthesize', coffee, *words)
    assert (done.code, text in done.err) == (code, True), done.err


def test_the_progress_on_a_terminal_is_removed_before_the_answer(coffee: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(io, 'StringIO', type('Terminal', (io.StringIO,), {'isatty': lambda self: True}))
    assert tool('synthesize', coffee, '--goal', 'brew', '--time-limit', '1e-9').err.startswith('\r\x1b[Kno answer')


def test_a_parameter_that_a_state_does_not_take_is_told_with_the_line_it_comes_from(coffee: str) -> None:
    file = Path(coffee)
    file.write_text(f'{COFFEE}    deadline: 5\n'.replace('{outcomes: [grind', '{outcoms: [grind'), encoding='utf-8')
    done = tool('synthesize', coffee, '--goal', 'brew')
    assert done.code == 3
    assert done.err.splitlines() == [
        f"{coffee}:5: capability grind: OperatorDecisionState takes no parameter 'outcoms'; did you mean 'outcomes'?",
        f'{coffee}:14: deadline of capability brew: it is the parameter timeout of a state, and OperatorDecisionState '
        'takes none (hint, outcomes, shows, suggestion); leave the deadline out, or name a state that takes one',
    ]


def test_formulas_are_printed_as_slugs_reads_them_and_read_again(coffee: str, tmp_path: Path) -> None:
    """A specification that is whole needs no capabilities, and has the same machine, with states of its own."""
    printed = tool('synthesize', coffee, '--goal', 'brew', '--liveness', 'adversarial', '--specification').out
    whole = tmp_path / 'coffee.structuredslugs'
    whole.write_text(printed, encoding='utf-8')
    done = tool('synthesize', '--spec', str(whole))
    assert done.code == 0
    assert 'transitions: {completed: finished, failure: brew}' in done.out


STATE_INSTANTIATION = """\
string state_path
string CLASS_STATEMACHINE = :STATEMACHINE
string CLASS_CONCURRENCY = :CONCURRENCY
string CLASS_PRIORITY = :PRIORITY
string CLASS_BEHAVIOR = :BEHAVIOR
string state_class
string initial_state_name
string[] input_keys
string[] output_keys
string[] cond_outcome
OutcomeCondition[] cond_transition
string behavior_class
string[] parameter_names
string[] parameter_values
float32[2] position
string[] outcomes
string[] transitions
int8[] autonomy
string[] userdata_keys
string[] userdata_remapping
"""
"""That of flexbe_msgs 2.3.3."""


def test_for_flexbe_every_field_of_its_message_is_there(coffee: str) -> None:
    states = json.loads(tool('synthesize', coffee, '--goal', 'brew', '--form', 'flexbe').out)
    fields = parse_message_string('flexbe_msgs', 'StateInstantiation', STATE_INSTANTIATION).fields
    kinds = {'string': str, 'float32': float, 'int8': int, 'flexbe_msgs/OutcomeCondition': dict}
    for state in states:
        assert state.keys() == {field.name for field in fields}
        for field in fields:
            value = state[field.name]
            values = value if field.type.is_array else [value]
            assert all(type(one) is kinds[str(field.type).partition('[')[0]] for one in values), field.name
    places = [tuple(state['position']) for state in states[1:]]
    assert len(set(places)) == len(places)  # none is hidden by another in the editor


def test_for_flexbe_they_are_its_messages_where_these_are(coffee: str) -> None:
    pytest.importorskip('flexbe_msgs')
    request = MachineRequest(goals=('brew',))
    machine = synthesize(
        read_problem(
            SynthesisFiles((Path(coffee).read_text(), coffee)), request, StateInterfaces(['flexbt_states']), Options()
        )
    ).machine
    assert machine is not None
    grind = next(one for one in flexbe_messages(machine) if one.state_path == '/grind')
    assert (grind.outcomes, list(grind.autonomy), grind.parameter_names) == (['grind', 'fail'], [2, 3], ['outcomes'])


def test_a_machine_is_drawn_with_why_each_state_is_there(coffee: str, tmp_path: Path) -> None:
    machine, picture = tmp_path / 'coffee machine.yaml', tmp_path / 'coffee.mmd'
    assert tool('synthesize', coffee, '--goal', 'brew', '-o', str(machine)).code == 0
    assert tool('draw', str(machine), '-o', str(picture)).code == 0
    assert 'brew<br/>(OperatorDecisionState)<br/>nodes 3, 4<br/>holds grind' in picture.read_text(encoding='utf-8')


def test_how_the_world_prevents_a_goal_is_drawn(coffee: str, tmp_path: Path) -> None:
    picture = tmp_path / 'never.mmd'
    assert tool('synthesize', coffee, '--goal', 'brew & !grind', '--draw', str(picture)).code == 1
    head, *told = picture.read_text(encoding='utf-8').splitlines()
    assert (head, '  participant p1 as the world' in told) == ('sequenceDiagram', True)
    assert 'precondition' in told[-2] and 'No machine can do that' in told[-1]
    request = tmp_path / 'request.yaml'
    request.write_text('goals: [brew, "!grind"]', encoding='utf-8')
    picture = picture.with_suffix('.svg')
    assert tool('synthesize', coffee, '--request', str(request), '--draw', str(picture)).code == 1
    assert 'No machine can do that: brew, !grind</text>' in picture.read_text(encoding='utf-8')

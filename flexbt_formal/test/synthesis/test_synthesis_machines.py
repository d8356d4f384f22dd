# SPDX-License-Identifier: BSD-3-Clause
"""Machines that were synthesized: limits, several beginnings, userdata, and their text, run by the engine."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from typing import Any, ClassVar

import pytest
import yaml
from synthesis_support import COFFEE, coffee, interface

from flexbt_core.clock.clock import ManualClock
from flexbt_core.state_machine.authoring.yaml_form import read_machine
from flexbt_core.state_machine.engine.run import MachineRun
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import UserData
from flexbt_formal.synthesis.capabilities import read_capabilities
from flexbt_formal.synthesis.errors import SynthesisError
from flexbt_formal.synthesis.from_strategy import SynthesizedMachine
from flexbt_formal.synthesis.machine_text import machine_as_python, machine_as_yaml
from flexbt_formal.synthesis.request_files import MachineRequest
from flexbt_formal.synthesis.synthesis import synthesize
from flexbt_formal.synthesis.translation import Liveness, Options, SynthesisProblem, translated


def made(problem: SynthesisProblem) -> SynthesizedMachine:
    machine = synthesize(problem).machine
    assert machine is not None
    return machine


def edges(machine: SynthesizedMachine) -> dict[str, dict[str, str]]:
    return {name: dict(state.transitions) for name, state in machine.states.items()}


def test_autonomy_is_kept_by_outcome() -> None:
    machine = made(coffee())
    assert machine.states['grind'].autonomy == {'done': 0, 'failed': 3}
    assert machine.states['brew'].autonomy == {'done': 1, 'failed': 1}


def test_effects_may_be_by_an_outcome_of_the_state_too() -> None:
    """As in flexbe_synthesis, which looks at the first letter: ``failed`` counts as ``failure``."""
    spilled = ('failure: [grind]}', "failure: [grind], failed: ['!press']}")
    machine = made(coffee(spilled, ("failure: ['!press']", "failed: ['!press']")))
    assert edges(machine) == edges(made(coffee()))


@pytest.mark.parametrize(
    ('before', 'after', 'options'),
    [
        ('brew', 'brew_next', {}),  # next(...) is of the next step
        ('failure', 'aborted', {}),  # brew_a is that brew is active
        ('failure', 'missed', {}),  # brew_m is that brew was completed
        ('failure', 'preempted', {'pending': True}),  # brew_p is that brew has not completed yet
    ],
)
def test_names_do_not_change_what_a_machine_does(before: str, after: str, options: dict[str, Any]) -> None:
    text = COFFEE.replace(before, after)
    text += f'transition_outcomes: [completed, {"failure".replace(before, after)}]\n'
    goal = MachineRequest(goals=('brew'.replace(before, after),))
    file = read_capabilities(text, 'coffee.yaml')
    found = edges(made(translated(file, interface, goal, None, Options(**options))))
    usual = edges(made(coffee(**options)))
    assert found == {
        name.replace(before, after): {outcome: to.replace(before, after) for outcome, to in of.items()}
        for name, of in usual.items()
    }


def test_many_capabilities_are_translated_in_time() -> None:
    text = COFFEE + ''.join(f'  c{n}: {{interface: Try, postconditions: [c{n}]}}\n' for n in range(40))
    began = time.process_time()
    translated(read_capabilities(text, 'coffee.yaml'), interface, MachineRequest(goals=('brew',)))
    assert time.process_time() - began < 4.0


def test_what_the_files_call_things_stays_in_its_comment() -> None:
    name = 'home\n    other: {state: Try}\x1b[2J'
    places = f'variable_mappings: {{sys_props: {{place: {{0: {json.dumps(name)}}}}}}}\ncapabilities:'
    problem = coffee(('capabilities:', places), initial=('place=0',))
    machine = made(replace(problem, request=replace(problem.request, name=name)))
    text = machine_as_yaml(machine)
    assert list(yaml.safe_load(text)['machine']['states']) == list(machine.states)
    assert '\x1b' not in text + machine_as_python(machine, lambda state: 'states')


def test_two_classes_of_one_name_are_not_taken_for_one() -> None:
    machine = made(coffee(('interface: Try', 'interface: other/Try')))
    with pytest.raises(SynthesisError, match='Try is of my_states and of other: one module can import one'):
        machine_as_python(machine, lambda state: 'other' if '/' in state else 'my_states')
    assert 'state: other/Try\n' in machine_as_yaml(machine)


def test_a_state_is_not_called_as_an_outcome_of_its_machine() -> None:
    ends = ('{finished: finished}', '{brew: finished}')
    machine = made(coffee(ends, outcomes=('brew',)))
    assert edges(machine)['brew_2'] == {'done': 'brew', 'failed': 'brew_2'}


def test_failing_for_ever_is_success_only_where_that_was_asked_for() -> None:
    """A brew that loses what was ground, while grinding is never possible again, cannot be relied on."""
    changes = (
        ('failure: [grind]}', "failure: ['!grind', lost]}"),
        (
            "preconditions: ['!press']",
            "preconditions: ['!press', '!lost']",
        ),
        ('capabilities:', 'memory: {sys_props: {lost: false}}\ncapabilities:'),
    )
    assert synthesize(coffee(*changes)).machine is None
    assert 'finished' in made(coffee(*changes, retries=0)).outcomes


def test_with_a_limit_on_retries_the_machine_gives_up_only_where_nothing_is_left() -> None:
    machine = made(coffee(retries=2))
    assert edges(machine) == {
        'press': {'done': 'grind', 'failed': 'failed'},
        'grind': {'done': 'brew', 'failed': 'failed'},
        'brew': {'done': 'finished', 'failed': 'failed'},
    }
    assert (machine.outcomes, machine.attempts) == (('finished', 'failed'), 3)
    tea = '  tea:\n    interface: Try\n    preconditions: [press]\n    postconditions: [brew]\n'
    other = made(coffee(('capabilities:\n', f'capabilities:\n{tea}'), retries=2))
    assert {other.states[one].transitions['failed'] for one in ('tea',)} != {'failed'}


@pytest.mark.parametrize('owner', ['sys_props', 'env_props'])
def test_what_a_failure_changes_is_not_repeated_as_if_it_had_not(owner: str) -> None:
    changes = (
        ('capabilities:', f'memory: {{{owner}: {{grind: false}}}}\ncapabilities:'),
        ('failure: [grind]}', "failure: ['!grind']}"),  # a cup that was spilled cannot be brewed again
        ("preconditions: ['!press']", "preconditions: ['!press', '!grind']"),
    )
    machine = made(coffee(*changes, retries=2))
    parts = {name: state.parts[0].retry_on for name, state in machine.states.items()}
    assert parts['brew'] == () and parts['press'] == parts['grind'] == ('failed',)
    assert 'brew is not repeated after failed, which changes what is known' in machine.notes


def test_the_same_outcome_has_the_same_answer_where_that_is_as_near() -> None:
    """What is possible only later on (wash) is no better after a failure than what helped the first time (dust)."""
    others = '  dust: {interface: Try, postconditions: [dust]}\n  wash: {interface: Try, preconditions: [dust]}\n'
    machine = made(
        coffee(
            ("['!press']\n", "['!press']\n    transition_relation: {failure: [dust, wash]}\n"),
            ('capabilities:\n', f'capabilities:\n{others}'),
        )
    )
    assert edges(machine)['press'] == {'done': 'grind', 'failed': 'dust'}
    assert sorted(machine.states) == ['brew', 'dust', 'grind', 'press']


class Try(EventState):
    """Fails as often as ``failures`` says for its place in the machine."""

    failures: ClassVar[dict[str, int]] = {}

    def __init__(self) -> None:
        super().__init__(['done', 'failed'], desired_rate=None)

    def on_enter(self, userdata: UserData) -> None:
        self.wake()

    def execute(self, userdata: UserData) -> str:
        left = self.failures.get(self.path, 0)
        self.failures[self.path] = left - 1
        return 'failed' if left > 0 else 'done'


@pytest.mark.parametrize(('failures', 'outcome'), [(2, 'finished'), (3, 'failed')])
def test_the_machine_runs_as_the_strategy_has_it(failures: int, outcome: str) -> None:
    """Its YAML on the engine: grinding fails some times, and may fail twice."""
    Try.failures = {'/grind': failures}
    machine = made(coffee(('failed: 3', 'failed: 0'), retries=2))
    definition = read_machine(machine_as_yaml(machine), {'Try': Try})
    run = MachineRun(definition, ManualClock(), autonomy=Autonomy.Full)
    run.start()
    for _ in range(100):
        if not run.step():
            break
    assert run.outcome == outcome


@pytest.mark.parametrize(('heat', 'state'), [('heat', 'heat'), ('start', 'start_2')])
def test_the_world_that_may_begin_in_several_ways_is_asked_about(heat: str, state: str) -> None:
    changes = (
        ('capabilities:', 'memory: {env_props: {warm: false}}\ncapabilities:'),
        ("preconditions: ['!press']", "preconditions: ['!press', warm]"),
        (
            '  brew:',
            f"  {heat}:\n    interface: Try\n    preconditions: ['!warm']\n    postconditions: [warm]\n  brew:",
        ),
    )
    machine = made(coffee(*changes, initial=('warm_m | !warm_m',)))
    assert machine.initial == 'start'
    assert edges(machine)['start'] == {'warm_m': 'press', 'not_warm_m': state}
    assert any('the operator' in note for note in machine.notes)


def test_the_operator_is_asked_for_a_value_by_its_name() -> None:
    """Ask nothing about numbers that are no values, and do nothing with them."""
    changes = (
        ('capabilities:', 'variable_mappings: {env_props: {water: {1: cold, 3: warm}}}\ncapabilities:'),
        ("preconditions: ['!press']", "preconditions: ['!press', water=warm]"),
        (
            '  brew:',
            '  heat:\n    interface: Try\n    preconditions: [water=cold]\n    postconditions: [water=warm]\n  brew:',
        ),
    )
    assert edges(made(coffee(*changes)))['start'] == {'water=cold': 'heat', 'water=warm': 'press'}
    with pytest.raises(SynthesisError, match='water has two values of one name'):
        coffee((changes[0][0], changes[0][1].replace('warm', 'cold')))


def test_userdata_that_is_not_written_on_every_way_is_refused_with_the_way() -> None:
    read = ("preconditions: ['!press']", "preconditions: ['!press']\n    userdata_in: {beans: {remapping: ground}}")
    later = ('preconditions: [grind]', 'preconditions: [grind]\n    userdata_in: {beans: {remapping: ground}}')
    written = ('autonomy: {done: 0', 'userdata_out: {out: {remapping: ground}}\n    autonomy: {done: 0')
    assert made(coffee(later, written)).keys == ()
    assert made(coffee(read)).keys == ('ground',)
    with pytest.raises(SynthesisError, match="press reads userdata 'ground', which is not written on the way press"):
        synthesize(coffee(read, written))


@pytest.mark.parametrize(
    ('before', 'after', 'problem'),
    [
        ('done: completed, ', '', "coffee.yaml:6: capability press: its outcome 'done' counts as nothing; add"),
        ('failed: failure', 'failed: failur', "is mapped to 'failur', which is none of transition_outcomes"),
        ('interface: Try', 'interfac: Try', "coffee.yaml:6: capability press cannot have 'interfac'; did you mean"),
        (
            "['!press']",
            '[pres]',
            "coffee.yaml:7: precondition 'pres' of press: there is no variable 'pres'; did you mean",
        ),
        ("['!press']", "['press &']", 'coffee.yaml:7'),
        ('[press, ', '[press | brew, ', "coffee.yaml:8: postcondition 'press | brew' of press: write NAME"),
        (
            'failure: [press]',
            'failur: [press]',
            'postconditions of capability grind cannot have',
        ),
        ('failed: 3', 'failed: high', "is 'high'; the levels are 0 (off), 1 (low), 2 (high), 3 (full)"),
        ("['!press']", '!press', "coffee.yaml:7: what begins with ! is a tag in YAML; put it in quotes: '!press'"),
        ("['!press']", '[!press]', "coffee.yaml:7: what begins with ! is a tag in YAML; put it in quotes: '!press'"),
        ('  grind:', '\tgrind:', "'\\t' that cannot start any token; indent by blanks"),
        ('failed: 3', 'faild: 3', "autonomy for 'faild'; did you mean 'failed'?"),
        ('name: coffee', 'nam: coffee', "coffee.yaml:1: a capability file cannot have 'nam'; did you mean 'name'?"),
        ('capabilities:', 'capabilitys:', 'coffee.yaml:1: there are no capabilities'),
        ('  press:\n', '  pr-ess:\n', "'pr-ess' is not a name"),
        ('  press:\n', '  next:\n', "coffee.yaml:6: 'next' is a word of formulas already: call it otherwise"),
        ('  press:\n', '  finished:\n', "coffee.yaml:6: 'finished' is an outcome already: call it otherwise"),
        ('  press:\n', '  brew_m:\n', "coffee.yaml:6: 'brew_m' is the memory of brew already: call it otherwise"),
        ('  press:\n', '  brew_a:\n', "coffee.yaml:6: 'brew_a' is a proposition of brew already: call it otherwise"),
        ('capabilities:', f'memory: {{sys_props: {{x: {"9" * 30}}}}}\ncapabilitie:', "cannot have 'capabilitie'"),
        ('capabilities:', 'variable_mappings: {sys_props: {n: {99999999999: a}}}\ncapabilities:', 'at most 9 digits'),
        ('capabilities:', 'variable_mappings: {sys_props: {n: {-1: a}}}\ncapabilities:', 'an integer from 0'),
        ('capabilities:', 'variable_mappings: {sys_props: {n: {1: a, 01: b}}}\ncapabilities:', 'an integer from 0'),
        ('capabilities:', 'memory: {env_props: {x: true}, sys_props: {x: true}}\ncapabilities:', 'of the other owner'),
    ],
)
def test_what_is_wrong_in_a_file_is_named_with_its_place(before: str, after: str, problem: str) -> None:
    with pytest.raises(SynthesisError) as caught:
        coffee((before, after))
    assert any(problem in one for one in caught.value.problems), caught.value.problems


def test_a_value_that_a_variable_does_not_have_is_named_with_those_that_it_has() -> None:
    sizes = ('capabilities:', 'variable_mappings: {sys_props: {size: {0: small, 1: large}}}\ncapabilities:')
    with pytest.raises(SynthesisError, match="'size' has no value 'smal'; did you mean 'small'"):
        synthesize(coffee(sizes, ("['!press']", '[size=smal]')))
    for needs in ('size<large', 'size <= small', 'size != large'):
        assert made(coffee(sizes, ("['!press']", f"['!press', '{needs}']"))).initial == 'press'
    with pytest.raises(SynthesisError, match="a variable is missing after '&'"):
        synthesize(coffee(("['!press']", "['!press &']")))


def test_a_beginning_that_the_request_leaves_open_is_told() -> None:
    sizes = ('capabilities:', 'variable_mappings: {sys_props: {size: {0: small, 1: large}}}\ncapabilities:')
    needs = ("['!press']", "['!press', size=large]")
    told = "the initial conditions leave 'size' open, so size=large is taken; say which it is"
    assert told in made(coffee(sizes, needs)).notes
    assert not any('size' in note for note in made(coffee(sizes, needs, initial=('size=large',))).notes)


def test_a_machine_that_never_ends_is_not_written() -> None:
    """Failing is no end where it is not needed."""
    with pytest.raises(SynthesisError, match='never ends, and no engine takes it'):
        machine_as_yaml(made(coffee(outcomes=('failed',))))
    alike = ('{finished: finished}', '{finished: done, ready: done}')
    with pytest.raises(SynthesisError, match='the outcomes finished, ready have one proposition'):
        coffee(alike, outcomes=('finished', 'ready'))


def test_a_request_for_nothing_is_refused_and_long_ones_are_shortened() -> None:
    with pytest.raises(SynthesisError, match='nothing is asked for'):
        coffee(goals=())
    with pytest.raises(SynthesisError) as caught:
        coffee(goals=('brew & ' * 100_000 + 'brew',))
    assert len(str(caught.value)) < 500


def test_what_follows_an_outcome_can_be_required_and_excluded() -> None:
    """Tea beside coffee: after grinding either, as the relation has it."""
    tea = (
        'capabilities:\n',
        'capabilities:\n  tea: {interface: Try, preconditions: [grind], postconditions: [brew]}\n',
    )
    for relation, followed in (("['!tea']", 'brew'), ("['!brew']", 'tea'), ('[brew, press]', 'brew'), ('[tea]', 'tea')):
        added = ('preconditions: [press]', f'preconditions: [press]\n    transition_relation: {relation}')
        assert edges(made(coffee(tea, added)))['grind']['done'] == followed


def test_liveness_of_upstream_accepts_what_ours_does_not() -> None:
    """Failing again and again counts as success there."""
    never = ('failure: [grind]}', "failure: ['!grind']}")
    assert synthesize(coffee(never, liveness=Liveness.ADVERSARIAL)).machine is not None
    assert synthesize(coffee(never, liveness=Liveness.FAIR_OUTCOMES)).machine is None


def test_a_relation_says_what_must_not_follow() -> None:
    change = ('failure: [press]}\n', "failure: [press]}\n    transition_relation: {completed: ['!press']}\n")
    origins = [line.origin for line in coffee(change).specification.lines if 'relation' in (line.origin or '')]
    assert origins == ["transition_relation '!press' of grind after completed (coffee.yaml:13)"]


@pytest.mark.parametrize('parsed', [False, True])
def test_at_the_end_nothing_is_active(parsed: bool) -> None:
    """Nothing has to be possible any more then, and what is required to follow does not."""
    once = ("preconditions: ['!press']", "preconditions: ['!press', '!brew']")
    assert 'finished' in made(coffee(once, parsed=parsed)).outcomes
    follows = ('[grind]}\n', '[grind]}\n    transition_relation: [press]\n')
    assert synthesize(coffee(follows, parsed=parsed)).machine is None

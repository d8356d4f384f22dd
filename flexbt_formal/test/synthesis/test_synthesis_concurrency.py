# SPDX-License-Identifier: BSD-3-Clause
"""Capabilities that are active at once: where that shortens, and never two that need the same."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_core.state_machine.authoring.yaml_form import read_machine
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_formal.synthesis.capabilities import StateInterface, read_capabilities
from flexbt_formal.synthesis.errors import SynthesisError
from flexbt_formal.synthesis.machine_text import machine_as_yaml
from flexbt_formal.synthesis.request_files import MachineRequest
from flexbt_formal.synthesis.synthesis import Synthesis, synthesize
from flexbt_formal.synthesis.translation import Options, translated


def capability(**entries: Any) -> dict[str, Any]:
    return {'interface': 'Try', **entries}


TEA = {
    'boil': capability(resources=['stove'], postconditions=['boil']),
    'fetch': capability(resources=['base', 'arm'], postconditions=['fetch']),
    'pour': capability(resources=['arm'], preconditions=['boil', 'fetch'], postconditions=['pour']),
}
SURE = {name: {**one, 'interface': 'Sure'} for name, one in TEA.items()}
SURE['boil']['postconditions'] = ['boil', 'warm']
KEYS = {
    'Try': StateInterface(('done', 'failed')),
    'Sure': StateInterface(('done',)),
    'Look': StateInterface(('done',), (), ('cup',)),
    'Wash': StateInterface(('done',), ('cup',), ('cup',)),
}


def answer(capabilities: Mapping[str, Any], goal: str, **options: Any) -> Synthesis:
    text = yaml.safe_dump(
        {
            'state_outcome_mappings': {'done': 'completed', 'failed': 'failure'},
            'sm_outcome_mappings': {'finished': 'finished'},
            'memory': {'sys_props': {'warm': False}},
            'capabilities': dict(capabilities),
        }
    )
    file = read_capabilities(text, 'tea.yaml')
    return synthesize(
        translated(file, lambda name, _: KEYS[name], MachineRequest(goals=(goal,)), None, Options(**options))
    )


def states(capabilities: Mapping[str, Any], goal: str, **options: Any) -> list[tuple[str, ...]]:
    """Return the capabilities of each state of the machine."""
    machine = answer(capabilities, goal, **options).machine
    assert machine is not None
    return sorted(tuple(part.capability for part in state.parts) for state in machine.states.values())


def changed(name: str, **entries: Any) -> dict[str, Any]:
    return {**TEA, name: {**TEA[name], **entries}}


class Try(EventState):
    def __init__(self) -> None:
        super().__init__(outcomes=['done', 'failed'])


def test_what_needs_other_resources_is_done_at_once_where_that_shortens() -> None:
    machine = answer(TEA, 'pour').machine
    assert machine is not None
    assert states(TEA, 'pour') == [('boil',), ('boil', 'fetch'), ('fetch',), ('pour',)]
    first = machine.states[machine.initial]
    assert first.transitions == {
        'boil_failed__fetch_failed': first.name,
        'boil_failed__fetch_done': 'boil',
        'boil_done__fetch_failed': 'fetch',
        'boil_done__fetch_done': 'pour',
    }
    read_machine(machine_as_yaml(machine), {'Try': Try})  # the engine takes it
    assert states(TEA, 'boil') == [('boil',)]  # nothing is done without need


@pytest.mark.parametrize(
    'capabilities',
    [
        changed('fetch', resources=['stove']),
        {**TEA, 'fetch': capability(postconditions=['fetch'])},
        {**SURE, 'fetch': {**SURE['fetch'], 'preconditions': ['!boil']}},
        {**SURE, 'fetch': {**SURE['fetch'], 'postconditions': ['fetch', 'warm']}},
    ],
    ids=['the same resource', 'resources not known', 'it reads what the other one changes', 'both change it'],
)
def test_what_would_disturb_each_other_is_done_one_after_the_other(capabilities: dict[str, Any]) -> None:
    assert states(capabilities, 'pour') == [('boil',), ('fetch',), ('pour',)]
    assert states(SURE, 'pour') == [('boil', 'fetch'), ('pour',)]


def test_what_a_failure_changes_is_not_repeated_beside_others() -> None:
    spilled = capability(
        resources=['stove'], preconditions=['!warm'], postconditions={'completed': ['boil'], 'failure': ['warm']}
    )
    machine = answer({**TEA, 'boil': spilled}, 'pour', retries=2).machine
    assert machine is not None
    assert {part.capability: part.retry_on for part in machine.states[machine.initial].parts} == {
        'boil': (),
        'fetch': ('failed',),
    }


def test_that_one_completes_at_some_time_is_no_promise_that_the_other_one_fails_then() -> None:
    """To be cold again after boiling needs a failure, which nobody promises."""
    boil = capability(resources=[], postconditions={'completed': ['boil', 'warm'], 'failure': ['!warm']})
    for others in ({}, {'fetch': capability(resources=['base'], postconditions=['fetch'])}):
        assert answer({'boil': boil, **others}, 'boil & !warm').machine is None


def test_who_write_the_same_userdata_wait_for_each_other() -> None:
    capabilities = {
        'look': capability(interface='Look', resources=['camera'], postconditions=['look']),
        'feel': capability(interface='Look', resources=['arm'], postconditions=['feel']),
    }
    assert states(capabilities, 'look & feel') == [('feel',), ('look',)]
    capabilities['feel']['userdata_out'] = {'cup': {'remapping': 'weight'}}
    assert states(capabilities, 'look & feel') == [('feel', 'look')]


def test_what_a_state_reads_and_writes_has_one_name() -> None:
    capabilities = {'wash': capability(interface='Wash', postconditions=['wash'])}
    capabilities['wash']['userdata_out'] = {'cup': {'remapping': 'washed'}}
    with pytest.raises(SynthesisError, match="userdata 'cup' is read as 'cup' and written as 'washed'"):
        answer(capabilities, 'wash')
    capabilities['wash']['userdata_in'] = {'cup': {'remapping': 'washed'}}
    machine = answer(capabilities, 'wash').machine
    assert machine is not None
    assert machine.states['wash'].parts[0].remapping == {'cup': 'washed'}
    assert machine.keys == ('washed',)  # it has to be there before the only one that writes it


def test_a_deadline_is_the_timeout_of_the_state() -> None:
    machine = answer({'boil': capability(deadline=20, postconditions=['boil'])}, 'boil').machine
    assert machine is not None
    assert machine.states['boil'].parts[0].parameters == {'timeout': 20.0}


@pytest.mark.parametrize(
    ('entries', 'problem'),
    [
        ({'deadline': 'soon'}, "deadline of capability boil has to be a number of seconds above 0, not 'soon'"),
        ({'deadline': True}, 'has to be a number of seconds above 0, not True'),
        ({'deadline': 1.0, 'parameters': {'timeout': 2.0}}, 'has a deadline and the parameter timeout'),
        ({'resources': ['two words']}, "resources of capability boil: 'two words' is not a name"),
    ],
)
def test_what_is_wrong_with_them_is_told_with_its_line(entries: dict[str, Any], problem: str) -> None:
    with pytest.raises(SynthesisError) as error:
        answer({'boil': capability(**entries)}, 'boil')
    assert problem in str(error.value) and str(error.value).startswith('tea.yaml:')


NAMES = ('a', 'b', 'c')
RESOURCES = st.none() | st.lists(st.sampled_from(['x', 'y']), unique=True)
ENTRIES = st.fixed_dictionaries({'resources': RESOURCES, 'preconditions': st.lists(st.sampled_from(NAMES), max_size=1)})


@settings(max_examples=40)
@given(st.fixed_dictionaries(dict.fromkeys(NAMES, ENTRIES)))
def test_in_no_node_of_a_strategy_are_two_active_that_need_the_same(chosen: dict[str, dict[str, Any]]) -> None:
    capabilities = {
        name: capability(postconditions=[name], **{key: value for key, value in entries.items() if value is not None})
        for name, entries in chosen.items()
    }
    found = answer(capabilities, 'a & b & c')
    for node in found.strategy.nodes if found.strategy is not None else ():
        for one, other in combinations([name for name in NAMES if node.values[f'{name}_a']], 2):
            of_one, of_other = chosen[one]['resources'], chosen[other]['resources']
            assert of_one is not None and of_other is not None and not set(of_one) & set(of_other)
            assert one not in chosen[other]['preconditions'] and other not in chosen[one]['preconditions']

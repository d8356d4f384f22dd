# SPDX-License-Identifier: BSD-3-Clause
"""The examples of flexbe_synthesis: the same formulas, machines that are no larger, and each in time."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml

from flexbt_formal.synthesis.capabilities import StateInterface, read_capabilities, read_mappings
from flexbt_formal.synthesis.encoding import Encoding
from flexbt_formal.synthesis.formulas import parse_formula
from flexbt_formal.synthesis.from_strategy import MachinePart, MachineState, SynthesizedMachine
from flexbt_formal.synthesis.machine_text import state_instantiations
from flexbt_formal.synthesis.request_files import MachineRequest, as_structured_slugs, read_specification
from flexbt_formal.synthesis.specification import Section
from flexbt_formal.synthesis.synthesis import synthesize
from flexbt_formal.synthesis.translation import Liveness, Options, SynthesisProblem, translated

DATA = Path(os.environ.get('FLEXBT_SHARED_DATA', Path(__file__).resolve().parents[4] / 'shared/data')) / 'synthesis'
PAIRS = [
    path.stem
    for path in sorted(DATA.glob('expected/*.json'))
    if (DATA / 'generated' / f'{path.stem}.structuredslugs').is_file()
]

pytestmark = pytest.mark.skipif(not PAIRS, reason='the examples of flexbe_synthesis are not at hand')


def interface(name: str, parameters: Mapping[str, Any]) -> StateInterface:
    return StateInterface(('done',) if name == 'LogState' else tuple(parameters['outcomes']))


def expected(pair: str) -> dict[str, Any]:
    return json.loads((DATA / 'expected' / f'{pair}.json').read_text(encoding='utf-8'))


def problem(pair: str, liveness: Liveness, **options: Any) -> SynthesisProblem:
    files = expected(pair)

    def text(kind: str) -> tuple[str, str]:
        return (DATA / files[kind]).read_text(encoding='utf-8'), files[kind]

    asked = files['request']
    request = MachineRequest(tuple(asked['initial_conditions']), tuple(asked['goals']), tuple(asked['sm_outcomes']))
    return translated(
        read_capabilities(*text('capabilities'), read_mappings(*text('mappings'))),
        interface,
        request,
        read_specification(*text('specification')),
        Options(liveness, parsed=pair.endswith('_parsed'), **options),
    )


@pytest.mark.parametrize('pair', PAIRS)
def test_the_formulas_are_those_of_flexbe_synthesis(pair: str) -> None:
    """Section by section the same set of valuations. The parsed form begins with what the request says, and not with
    nothing; and its liveness is not primed in one of three places, as upstream's is for the first capability."""
    ours = problem(pair, Liveness.ADVERSARIAL, pending='extended' in pair).specification
    path = DATA / 'generated' / f'{pair}.structuredslugs'
    theirs = read_specification(path.read_text(encoding='utf-8'), path.name)
    encoding = Encoding(ours)
    differing = []
    for section, entries in theirs.formulas.items():
        formulas = [parse_formula(text, ours.ranges) for text, _ in entries]
        if encoding.all_of(formulas) != encoding.all_of(ours.of(section)):
            differing.append(section)
    on_purpose = [Section.SYS_INIT] if pair.endswith('_parsed') else []
    on_purpose += [Section.SYS_LIVENESS] if pair == 'coffee_capabilities_extended_parsed' else []
    assert differing == on_purpose


@pytest.mark.parametrize('pair', PAIRS)
@pytest.mark.parametrize('liveness', [Liveness.ADVERSARIAL, Liveness.FAIR])
def test_the_machine_is_no_larger_and_made_in_time(pair: str, liveness: Liveness) -> None:
    began = time.process_time()
    machine = synthesize(problem(pair, liveness)).machine
    assert time.process_time() - began < 10.0
    assert machine is not None
    assert 1 + len(machine.states) + len(machine.outcomes) <= expected(pair)['tested_upstream']['state_count']


def test_a_specification_that_is_written_is_read_as_the_same() -> None:
    ours = problem('vending_capabilities', Liveness.ADVERSARIAL).specification
    again = read_specification('\n'.join(as_structured_slugs(ours)), 'written')
    assert again.variables == ours.variables
    for section, entries in again.formulas.items():
        assert [parse_formula(text, ours.ranges) for text, _ in entries] == ours.of(section)


def parameter(value: Any) -> Any:
    """As the machines have it: quoted text is text, any other text is code."""
    if not isinstance(value, str):
        return value
    return value[1:-1] if value[0] in '\'"' else f'*{value}'


def sm_loader_machine(name: str) -> SynthesizedMachine:
    """Return a machine that was written for flexbe_synthesis' ``sm_loader``."""
    written = yaml.safe_load((DATA / name).read_text(encoding='utf-8'))
    states = {}
    for one in written['states']:
        parameters = {key: parameter(value) for key, value in one.get('parameters', {}).items()}
        keys = one.get('userdata_keys', [])
        remapping = dict(zip(keys, one.get('userdata_remapping', keys), strict=True))
        outcomes = tuple(one['outcomes'])
        part = MachinePart(one['name'], one['state_class'], parameters, outcomes, remapping)
        levels = one.get('autonomy', [1] * len(outcomes))
        states[one['name']] = MachineState(
            one['name'],
            (part,),
            dict(zip(outcomes, one['transitions'], strict=True)),
            dict(zip(outcomes, levels, strict=True)),
        )
    initial = written['sm']['initial_state']
    ordered = {initial: states[initial], **states}
    return SynthesizedMachine(Path(name).stem, tuple(written['sm']['outcomes']), ordered)


def test_a_machine_that_is_written_is_loaded_and_said_as_upstream_says_it() -> None:
    files = expected('hello_world')
    machine = sm_loader_machine(files['state_machine'])
    ours = state_instantiations(machine)
    assert len(ours) == files['tested_upstream']['state_count']
    for one, theirs in zip(ours, files['observed']['states'], strict=True):
        parameters = dict(zip(one['parameter_names'], one['parameter_values'], strict=True))
        assert {**one, 'parameters': parameters} == {**one, **theirs}


@pytest.mark.parametrize('pair', PAIRS)
def test_what_follows_what_is_as_upstream_has_it(pair: str) -> None:
    """State by state from the initial one, whatever the states are called."""
    machine = synthesize(problem(pair, Liveness.ADVERSARIAL)).machine
    assert machine is not None
    theirs = {one['state_path'].lstrip('/'): one for one in expected(pair)['observed']['states']}
    same = {machine.initial: expected(pair)['observed']['initial_state']}
    waiting = [machine.initial]
    while waiting:
        name = waiting.pop()
        state, other = machine.states[name], theirs[same[name]]
        assert state.parts[0].state_class == other['state_class']
        assert {key: repr(value) for key, value in state.parts[0].parameters.items()} == other['parameters']
        targets = dict(zip(other['outcomes'], other['transitions'], strict=True))
        assert state.transitions.keys() == targets.keys()
        for outcome, target in state.transitions.items():
            if target in machine.outcomes:
                assert targets[outcome] == target
            elif target not in same:
                same[target] = targets[outcome]
                waiting.append(target)
            else:
                assert same[target] == targets[outcome]

# SPDX-License-Identifier: BSD-3-Clause
"""Specifications that are written by hand as a whole: of the activation-outcome style, with steps in which nothing
arrives, and with several capabilities at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import pytest
from test_synthesis_pairs import DATA

from flexbt_core.clock.clock import ManualClock
from flexbt_core.state_machine.authoring.yaml_form import read_machine
from flexbt_core.state_machine.engine.run import MachineRun
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import UserData
from flexbt_formal.synthesis.capabilities import StateInterface, read_capabilities
from flexbt_formal.synthesis.errors import SynthesisError
from flexbt_formal.synthesis.from_strategy import SynthesizedMachine
from flexbt_formal.synthesis.hand_written import hand_written, is_whole
from flexbt_formal.synthesis.machine_text import machine_as_yaml
from flexbt_formal.synthesis.request_files import MachineRequest, read_specification
from flexbt_formal.synthesis.synthesis import synthesize


def specification(outcomes: Mapping[str, str], rules: str, goal: str) -> str:
    """Capabilities with outcomes (suffixes); what arrived stays until the next activation, an activation until then."""

    def lines() -> Iterator[str]:
        told = [f'{name}_{one}' for name, suffixes in outcomes.items() for one in suffixes]
        active = [f'{name}_a' for name in outcomes]
        memory = [f'{name}_m' for name in outcomes]
        yield from ('[INPUT]', *told, '[OUTPUT]', *active, *memory, 'finished')
        yield from (
            '[ENV_INIT]',
            *(f'!{one}' for one in told),
            '[SYS_INIT]',
            *(f'!{one}' for one in (*memory, 'finished')),
        )
        yield '[ENV_TRANS]'
        for name, suffixes in outcomes.items():
            for one in suffixes:
                yield f"!{name}_a -> ({name}_{one}' <-> {name}_{one})"
            if len(suffixes) > 1:
                yield f"!({name}_c' & {name}_f')"
        yield '[SYS_TRANS]'
        for name, suffixes in outcomes.items():
            arrives = ' | '.join(f"{name}_{one}'" for one in suffixes)
            yield f"{name}_a & !({arrives}) -> {name}_a'"
            yield f"{name}_a & {name}_c' -> !{name}_a'"
            yield f"({name}_a & {name}_c') | {name}_m <-> {name}_m'"
        yield rules
        yield f"finished' <-> (next({goal}) | finished)"
        yield '[ENV_LIVENESS]'
        answers = ' | '.join(f"({name}_a & {name}_c')" for name in outcomes)
        idle = ' & '.join(f'!{one}' for one in active)
        yield f'{answers} | ({idle})'
        yield from ('[SYS_LIVENESS]', 'finished')

    return '\n'.join(lines())


ONE_AT_A_TIME = """
!(press_a' & grind_a') & !(press_a' & brew_a') & !(grind_a' & brew_a')
!press_m' -> !grind_a'
!grind_m' -> !brew_a'
finished' -> !press_a' & !grind_a' & !brew_a'
"""
COFFEE = specification({'press': 'c', 'grind': 'cf', 'brew': 'c'}, ONE_AT_A_TIME, 'brew_m')


def made(text: str, request: MachineRequest | None = None) -> SynthesizedMachine:
    machine = synthesize(hand_written(read_specification(text, 'whole'), request or MachineRequest())).machine
    assert machine is not None
    return machine


def edges(machine: SynthesizedMachine) -> dict[str, dict[str, str]]:
    return {name: dict(state.transitions) for name, state in machine.states.items()}


def test_steps_in_which_nothing_arrives_are_no_states() -> None:
    assert edges(made(COFFEE)) == {
        'press': {'completed': 'grind'},
        'grind': {'completed': 'brew', 'failure': 'grind'},
        'brew': {'completed': 'finished'},
    }


def test_capabilities_say_which_states_carry_it_out_and_nothing_is_lost_in_silence() -> None:
    states = ', '.join(f'{name}: {{interface: Log}}' for name in ('press', 'grind', 'brew', 'tea'))
    text = f'capabilities: {{{states}}}'
    mappings = 'state_outcome_mappings: {done: completed}\nsm_outcome_mappings: {finished: finished}\n'
    capabilities = read_capabilities(mappings + text, 'coffee.yaml')
    given = read_specification(COFFEE, 'whole')
    assert is_whole(given, capabilities)  # also without tea
    assert not is_whole(read_specification("[OUTPUT]\npress_a\n[SYS_TRANS]\n!brew_a'", 'some'), capabilities)
    problem = hand_written(given, MachineRequest(), capabilities, lambda name, parameters: StateInterface(('done',)))
    machine = synthesize(problem).machine
    assert machine is not None
    assert edges(machine)['grind'] == {'done': 'brew'}
    assert [note.partition(':')[0] for note in machine.notes] == ['grind', 'tea']


def test_a_failure_by_which_a_specification_ends_needs_no_request() -> None:
    """Where the state cannot fail, the request counts alone, as in flexbe_synthesis' example with such a text."""
    gives_up = "failed' <-> ((grind_a & grind_f') | failed)\nfailed' -> !press_a' & !grind_a' & !brew_a'"
    text = COFFEE.replace('[OUTPUT]', '[OUTPUT]\nfailed').replace('[SYS_TRANS]', f'[SYS_TRANS]\n{gives_up}')
    text = text.replace('[SYS_LIVENESS]\nfinished', '[SYS_INIT]\n!failed\n[SYS_LIVENESS]\nfinished | failed')
    finished = MachineRequest(outcomes=('finished',))
    machine = made(text, finished)
    assert machine.outcomes == ('finished', 'failed')
    assert edges(machine)['grind'] == {'completed': 'brew', 'failure': 'failed'}
    states = ', '.join(f'{name}: {{interface: Log}}' for name in ('press', 'grind', 'brew'))
    mappings = 'state_outcome_mappings: {done: completed}\nsm_outcome_mappings: {finished: finished}\n'
    log = read_capabilities(f'{mappings}capabilities: {{{states}}}', 'log.yaml')
    whole = read_specification(text, 'whole')
    cannot_fail = synthesize(
        hand_written(whole, finished, log, lambda name, parameters: StateInterface(('done',)))
    ).machine
    assert cannot_fail is not None and cannot_fail.outcomes == ('finished',)
    assert "nothing leads to the outcome 'failed', so the machine does not have it" in cannot_fail.notes


class Done(EventState):
    def __init__(self) -> None:
        super().__init__(['completed'], desired_rate=None)

    def on_enter(self, userdata: UserData) -> None:
        self.wake()

    def execute(self, userdata: UserData) -> str:
        return 'completed'


def test_what_is_active_at_once_is_a_concurrency_container() -> None:
    both = "left_a <-> right_a\nfinished' -> !left_a'\n(left_c' & left_a) <-> (right_c' & right_a)"
    text = specification({'left': 'c', 'right': 'c'}, both, 'left_m & right_m')
    text = text.replace('[SYS_TRANS]', "left_a -> (left_c' <-> right_c')\n[SYS_TRANS]")
    machine = made(text)
    assert edges(machine) == {'left_right': {'left_completed__right_completed': 'finished'}}
    definition = read_machine(machine_as_yaml(machine), {'left': Done, 'right': Done})
    run = MachineRun(definition, ManualClock(), autonomy=Autonomy.Full)
    run.start()
    for _ in range(100):
        if not run.step():
            break
    assert run.outcome == 'finished'


def test_what_comes_next_has_to_be_told_by_an_outcome() -> None:
    either = "press_c' & press_a & sweet' -> brew_a'\npress_c' & press_a & !sweet' -> grind_a'"
    text = COFFEE.replace('[INPUT]', '[INPUT]\nsweet').replace('[SYS_TRANS]', f'[SYS_TRANS]\n{either}')
    with pytest.raises(SynthesisError) as caught:
        made(text.replace("!grind_m' -> !brew_a'", "!press_m' -> !brew_a'"))
    assert "after 'press:completed' in press what comes next depends on sweet" in str(caught.value)


@pytest.mark.parametrize(
    ('section', 'formula', 'problem'),
    [
        ('ENV_TRANS', "finished' -> press_c'", "the world moves before finished' is chosen, so it cannot depend on it"),
        ('ENV_INIT', "!press_c'", "press_c' is of the next step, and this is about the beginning"),
        ('SYS_INIT', 'next(!press_a)', "press_a' is of the next step, and this is about the beginning"),
    ],
)
def test_what_is_not_known_yet_is_refused(section: str, formula: str, problem: str) -> None:
    with pytest.raises(SynthesisError, match=problem):
        made(COFFEE.replace(f'[{section}]', f'[{section}]\n{formula}'))


@pytest.mark.skipif(not DATA.is_dir(), reason='the examples of flexbe_synthesis are not at hand')
def test_the_wolf_the_goat_and_the_corn_are_brought_across() -> None:
    """Whatever fails: seven crossings, and nobody is eaten."""
    path = DATA / 'extra' / 'wgcf.yaml'
    machine = made(path.read_text(encoding='utf-8'))
    way, at = [], machine.initial
    while at in machine.states:
        way.append(machine.states[at].parts[0].capability.removeprefix('move_'))
        at = machine.states[at].transitions['completed']
    assert at == 'finished'
    assert way in (
        ['goat', 'null', carried, 'goat', other, 'null', 'goat', 'log_finished']
        for carried, other in (('corn', 'wolf'), ('wolf', 'corn'))
    )

# SPDX-License-Identifier: BSD-3-Clause
"""Userdata that cannot have been written when it is read, and such that may not have been."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from itertools import permutations
from random import Random
from typing import Any

import hypothesis.strategies as st
import pytest
from hypothesis import HealthCheck, given, reject, settings

from flexbt_core.state_machine.authoring import data_flow
from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.authoring.data_flow import WriteRace, races, unsure_reads
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.definition import Child
from flexbt_core.state_machine.model.userdata import MachineError
from flexbt_testing.state_machines.bench import Bench, Scripted, machine, nested


def keyed(*outcomes: str, reads: str = '', writes: str = '') -> Scripted:
    return Scripted(*outcomes, input_keys=reads.split(), output_keys=writes.split())


def test_a_key_that_is_written_only_later_is_named_with_both_ends() -> None:
    made = machine(
        Child('A', keyed(writes='x'), {'done': 'B'}),
        Child('B', keyed(reads='x y'), {'done': 'C'}, remapping={'y': 'z'}),
        Child('C', keyed(writes='z'), {'done': 'ended'}),
    )
    with pytest.raises(MachineError) as caught:
        define(made)
    assert caught.value.problems == (
        "/B: reads userdata key 'y' (remapped to 'z'); only /C writes it, and no way leads from there to here",
    )


def test_a_key_that_is_written_in_a_loop_is_unsure() -> None:
    made = machine(
        Child('B', keyed(reads='x'), {'done': 'C'}),
        Child('C', keyed('again', 'done', writes='x'), {'again': 'B', 'done': 'ended'}),
    )
    (read,) = unsure_reads(define(made))
    assert (read.path, read.text, read.writers) == ('/B', "reads userdata key 'x'", ('/C',))


def test_a_state_in_many_machines_is_looked_at_once_for_each_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    looks: list[str] = []
    effects = data_flow._effects

    def counted(node: data_flow.StateOrMachine) -> Mapping[str, data_flow.WrittenKeys]:
        looks.append(node.path)
        return effects(node)

    monkeypatch.setattr(data_flow, '_effects', counted)
    define(nested(keyed(), 'A/B/C/D/E/F/G/H/I/J'))
    assert max(Counter(looks).values()) == 10


def test_where_many_ways_part_and_meet_each_is_followed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    steps = 0
    then = data_flow.WrittenKeys.then

    def counted(self: data_flow.WrittenKeys, other: data_flow.WrittenKeys) -> data_flow.WrittenKeys:
        nonlocal steps
        steps += 1
        return then(self, other)

    children = []
    for number in range(50):
        following = f'Ask{number + 1}' if number < 49 else 'ended'
        children += [
            Child(f'Ask{number}', keyed('left', 'right'), {'left': f'L{number}', 'right': f'R{number}'}),
            Child(f'L{number}', keyed(writes=f'l{number}'), {'done': following}),
            Child(f'R{number}', keyed(writes=f'r{number}'), {'done': following}),
        ]
    made = define(machine(*children))
    monkeypatch.setattr(data_flow.WrittenKeys, 'then', counted)
    assert unsure_reads(made) == [] and steps <= 2 * 2 * len(children)


def test_what_both_ways_write_is_sure() -> None:
    def made(second: str) -> OperatableStateMachine:
        return machine(
            Child('A', keyed('left', 'right'), {'left': 'L', 'right': 'R'}),
            Child('L', keyed(writes='x'), {'done': 'End'}),
            Child('R', keyed(writes=second), {'done': 'End'}),
            Child('End', keyed(reads='x'), {'done': 'ended'}),
        )

    assert unsure_reads(define(made('x'))) == []
    assert [read.path for read in unsure_reads(define(made('y')))] == ['/End']


def test_a_machine_writes_what_it_hands_out_by_the_outcome_that_it_ends_by() -> None:
    inner = machine(
        Child('Ask', keyed('yes', 'no'), {'yes': 'Write', 'no': 'without'}),
        Child('Write', keyed(writes='x'), {'done': 'with'}),
        outcomes=['with', 'without'],
        output_keys=['x'],
    )
    made = machine(
        Child('M', inner, {'with': 'Good', 'without': 'Bad'}, remapping={'x': 'y'}),
        Child('Good', keyed(reads='y'), {'done': 'ended'}),
        Child('Bad', keyed(reads='y'), {'done': 'ended'}),
    )
    with pytest.raises(MachineError) as caught:
        define(made)
    assert caught.value.problems == (
        "/Bad: reads userdata key 'y'; only /M writes it, and no way leads from there to here",
    )


def test_children_of_a_concurrency_container_may_read_what_others_write_meanwhile() -> None:
    both = machine(
        Child('A', keyed(reads='x')),
        Child('B', keyed('done', 'not', writes='x')),
        outcomes=['both', 'one'],
        output_keys=['x'],
        conditions=[('both', [('A', 'done'), ('B', 'done')]), ('one', [('A', 'done')])],
    )
    made = machine(
        Child('Both', both, {'both': 'End', 'one': 'Other'}),
        Child('End', keyed(reads='x'), {'done': 'ended'}),
        Child('Other', keyed(reads='x'), {'done': 'ended'}),
    )
    assert [read.path for read in unsure_reads(define(made))] == ['/Both/A', '/Other']


def test_what_a_child_that_never_ends_writes_may_be_read_beside_it_and_behind_its_container() -> None:
    watch = machine(
        Child('Look', keyed(writes='seen'), {'done': 'Wait'}),
        Child('Wait', keyed(), {'done': 'Look'}),
        output_keys=['seen'],
    )
    both = machine(
        Child('Watch', watch),
        Child('Drive', keyed(reads='seen')),
        output_keys=['seen'],
        conditions=[('ended', [('Drive', 'done')])],
    )
    made = machine(
        Child('Both', both, {'ended': 'Report'}),
        Child('Report', keyed(reads='seen'), {'done': 'ended'}),
    )
    assert [read.path for read in unsure_reads(define(made))] == ['/Both/Drive', '/Report']


def test_several_writers_of_what_is_read_inside_a_container() -> None:
    both = machine(
        Child('A', keyed(reads='x', writes='x')),
        Child('B', keyed(writes='y'), remapping={'y': 'x'}),
        Child('C', keyed(writes='z')),
        Child('D', keyed(writes='z')),
        conditions=[('ended', [(label, 'done') for label in 'ABCD'])],
    )
    made = machine(Child('Both', both, {'ended': 'ended'}), defaults={'x': 0})
    writers = ('/Both/A', '/Both/B')
    assert list(races(define(made))) == [WriteRace('/Both', 'x', writers, writers)], 'nobody reads z'


@given(st.data())
def test_who_is_the_last_of_several_writers_depends_on_their_order(data: st.DataObject) -> None:
    """A key that is handed out has another value when the children end in another order: those that it names, only."""
    keys = st.lists(st.sampled_from('xyz'), unique=True)
    names = st.permutations('xyz')
    shapes = data.draw(st.lists(st.tuples(keys, names, keys, names, keys), min_size=2, max_size=3))
    outputs = data.draw(keys)
    labels = 'ABC'[: len(shapes)]
    states: dict[str, Scripted] = {}

    def made() -> OperatableStateMachine:
        places = []
        for label, (written, inner_names, handed_out, outer_names, defaults) in zip(labels, shapes, strict=True):
            states[label] = Scripted('done', output_keys=written, do={'on_exit': _sign})
            inner_map, outer_map = (dict(zip('xyz', one, strict=True)) for one in (inner_names, outer_names))
            known = {inner_map[key] for key in written} | set(defaults)
            inner = machine(
                Child('S', states[label], {'done': 'done'}, remapping=_of(inner_map, written)),
                outcomes=['done'],
                output_keys=[key for key in handed_out if key in known],
                defaults=dict.fromkeys(defaults, 'default'),
            )
            places.append(Child(label, inner, remapping=_of(outer_map, inner.output_keys)))
        writers = {place.remapping[key] for place in places for key in place.state.output_keys}
        container = machine(
            *places,
            output_keys=[key for key in outputs if key in writers],
            conditions=[('ended', [(label, 'done') for label in labels])],
        )
        return machine(Child('Both', container, {'ended': 'ended'}))

    values: dict[str, set[object]] = defaultdict(set)
    for order in permutations(labels):
        bench = Bench(made())
        for label in order:
            states[label].end('done')
            bench.settle()
        assert bench.outcome == 'ended'
        for key, value in bench.run.userdata().items():
            values[key].add(value)
    found = list(races(define(made())))
    assert {race.name for race in found} == {key for key, seen in values.items() if len(seen) > 1}
    for race in found:
        assert values[race.name] == {f'{path}/S' for path in race.writers}


def _sign(state: Scripted, userdata: Any) -> None:
    for key in state.output_keys:
        userdata[key] = state.path


def _of(names: dict[str, str], keys: Iterable[str]) -> dict[str, str]:
    return {key: names[key] for key in keys}


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(seed=st.integers(0, 2**32))
def test_what_the_check_says_holds_in_runs(seed: int) -> None:
    """A read that it calls sure never fails."""
    random = Random(seed)
    made, states = _random_machine(random, 2)
    missing: set[tuple[str, str]] = set()
    for state in states:
        state.do['on_enter'] = lambda state, userdata: _use(state, userdata, missing)
        state.do['execute'] = lambda state, _: random.choice(state.outcomes)
    try:
        unsure = {read.path for read in unsure_reads(define(made))}
    except MachineError:
        reject()
    bench = Bench(made, max_transitions=300)
    assert bench.outcome is not None
    for path, key in missing:
        assert any(f'{path}/'.startswith(f'{one}/') for one in unsure), (path, key, unsure)
    assert all(state.calls('on_enter') == state.calls('on_exit') for state in states)


def _use(state: Scripted, userdata: Any, missing: set[tuple[str, str]]) -> None:
    missing |= {(state.path, key) for key in state.input_keys if key not in userdata}
    for key in state.output_keys:
        userdata[key] = 1


def _random_machine(random: Random, depth: int) -> tuple[OperatableStateMachine, list[Scripted]]:
    keys = ['k', 'l', 'm']
    places, states = [], []
    labels = [f'S{number}' for number in range(random.randint(1, 4))]
    for number, label in enumerate(labels):
        state: Any
        if depth and random.random() < 0.4:
            state, inner = _random_machine(random, depth - 1)
            states += inner
        else:
            state = Scripted(
                'x', 'y', input_keys=random.sample(keys, random.randint(0, 1)), output_keys=random.sample(keys, 1)
            )
            states.append(state)
        ways = {outcome: random.choice([*labels, 'x', 'y']) for outcome in state.outcomes}
        ways['x'] = labels[number + 1] if number + 1 < len(labels) else 'x'
        places.append(Child(label, state, ways))
    outputs = random.sample(keys, random.randint(0, 1))
    written = {key for state in states for key in state.output_keys}
    made = machine(
        *places,
        outcomes=['x', 'y'],
        input_keys=random.sample(keys, random.randint(0, 2)) if depth < 2 else [],
        output_keys=[key for key in outputs if key in written] if depth < 2 else [],
        defaults=dict.fromkeys(random.sample(keys, random.randint(0, 1)), 0),
    )
    return made, states

# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors in YAML: parameters, values, wrappers, embedded behaviors, and where problems are reported."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from enum import Enum
from random import Random
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.authoring.machine import (
    ConcurrencyContainer,
    OperatableStateMachine,
    PriorityContainer,
    embedded,
)
from flexbt_core.state_machine.authoring.wrappers import with_retry, with_timeout
from flexbt_core.state_machine.authoring.yaml_form import MAX_CHARACTERS, read_machine
from flexbt_core.state_machine.model.definition import Child, Machine, MachineDefinition, StateDefinition, StateKind
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import MachineError
from flexbt_core.values.findings import FindingRecord
from flexbt_core.values.yaml_data import StrictYamlParts, strict_yaml
from flexbt_testing.hostile_yaml import HOSTILE_YAML
from flexbt_testing.state_machines.bench import Scripted
from flexbt_testing.state_machines.random_machines import RandomNode, random_machine


class Mode(Enum):
    FAST = 'quick'
    SLOW = 2


class Do(Scripted):
    """A state that keeps what it was made of."""

    def __init__(
        self, value: Any = None, mode: Mode | None = None, code: Callable[[], int] | None = None, **_: Any
    ) -> None:
        super().__init__('done', 'failed')
        self.made_of = value, mode
        if code is not None and not callable(code):
            raise TypeError('it is no function')


class Strict(Scripted):
    def __init__(self, first: int, second: Mode, third: Callable[[int], int] = abs) -> None:
        super().__init__('done', input_keys=['key'], output_keys=['key'])
        if first < 0:
            error = ValueError('it is negative')
            error.parameter = 'first'  # type: ignore[attr-defined]
            raise error


class Any_(EventState):
    """A state with any outcomes."""

    def __init__(self, outcomes: list[str]) -> None:
        super().__init__(outcomes)


STATES = {'Do': Do, 'Strict': Strict, 'Any': Any_}


def read(text: str, **parameters: Any) -> MachineDefinition:
    return read_machine(text, STATES, 'b.yaml', parameters=parameters, behaviors=Inner)


def problems(text: str) -> tuple[FindingRecord, ...]:
    with pytest.raises(MachineError) as caught:
        read(text)
    error = caught.value
    assert len(error.problems) == len(error.records)
    for problem, record in zip(error.problems, error.records, strict=True):
        assert problem == f'b.yaml:{record["line"]}:{record["column"]}: {record["message"]}'
        assert (record['rule'], record['severity'], record['file']) == ('refused', 'error', 'b.yaml')
        assert (record['end_line'], record['end_column']) >= (record['line'], record['column'])
    return error.records


def marked(text: str) -> list[str]:
    """Return the problems of a text, each as the text it is about, and its message."""
    lines = text.split('\n')
    return [
        f'{lines[one["line"] - 1][one["column"] - 1 : one["end_column"] - 1]} | {one["message"]}'
        for one in problems(text)
        if one['line'] == one['end_line']
    ]


def only(state: str, head: str = '') -> str:
    """Return a behavior with one state."""
    parameters = f'behavior: {{parameters: {{{head}}}}}\n' if head else ''
    states = f'    A: {{{state}, transitions: {{done: end, failed: end}}}}\n'
    return f'{parameters}machine:\n  outcomes: [end]\n  states:\n{states}'


def value_of(text: str, head: str = '', **parameters: Any) -> Any:
    """Return the parameter ``value`` of a state, which is written as ``text``."""
    state = read(only(f'state: Do, parameters: {{value: {text}}}', head), **parameters).children['A']
    assert isinstance(state, StateDefinition) and isinstance(state.state, Do)
    return state.state.made_of[0]


# -- random machines ---------------------------------------------------------------------------------------------------


class Name(str):
    """A text that is written without quotes, whatever it would be as a value."""

    __slots__ = ()


class Dumper(yaml.SafeDumper):
    def represent_name(self, name: Name) -> yaml.ScalarNode:
        tag = self.resolve(yaml.ScalarNode, str(name), (True, False))  # type: ignore[no-untyped-call]
        return self.represent_scalar(tag, str(name))

    def represent_value(self, text: str) -> yaml.ScalarNode:
        return self.represent_scalar('tag:yaml.org,2002:str', text.replace('$', '$$'), '"')


Dumper.add_representer(Name, Dumper.represent_name)
Dumper.add_representer(str, Dumper.represent_value)

NAMES = {'x': 'yes', 'y': 'off', 'z': 'null', 'done': 'on', 'other': '1e3', 'failed': '$n'}
"""Names that would be no texts, were they values."""
CONTAINERS = {
    StateKind.MACHINE: ('machine', OperatableStateMachine),
    StateKind.CONCURRENCY: ('concurrency', ConcurrencyContainer),
    StateKind.PRIORITY: ('priority', PriorityContainer),
}


def named(way: RandomNode | str) -> str:
    return NAMES[way] if isinstance(way, str) else way.path.rpartition('/')[2]


def in_both_forms(random: Random, node: RandomNode) -> tuple[dict[str, Any], Machine]:
    """Return a random machine as data for YAML, and as it is built in Python."""
    states: dict[str, Any] = {}
    children = []
    for child in node.children:
        transitions = {NAMES[name]: named(way) for name, way in child.ways.items()}
        autonomy = {NAMES[name]: level for name, level in child.required.items() if level >= 0}
        written: dict[str, Any] = {'transitions': names(transitions), 'autonomy': names(autonomy)}
        made: EventState | Machine
        if child.children:
            written[CONTAINERS[child.kind][0]], made = in_both_forms(random, child)
        else:
            outcomes = [NAMES[name] for name in child.outcomes]
            wrappers, made = wrapped(random, Any_(outcomes))
            written |= {'state': 'Any', 'parameters': {'outcomes': outcomes}, **wrappers}
        states[named(child)] = names(written)
        children.append(Child(named(child), made, transitions, autonomy))
    outcomes = [NAMES[name] for name in node.outcomes]
    level = random.choice([-1, 0, 1, 2, 3])
    kind, container = CONTAINERS[node.kind]
    made = container(outcomes, children=children, autonomy=level)
    data: dict[str, Any] = {'outcomes': names(outcomes), 'states': names(states)}
    if level >= 0:
        data['autonomy'] = names(random.choice([level, ['off', 'Low', 'HIGH', 'full'][level]]))
    if kind == 'concurrency':
        ended = [(NAMES[one], [(named(at), NAMES[out]) for at, out in when]) for one, when in node.conditions]
        made = ConcurrencyContainer(outcomes, conditions=ended, children=children, autonomy=level)
        data['conditions'] = [names({'outcome': outcome, 'when': names(dict(when))}) for outcome, when in ended]
    return names(data), made


def names(one: Any) -> Any:
    """Return data of which texts, keys, and values that are texts, are written without quotes."""
    if isinstance(one, dict):
        return {Name(key): names(value) if isinstance(value, str) else value for key, value in one.items()}
    return [names(each) for each in one] if isinstance(one, list) else Name(one) if isinstance(one, str) else one


def wrapped(random: Random, state: EventState) -> tuple[dict[str, Any], EventState]:
    """Return a state with random limits of time and attempts, in both forms."""
    written: dict[str, Any] = {}
    first, last = state.outcomes[0], state.outcomes[-1]
    if random.random() < 0.3:
        attempts, delay = random.randint(1, 5), random.choice([0, 1.5])
        written['retry'] = {'attempts': attempts, 'on': names([first]), 'delay': delay}
        if random.random() < 0.5:
            written['retry']['timeout'] = names({'after': 2, 'outcome': last})
            state = with_timeout(state, 2.0, last)
        state = with_retry(state, attempts, [first], delay=delay)
    if random.random() < 0.3:
        written['timeout'] = names({'after': 0.5, 'outcome': first})
        state = with_timeout(state, 0.5, first)
    return written, state


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from([True, False, None]))
def test_a_random_machine_in_yaml_is_the_one_in_python(seed: int, flow: bool | None) -> None:
    random = Random(seed)
    node = random_machine(random, 15)
    data, machine = in_both_forms(random, node)
    try:
        expected: MachineDefinition | None = define(machine)
    except MachineError as error:
        expected, problem = None, str(error.problems[0])
    text = yaml.dump({CONTAINERS[node.kind][0]: data}, None, Dumper, default_flow_style=flow, sort_keys=False)
    if expected is None:
        assert any(problem in one['message'] for one in problems(text))
        return
    made = read(text)
    assert made.structure() == expected.structure()
    assert [node.transitions for node in made.nodes()] == [node.transitions for node in expected.nodes()]
    again = define(embedded(read(text)))
    assert again.structure() == expected.structure(), 'a definition can be embedded'


# -- values ------------------------------------------------------------------------------------------------------------

PLAIN = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text() | st.sampled_from(
    ['yes', 'Off', '010', '08', '1e3', '1_0', '1:30', '0o7', '2026-11-28', '$a', '$$a', '$', '${a}', '=', '<<', '~', '']
)  # fmt: skip
VALUES = st.recursive(PLAIN, lambda inner: st.lists(inner) | st.dictionaries(st.text() | st.integers(), inner))


@settings(deadline=None)
@given(VALUES)
def test_a_value_is_read_as_it_was_written(value: Any) -> None:
    parts = StrictYamlParts('v.yaml')
    root = parts.root(strict_yaml(value))
    assert (parts.value(root, 'it') if root is not None else None) == value
    assert not parts.problems


@pytest.mark.parametrize('text', ['<root>\n  <Node/>\n</root>', 'yes\n', '\r', '\x85', 'a\u2028b'])
def test_a_text_of_several_lines_is_written_on_one(text: str) -> None:
    """So that it may stand anywhere in a larger text, however far that is indented."""
    parts = StrictYamlParts('v.yaml')
    written = strict_yaml([text])
    assert written.splitlines() == [written]
    assert parts.value(parts.mapping(parts.root(f'it: {written}'), 'the text')['it'], 'it') == [text]


@pytest.mark.parametrize(
    ('text', 'value'),
    [
        ('$n', 3),
        ("'$n'", 3),
        ('"$n"', 3),
        ('[$n, {a: $t}]', [3, {'a': 'x y'}]),
        ('$b', True),
        ('$l', [1, {'two': '2'}]),
        ('$$n', '$n'),
        ('$$$n', '$$n'),
        ('$5', '$5'),
        ('$', '$'),
        ("'${n * 2}'", '${n * 2}'),
        ('cost $n', 'cost $n'),
        ('$n $t', '$n $t'),
        ("{$n: '1e3'}", {'$n': '1e3'}),
    ],
)
def test_a_parameter_is_a_whole_value_of_its_type(text: str, value: Any) -> None:
    head = "n: {default: 3}, t: {default: x y}, b: {default: true}, l: {default: [1, {two: '2'}]}"
    found = value_of(text, head)
    assert (found, type(found)) == (value, type(value))


def test_the_given_values_of_parameters_count_and_are_not_shared() -> None:
    given_list = [1]
    found = value_of('[$l, $l, $n]', 'l: {default: []}, n: {default: $$}', l=given_list)
    assert found == [[1], [1], '$']
    found[0].append(2)
    assert found[1] == given_list == [1]


@pytest.mark.parametrize(
    'text',
    ['yes', 'No', 'ON', 'off', '010', '08', '0b1', '0o17', '1_000', '1:30', '1e3', '-1.5E3', '=', '<<', '2026-11-28'],
)
def test_what_versions_of_yaml_read_in_different_ways_is_refused(text: str) -> None:
    (problem,) = marked(only(f'state: Do, parameters: {{value: [1, {text}]}}'))
    assert problem.startswith(f"{text} | parameters of /A: 'value': versions of YAML read ")
    assert value_of(f"'{text}'") == text


@pytest.mark.parametrize(
    ('text', 'value'),
    [('1', 1), ('-2.5', -2.5), ('1.0e+3', 1e3), ('0x1F', 31), ('~', None), ('true', True), ('.inf', float('inf'))],
)
def test_what_all_versions_read_alike_is_a_value(text: str, value: Any) -> None:
    assert value_of(text) == value


@pytest.mark.parametrize(
    ('text', 'mode'),
    [('FAST', Mode.FAST), ('quick', Mode.FAST), ('SLOW', Mode.SLOW), ('$m', Mode.SLOW), ('null', None)],
)
def test_an_enumeration_is_named(text: str, mode: Mode | None) -> None:
    state = read(only(f'state: Do, parameters: {{mode: {text}}}', 'm: {default: SLOW}')).children['A']
    assert isinstance(state, StateDefinition) and isinstance(state.state, Do)
    assert state.state.made_of[1] is mode


# -- embedded behaviors ------------------------------------------------------------------------------------------------


class Inner:
    """A behavior that may be embedded."""

    def __init__(self, name: str) -> None:
        if name not in ('Inner', 'Broken', 'Raises'):
            raise LookupError(f'no behavior is called {name!r}')
        self.name = name
        self.parameters: Mapping[str, object] = {'speed': 1.0}
        self.speed = 1.0

    def set_parameter(self, name: str, value: Any) -> None:
        if type(value) is not float:
            raise ValueError(f'{value!r} is not a float')
        self.speed = value

    def create(self) -> MachineDefinition:
        if self.name == 'Raises':
            raise ArithmeticError('on fire')
        text = """
machine:
  outcomes: [ok]
  input_keys: [place, key]
  userdata: {place: 7, own: 8, key: 9}
  states:
    Do: {state: Do, parameters: {value: %s}, transitions: {done: Strict, failed: ok}}
    Strict: {state: Strict, parameters: {first: 1, second: SLOW}, transitions: {done: ok}, autonomy: {done: high}}
"""
        return read_machine(text % self.speed, STATES if self.name == 'Inner' else {}, 'inner.yaml')


def embedding(inner: str, more: str = '') -> str:
    return f"""
behavior: {{parameters: {{speed: {{default: 2.5}}}}}}
machine:
  outcomes: [end]
  userdata: {{k: 1}}
  states:
    In:
      behavior: {{{inner}}}
      transitions: {{ok: end}}
      remapping: {{key: k}}
{more}"""


def test_an_embedded_behavior_has_its_parameters_and_the_keys_of_the_machine_around_it() -> None:
    definition = read(embedding('use: Inner, parameters: {speed: $speed}, default_keys: [place]'))
    inner = definition.children['In']
    assert isinstance(inner, MachineDefinition)
    assert (inner.input_keys, dict(inner.remap)) == (('key',), {'key': 'k'})
    assert dict(inner.defaults) == {'place': 7, 'own': 8}
    assert inner.children['Strict'].transitions['done'].autonomy == 2
    state = inner.children['Do']
    assert isinstance(state, StateDefinition) and isinstance(state.state, Do) and state.state.made_of[0] == 2.5


def table(text: str) -> list[tuple[str, str]]:
    """Return pairs of a line and the indented one below it."""
    lines = [line.strip() for line in text.strip().splitlines()]
    return list(zip(lines[::2], lines[1::2], strict=True))


EMBEDDED = """
use: Iner
    Iner | behavior of /In: no behavior is called 'Iner'
use: Inner, parameters: {sped: 1.0}
    sped | behavior of /In: Inner has no parameter 'sped'; did you mean 'speed'?
use: Inner, parameters: {speed: 1}
    1 | behavior of /In: 1 is not a float
use: Inner, parameters: {speed: $sped}
    $sped | parameters of behavior of /In: 'speed': there is no parameter 'sped'; did you mean 'speed'?
use: Inner, default_keys: [plce]
    plce | behavior of /In: 'plce' is no input key of Inner; did you mean 'place'?
use: Broken
    Broken | behavior of /In: Broken cannot be built: inner.yaml:7:17: /Do: there is no state 'Do'
use: Raises
    Raises | behavior of /In: on fire
parameters: {}
    behavior | behavior of /In: it has no use; name a behavior
use: Inner, speed: 1
    speed | behavior of /In cannot have 'speed'
"""


@pytest.mark.parametrize(('inner', 'problem'), table(EMBEDDED))
def test_a_problem_of_an_embedded_behavior_is_told_where_it_is_embedded(inner: str, problem: str) -> None:
    assert any(one.startswith(problem) for one in marked(embedding(inner)))


def test_the_machine_around_an_embedded_behavior_has_to_supply_its_keys() -> None:
    (problem,) = marked(embedding('use: Inner, default_keys: [place]').replace('{k: 1}', '{j: 1}'))
    assert problem.startswith("k | /In: reads userdata key 'key' (remapped to 'k'); no state of / writes it")
    (problem,) = marked(embedding('use: Inner, default_keys: [place, key]'))
    assert problem == "key | /In: remaps 'key', which is none of its keys"


def test_behaviors_can_only_be_embedded_where_some_are_known() -> None:
    with pytest.raises(MachineError, match=r'<text>:8:7: behavior of /In: behaviors cannot be embedded here'):
        read_machine(embedding('use: Inner'), STATES)


# -- places of problems ------------------------------------------------------------------------------------------------


WRONG = """
state: Do, parameters: {value: $lmit}
    $lmit | parameters of /A: 'value': there is no parameter 'lmit'; did you mean 'limit'?
state: Do, parameters: {value: $other}
    $other | parameters of /A: 'value': there is no parameter 'other'; write $$other for the text
state: Do, parameters: {value: {a: 1, a: 2}}
    a | parameters of /A: 'value' has 'a' twice
state: Do, parameters: {value: [{a: {b: 1, c: 1, 'b': 1}}]}
    'b' | parameters of /A: 'value' has 'b' twice
state: Do, parameters: {value: !!set {a}}
    !!set {a} | parameters of /A: 'value' is not a plain value: a mapping of the type 'set'
state: Do, parameters: {value: {[a]: 1}}
    [a] | a name in parameters of /A: 'value' is not a plain value: a list of the type 'seq'
state: Do, parameters: {mode: FST}
    FST | parameters of /A: 'FST' is none of the values of mode; did you mean 'FAST'?
state: Do, parameters: {code: abs}
    Do | /A: Do cannot be made: TypeError: it is no function
state: Strict, parameters: {first: -1, second: FAST}
    -1 | /A: Strict cannot be made: ValueError: it is negative
state: Strict, parameters: {frst: 1}
    frst | /A: Strict has no parameter 'frst'; did you mean 'first'?
state: Strict, parameters: {third: abs}
    abs | parameters of /A: third is code, which YAML does not hold; derive a state from Strict in Python
state: Strict
    Strict | /A: Strict cannot be made: TypeError:
state: Do, timeout: {after: soon}
    soon | after of timeout of /A has to be a number, not 'soon'
state: Do, timeout: {after: true}
    true | after of timeout of /A has to be a number, not True
state: Do, timeout: {after: 0}
    0 | timeout of /A: Do: a time-out has to be positive
state: Do, timeout: {after: .nan}
    .nan | after of timeout of /A has to be a number, not nan
state: Do, timeout: {outcome: x}
    timeout | timeout of /A has no after; give the time in seconds
state: Do, timeout: {afer: 1}
    afer | timeout of /A cannot have 'afer'; did you mean 'after'?
state: Do, timeout: {after: 1}
    transitions | /A: the outcome 'timeout' leads nowhere; add it to transitions
state: Do, timeout: 5
    5 | timeout of /A has to be a mapping, not '5'
state: Do, retry: {attempts: 2.5, on: [done]}
    retry | retry of /A has to have attempts (a whole number)
state: Do, retry: {attempts: 2, delay: 1}
    retry | retry of /A has to have attempts (a whole number)
state: Do, retry: {attempts: 0, on: [done]}
    retry | /A: Do: cannot be tried again: 0 attempts
state: Do, retry: {attempts: 2, on: [done, faild]}
    faild | /A: Do: cannot be tried again: 'faild' is none
state: Do, retry: {attempts: 2, on: [done], delay: -1}
    retry | /A: Do: cannot be tried again: 2 attempts, delay -1.0 s
state: Do, retry: {attempts: 2, on: [done], timeout: {after: -1}}
    -1 | timeout of retry of /A: Do: a time-out
state: Do, autonomy: {don: low}
    don | /A: autonomy of 'don', which is not an outcome of it; did you mean 'done'?
state: Do, autonomy: {done: lw}
    lw | autonomy of /A: 'lw' is none of the levels
state: Do, remapping: {kee: key}
    kee | /A: remaps 'kee', which is none of its keys
state: Do, stat: Do
    stat | /A cannot have 'stat'; did you mean 'state'?
state: Do, machine: {}
    A | /A has to have one of state, machine, concurrency, priority, behavior
machine: {states: {}, outcomes: []}
    states | /A: the machine has no states
machine: {outcomes: [done], conditions: [], states: {B: {state: Do, transitions: {done: done, failed: done}}}}
    conditions | /A (machine) cannot have 'conditions'
machine: {autonomy: max, outcomes: [x]}
    max | autonomy of /A (machine): 'max' is none of the levels
machine: {outcomes: [done], output_keys: [k], states: {B: {state: Do, transitions: {done: done, failed: done}}}}
    k | /A: the output key 'k' of the machine is written by none of its states
concurrency: {outcomes: [done], states: {B: {state: Do}}, conditions: [{outcome: don, when: {B: done}}]}
    don | /A: condition 1, of 'don', is of no outcome of the container; did you mean 'done'?
concurrency: {outcomes: [done], states: {Bee: {state: Do}}, conditions: [{outcome: done, when: {Be: done}}]}
    Be | /A: condition 1, of 'done', names 'Be', which is not a child; did you mean 'Bee'?
concurrency: {outcomes: [done], states: {B: {state: Do}}, conditions: [{outcome: done, when: {B: dne}}]}
    dne | /A: condition 1, of 'done', names 'dne', which is not an outcome of B; did you mean 'done'?
concurrency: {outcomes: [done], states: {B: {state: Do}}, conditions: [{outcome: done}]}
    {outcome: done} | a condition of /A (concurrency) has to have outcome and when
"""


@pytest.mark.parametrize(('state', 'problem'), table(WRONG))
def test_a_problem_has_the_place_of_its_key_or_value(state: str, problem: str) -> None:
    assert any(one.startswith(problem) for one in marked(only(state, 'limit: {default: 1}')))


def test_all_problems_of_a_text_are_told_at_once_and_in_its_order() -> None:
    text = """
machine:
  outcomes: [end]
  staes: {}
  states:
    A:
      state: Dou
      transitions: {done: B, failed: en}
    B:
      state: Do
      transitions: {done: end, faild: end}
      autonomy: {done: max}
    C:
      state: Do
      timeout: {after: x}
      transitions:
        done: D   # a comment
"""
    assert [(one['line'], one['column'], one['end_column'], one['node']) for one in problems(text)] == [
        (4, 3, 8, '/'),
        (7, 14, 17, '/A'),
        (8, 38, 40, '/A'),
        (11, 7, 18, '/B'),
        (11, 32, 37, '/B'),
        (12, 24, 27, '/B'),
        (13, 5, 6, '/C'),
        (15, 24, 25, '/C'),
        (17, 15, 16, '/C'),
    ]


def scalars(node: yaml.Node | None) -> Iterator[yaml.ScalarNode]:
    if isinstance(node, yaml.ScalarNode):
        yield node
    elif isinstance(node, yaml.SequenceNode):
        for one in node.value:
            yield from scalars(one)
    elif isinstance(node, yaml.MappingNode):
        for pair in node.value:
            for one in pair:
                yield from scalars(one)


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from([True, False]), st.data())
def test_a_misspelt_name_is_found_where_it_is(seed: int, flow: bool, data: st.DataObject) -> None:
    """The problem is at the name, or tells the name that is now unknown elsewhere."""
    random = Random(seed)
    node = random_machine(random, 8)
    content, machine = in_both_forms(random, node)
    try:
        define(machine)
    except MachineError:
        return
    text = yaml.dump({CONTAINERS[node.kind][0]: content}, None, Dumper, default_flow_style=flow, width=10**6)
    one = data.draw(st.sampled_from([one for one in scalars(yaml.compose(text)) if one.style is None]))
    end = one.end_mark.index
    wrong = f'{text[:end]}Q{text[end:]}'
    at = one.start_mark.line + 1, one.start_mark.column + 1
    if one.value in KEYWORDS:
        assert at in {(record['line'], record['column']) for record in problems(wrong)}
        return
    try:
        read(wrong)  # a label or an outcome that nobody else names may have any name
    except MachineError as error:
        places = {(record['line'], record['column']) for record in error.records}
        assert at in places or any(one.value in record['message'] for record in error.records)


KEYWORDS = {
    *(
        'machine',
        'concurrency',
        'priority',
        'state',
        'states',
        'outcomes',
        'conditions',
        'outcome',
        'when',
        'parameters',
    ),
    *('transitions', 'timeout', 'after', 'retry', 'attempts', 'delay', 'Any'),
}


# -- texts that are meant to do harm -----------------------------------------------------------------------------------

HEADS = [
    'behavior:\n parameters:\n  p:\n   default:\n    {}\nmachine: {{}}',
    'machine:\n states:\n  A:\n   state: Do\n   parameters:\n    {}',
]


@pytest.mark.parametrize('text', HOSTILE_YAML.values(), ids=list(HOSTILE_YAML))
@pytest.mark.parametrize('around', HEADS, ids=['as a default', 'as parameters'])
def test_a_hostile_value_is_refused_in_time(around: str, text: str) -> None:
    began = time.process_time()
    assert problems(around.format(text.replace('\n', '\n    ')))
    assert time.process_time() - began < 10.0


def test_a_text_that_cannot_be_encoded_is_refused_at_its_place() -> None:
    text = only("state: Do, parameters: {value: '\ud800'}")
    (record,) = problems(text)
    assert (record['line'], record['column']) == (4, 41)
    assert record['message'] == "no YAML: '\\ud800' is half of a character"


def many(count: int, text: str) -> str:
    return ', '.join(text.replace('#', str(number)) for number in range(count))


@pytest.mark.parametrize(
    'text',
    [
        'x' * 10_000_000,
        'machine: {states: {' + many(40_000, 'A#: {state: X}') + '}}',
        'machine: {outcomes: [end], states: {' + many(5000, 'A#: {state: Do, transitions: {done: B#}}') + '}}',
        'behavior: {parameters: {' + many(20_000, 'p#: {default: $q#}') + '}}\nmachine: {}',
        'machine: {states: {A: {state: Do, parameters: {value: [' + many(80_000, '$q#') + ']}}}}',
        'machine: {outcomes: [' + many(100_000, 'o#') + '], states: {}}',
        'machine: {' * 99 + '}' * 99,
        "machine: {outcomes: ['" + 'y' * 900_000 + "'], states: {A: {state: '" + 'z' * 90_000 + "'}}}",
    ],
    ids=['10 MB', 'states', 'targets', 'defaults', 'references', 'outcomes', 'deep', 'long names'],
)
def test_a_large_text_is_refused_in_time_with_a_bounded_answer(text: str) -> None:
    began = time.process_time()
    found = problems(text)
    assert time.process_time() - began < 30.0
    assert len(found) <= 101
    assert sum(len(one['message']) for one in found) < 2_000_000
    if len(found) == 101:
        assert found[-1]['message'] == 'there are too many problems to show; mend these first'
    if len(text) > MAX_CHARACTERS:
        assert found[0]['message'] == f'the text has {len(text)} characters; at most {MAX_CHARACTERS} are read'

# SPDX-License-Identifier: BSD-3-Clause
"""The forms in which a machine is written: FlexBE's, children given at once, and YAML. All give the same definition."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import pytest

from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.authoring.machine import ConcurrencyContainer, OperatableStateMachine, PriorityContainer
from flexbt_core.state_machine.authoring.wrappers import with_retry
from flexbt_core.state_machine.authoring.yaml_form import read_machine
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.definition import Child, MachineDefinition, StateDefinition, child_path
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import MachineError
from flexbt_testing.hostile_yaml import HOSTILE_YAML
from flexbt_testing.state_machines.bench import Scripted

TEXT = """
machine:
  outcomes: [finished, off]
  output_keys: [result]
  userdata: {place: dock, limits: [1, 2.5, true], nothing: null}
  states:
    Find:
      state: Find
      parameters: {tries: 3}
      transitions: {done: Both, off: off}
      autonomy: {done: low, off: 0}
    Both:
      concurrency:
        outcomes: [done, failed]
        input_keys: [place]
        output_keys: [result]
        conditions:
          - {outcome: done, when: {Go: done, Watch: off}}
          - {outcome: failed, when: {Go: off}}
          - {outcome: failed, when: {Watch: done}}
        states:
          Go: {state: Go, remapping: {goal: place, took: result}}
          Watch: {state: Find, parameters: {tries: 1}, autonomy: {done: full}}
      transitions: {done: finished, failed: Rescue}
      autonomy: {failed: HIGH}
    Rescue:
      priority:
        outcomes: [back]
        states:
          Turn:
            state: Find
            parameters: {tries: 2}
            retry: {attempts: 3, on: [off], delay: 2}
            transitions: {done: back, off: back}
      transitions: {back: Both}
"""


class Find(Scripted):
    def __init__(self, tries: int) -> None:
        super().__init__('done', 'off')
        self.tries = tries


class Go(Scripted):
    def __init__(self) -> None:
        super().__init__('done', 'off', input_keys=['goal'], output_keys=['took'])


STATES = {'Find': Find, 'Go': Go}

CONDITIONS = [
    ('done', [('Go', 'done'), ('Watch', 'off')]),
    ('failed', [('Go', 'off')]),
    ('failed', [('Watch', 'done')]),
]
DATA: Mapping[str, Any] = {'place': 'dock', 'limits': [1, 2.5, True], 'nothing': None}


def turn() -> EventState:
    return with_retry(Find(2), 3, ['off'], delay=2.0)


def as_flexbe() -> OperatableStateMachine:
    both = ConcurrencyContainer(['done', 'failed'], ['place'], ['result'], conditions=CONDITIONS)
    with both:
        OperatableStateMachine.add('Go', Go(), remapping={'goal': 'place', 'took': 'result'})
        ConcurrencyContainer.add('Watch', Find(1), autonomy={'done': Autonomy.Full})
    rescue = PriorityContainer(outcomes=['back'])
    with rescue:
        PriorityContainer.add('Turn', turn(), transitions={'done': 'back', 'off': 'back'})
    made = OperatableStateMachine(outcomes=['finished', 'off'], output_keys=['result'])
    for key, value in DATA.items():
        made.userdata[key] = value
    with made:
        OperatableStateMachine.add('Find', Find(3), {'done': 'Both', 'off': 'off'}, {'done': Autonomy.Low, 'off': 0})
        OperatableStateMachine.add('Both', both, {'done': 'finished', 'failed': 'Rescue'}, {'failed': Autonomy.High})
        OperatableStateMachine.add('Rescue', rescue, {'back': 'Both'})
    return made


def at_once() -> OperatableStateMachine:
    both = ConcurrencyContainer(
        outcomes=['done', 'failed'],
        input_keys=['place'],
        output_keys=['result'],
        conditions=CONDITIONS,
        children=[
            Child('Go', Go(), remapping={'goal': 'place', 'took': 'result'}),
            Child('Watch', Find(1), autonomy={'done': Autonomy.Full}),
        ],
    )
    rescue = PriorityContainer(
        outcomes=['back'],
        children=[Child('Turn', turn(), {'done': 'back', 'off': 'back'})],
    )
    return OperatableStateMachine(
        outcomes=['finished', 'off'],
        output_keys=['result'],
        userdata=DATA,
        children=[
            Child('Find', Find(3), {'done': 'Both', 'off': 'off'}, {'done': Autonomy.Low, 'off': Autonomy.Off}),
            Child('Both', both, {'done': 'finished', 'failed': 'Rescue'}, {'failed': Autonomy.High}),
            Child('Rescue', rescue, {'back': 'Both'}),
        ],
    )


def contents(definition: MachineDefinition) -> list[Any]:
    """Return all of a definition, with the states by what they were made of."""
    rows: list[Any] = []
    for node, entry in zip(definition.nodes(), definition.structure(), strict=True):
        if isinstance(node, StateDefinition):
            own: Any = type(node.state), getattr(node.state, 'tries', None), node.state.input_keys
        else:
            own = node.input_keys, node.output_keys, dict(node.defaults), node.initial, node.conditions
        rows.append((entry, dict(node.transitions), dict(node.remap), own))
    return rows


def test_all_forms_give_the_same_definition() -> None:
    expected = contents(define(as_flexbe()))
    assert contents(define(at_once())) == expected
    assert contents(read_machine(TEXT, STATES)) == expected
    assert len(expected) == 7


def test_a_path_has_the_labels_as_they_are() -> None:
    assert [child_path(parent, 'LID') for parent in ('/', '/BOX', '/BOX/X')] == ['/LID', '/BOX/LID', '/BOX/X/LID']


def test_a_definition_cannot_be_changed() -> None:
    definition = read_machine(TEXT, STATES)
    for node in definition.nodes():
        mappings: list[Any] = [node.transitions, node.remap]
        if isinstance(node, MachineDefinition):
            mappings += [node.children, node.defaults]
        for mapping in mappings:
            with pytest.raises(TypeError):
                mapping['x'] = None
        with pytest.raises(AttributeError):
            node.label = 'x'  # type: ignore[misc]


@pytest.mark.parametrize(
    ('before', 'after', 'problem'),
    [
        ('done: Both', 'done: Bth', "m.yaml:10:27: /Find: the outcome 'done' leads to 'Bth', which is neither"),
        ('state: Go,', 'state: Goo,', "m.yaml:22:23: /Both/Go: there is no state 'Goo'; did you mean 'Go'?"),
        ('tries: 3', 'trys: 3', "m.yaml:9:20: /Find: Find has no parameter 'trys'; did you mean 'tries'?"),
        ('done: low', 'done: lo', "m.yaml:11:24: autonomy of /Find: 'lo' is none of the levels off, low, high, full"),
        (
            'on: [off], delay',
            'on: [of], delay',
            "m.yaml:33:39: /Rescue/Turn: Find: cannot be tried again: 'of' is none",
        ),
        (
            'attempts: 3',
            'attempts: many',
            "m.yaml:33:31: attempts of retry of /Rescue/Turn has to be a number, not 'many'",
        ),
        ('delay: 2', 'dely: 2', "retry of /Rescue/Turn cannot have 'dely'; did you mean 'delay'?"),
        ('priority:', 'prioriti:', "m.yaml:27:7: /Rescue cannot have 'prioriti'; did you mean 'priority'?"),
        (
            'input_keys:',
            'inputkeys:',
            "m.yaml:15:9: /Both (concurrency) cannot have 'inputkeys'; did you mean 'input_keys'?",
        ),
        ('parameters: {tries: 3}', 'param: {}', "m.yaml:9:7: /Find cannot have 'param'; did you mean 'parameters'?"),
        ('outcomes: [back]', 'outcomes: back', "outcomes of /Rescue (priority) has to be a list, not 'back'"),
        (
            '      transitions: {back: Both}',
            '      state: Find',
            'm.yaml:26:5: /Rescue has to have one of state, machine,',
        ),
        ('  output_keys: [result]', '  outcomes: []', "m.yaml:4:3: / (machine) has 'outcomes' twice"),
        ('place: dock', 'place: !!python/name:os.system x', "userdata of / (machine): 'place' is not a plain value"),
        ('[1, 2.5, true]', '[1, 2.5', 'm.yaml:5:57: no YAML: '),
        (
            'limits: [1, 2.5, true]',
            'limits: &a [1], more: *a',
            'm.yaml:5:49: aliases (*a) are not supported; write it out',
        ),
        (TEXT, '', 'm.yaml:1:1: the text is empty'),
        (TEXT, '[1]', 'm.yaml:1:1: the text has to be a mapping, not a list'),
        (TEXT, 'machine: {}', 'm.yaml:1:1: /: the machine has no states'),
        ('when: {Go: off}', 'whn: {Go: off}', "m.yaml:19:31: condition of /Both (concurrency) cannot have 'whn'"),
        ('when: {Go: off}', 'when: {Go: done}', "/Both: when its children have ended Go by 'off', Watch by 'off'"),
        ('goal: place', 'goal: plce', "/Both/Go: reads userdata key 'goal' (remapped to 'plce'); no state of /Both"),
    ],
)
def test_a_problem_of_a_text_is_named_with_its_line(before: str, after: str, problem: str) -> None:
    text = TEXT.replace(before, after, 1)
    assert text != TEXT
    with pytest.raises(MachineError) as caught:
        read_machine(text, STATES, 'm.yaml')
    assert any(problem in one for one in caught.value.problems), caught.value.problems
    assert all(one.startswith('m.yaml:') for one in caught.value.problems)


@pytest.mark.parametrize('text', [*HOSTILE_YAML.values(), 'machine: ' + '{states: {A: {machine: ' * 300])
@pytest.mark.parametrize('around', ['{}', 'machine:\n userdata:\n  key:\n   {}'], ids=['alone', 'as userdata'])
def test_texts_that_are_meant_to_do_harm_are_refused_in_time(around: str, text: str) -> None:
    began = time.process_time()
    with pytest.raises(MachineError) as caught:
        read_machine(around.format(text.replace('\n', '\n   ')), STATES)
    assert time.process_time() - began < 10.0
    assert len(str(caught.value)) < 1000

# SPDX-License-Identifier: BSD-3-Clause
"""States that are copied as text and pasted into the same machine, a machine inside, and another file."""

from __future__ import annotations

import re

import pytest
from test_behavior_heads import FLEXBE, LINE

from flexbt_studio.documents.python_document import PythonDocument
from flexbt_studio.documents.text import applied
from flexbt_studio.documents.yaml_document import YamlDocument
from flexbt_studio.errors import GestureError

ROWS = """\
machine:
  outcomes: [finished]
  states:
    # first
    Wait:  # how long?
      state: WaitState
      parameters: {wait_time: 1.0}
      transitions: {done: Wait, failed: finished}
    Inner:
      machine:
          outcomes: [done]
          states: {}
      transitions:
        done: finished
"""
CHILD = """\
machine = OperatableStateMachine(
    outcomes=['finished'],
    children=[
        # first
        Child('Wait', WaitState(1.0), {'done': 'Wait', 'failed': 'finished'}),
        Child(
            'Inner',
            OperatableStateMachine(['done'], children=[Child('A', WaitState(1.0), {'done': 'done'})]),
            {'done': 'finished'},
        ),
    ],
)
"""
POSITIONED = FLEXBE.replace("            machine.add('Wait'", "            # x:30 y:40\n            machine.add('Wait'")
CASES: dict[str, tuple[type[YamlDocument | PythonDocument], str, str | None]] = {
    'rows': (YamlDocument, ROWS, '/Inner'),
    'commented out': (YamlDocument, ROWS.replace('      state: W', '# retry: 1\n      state: W'), None),
    'windows': (YamlDocument, ROWS.replace('\n', '\r\n'), '/Inner'),
    'child': (PythonDocument, CHILD, '/Inner'),
    'with': (PythonDocument, LINE, None),
    'flexbe': (PythonDocument, POSITIONED, None),
}


def pasted(document: YamlDocument | PythonDocument, parent: str, text: str) -> YamlDocument | PythonDocument:
    made = type(document)(applied(document.text, document.gesture('paste_state', {'parent': parent, 'text': text})))
    assert not made.problems
    return made


@pytest.mark.parametrize('case', CASES)
def test_a_copy_is_what_was_copied_under_another_label(case: str) -> None:
    language, text, inner = CASES[case]
    document = language(text)
    clip = document.clip('/Wait')
    assert '\r' not in clip and clip[0] not in ' \t'
    made = pasted(document, '/', clip)
    assert made.text.count('\r') == (made.text.count('\n') if '\r' in text else 0)
    assert list(made.states) == [*document.states, '/Wait2'] and made.text.startswith(text[: text.index('Wait')])
    views = {one['path']: one for one in made.view()['states']}
    old, new = views['/Wait'], views['/Wait2']
    assert [old[key] for key in ('type', 'kind')] == [new[key] for key in ('type', 'kind')]
    assert [one['text'] for one in old['parameters']] == [one['text'] for one in new['parameters']]
    targets = {one['outcome']: one['target'].replace('Wait', 'Wait2') for one in old['transitions']}
    assert {one['outcome']: one['target'] for one in new['transitions']} == targets
    assert list(pasted(made, '/', clip).states)[-1] == '/Wait3'
    if inner:
        assert f'{inner}/Wait' in pasted(document, inner, clip).states


@pytest.mark.parametrize(
    ('language', 'text', 'written', 'value'),
    [
        (YamlDocument, ROWS, '|\n          one  \n          two', 'one  \ntwo\n'),
        (YamlDocument, ROWS, '"a\tb"', 'a\tb'),
        (PythonDocument, CHILD, '"""one\n  two\n      three"""', 'one\n  two\n      three'),
        (PythonDocument, LINE, '"""one\n  two\n      three"""', 'one\n  two\n      three'),
    ],
)
@pytest.mark.parametrize('line_break', ['\n', '\r\n'])
def test_a_copy_has_the_same_texts(
    language: type[YamlDocument | PythonDocument], text: str, written: str, value: str, line_break: str
) -> None:
    text = text.replace('{wait_time: 1.0}', f'\n        wait_time: {written}')
    text = re.sub(r'WaitState\((1.0|self.seconds)\)', lambda _: f'WaitState({written})', text, count=1)
    document = language(text.replace('\n', line_break))
    made = pasted(document, '/', document.clip('/Wait'))
    values = [one['value'] for state in made.view()['states'] for one in state['parameters'] if 'Wait' in state['path']]
    assert values == [value, value] and made.text.count('\r') == made.text.count('\n') * (line_break != '\n')


def test_what_is_no_state_is_refused() -> None:
    for document in (YamlDocument(ROWS), PythonDocument(CHILD), PythonDocument(LINE)):
        for text in (
            '',
            'x',
            'a: 1',
            '- 1',
            'Wait:',
            'f()',
            'import os',
            '<Sequence/>',
            '{',
            'x' * 10_000_000,
            'A:\n  machine: {',
        ):
            with pytest.raises(GestureError):
                document.gesture('paste_state', {'parent': '/', 'text': text})
        with pytest.raises(GestureError):
            document.gesture('paste_state', {'parent': '/Wait', 'text': document.clip('/Wait')})


def test_a_machine_with_states_is_pasted_whole() -> None:
    document = YamlDocument(ROWS)
    whole = pasted(document, '/Inner', document.clip('/Inner'))
    assert '/Inner/Inner' in whole.states and '# first' in document.clip('/Wait')
    assert (
        "Child('A'"
        in pasted(PythonDocument(CHILD), '/', PythonDocument(CHILD).clip('/Inner')).text.partition("'Inner2'")[2]
    )


def test_a_text_of_several_lines_keeps_the_form_of_its_block() -> None:
    text = ROWS.replace('{wait_time: 1.0}', '\n        wait_time: |\n          one\n\n          two\n        other: 1')
    document = YamlDocument(text)
    for new in ('one\ntwo', 'one\n\n  two: [\nthree\n', ' one\ntwo', 'one\ntwo\n\n', 'one', 'a\x01\nb'):
        edits = document.gesture('set_parameter', {'state': '/Wait', 'name': 'wait_time', 'text': new})
        made = YamlDocument(applied(text, edits))
        values = {one['name']: one['value'] for one in made.view()['states'][1]['parameters']}
        assert values == {'wait_time': new, 'other': 1}, made.text

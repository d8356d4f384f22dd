# SPDX-License-Identifier: BSD-3-Clause
"""YAML documents: each gesture gives the model that was meant, and touches nothing else.

The expected model is edited as plain data, which PyYAML reads, independent of the document.
"""

from __future__ import annotations

import contextlib
import copy
import inspect
import itertools
import random
from collections import Counter
from collections.abc import Iterator
from typing import Any

import pytest
import yaml
from machine_texts import ANCHORS, BEHAVIOR, PLAIN, TEXTS

from flexbt_studio.documents.text import applied, inverse
from flexbt_studio.documents.yaml_document import YamlDocument
from flexbt_studio.errors import GestureError

Data = Any
CONTAINERS = ('machine', 'concurrency', 'priority')
NAMES = ['Next', 'yes', 'off', '1', '1:30', 'a b', "it's", 'x: y', '# x', 'null', '[x', 'é😀', '-', '2026-01-01']


def data_of(text: str) -> Data:
    """Return the data of a text, with all scalars as they are written."""
    return yaml.load(text.removeprefix('\ufeff'), yaml.CBaseLoader)  # noqa: S506


def ordered(data: Data) -> Data:
    """Return data in a form whose comparison respects the order of entries."""
    if isinstance(data, dict):
        return [(key, ordered(value)) for key, value in data.items()]
    return [ordered(one) for one in data] if isinstance(data, list) else data


def content_of(data: Data, path: str) -> dict[str, Any]:
    """Return the content of the container with a path."""
    content = next(data[kind] for kind in CONTAINERS if kind in data)
    for label in path.strip('/').split('/') if path != '/' else []:
        state = content['states'][label]
        content = next(state[kind] for kind in CONTAINERS if kind in state)
    return content


def state_of(data: Data, path: str) -> dict[str, Any]:
    above, _, label = path.rpartition('/')
    return content_of(data, above or '/')['states'][label]


def renamed(entries: dict[str, Any], old: str, new: str) -> None:
    """Rename a key in place, where it is."""
    for key, value in list(entries.items()):
        del entries[key]
        entries[new if key == old else key] = value


def insert(entries: dict[str, Any], key: str, value: Any, order: tuple[str, ...]) -> None:
    """Insert an entry behind those that come before it by ``order``."""
    before = [n for n, name in enumerate(entries) if name in order and order.index(name) < order.index(key)]
    items = list(entries.items())
    items.insert(before[-1] + 1 if before else 0, (key, value))
    entries.clear()
    entries.update(items)


ORDER = ('state', *CONTAINERS, 'behavior', 'parameters', 'timeout', 'retry', 'transitions', 'autonomy', 'remapping')


def put(state: dict[str, Any], table: str, key: str, value: Any) -> None:
    if value is None:
        del state[table][key]
        if not state[table]:
            del state[table]
    elif table in state:
        state[table][key] = value
    else:
        insert(state, table, {key: value}, ORDER)


class Gestures:
    """Random gestures that apply to a document, with the data that each has to give."""

    def __init__(self, text: str, seed: int) -> None:
        self.text = text
        self.random = random.Random(seed)
        self.document = YamlDocument(text)
        self.states = self.document.view()['states']
        self.data = data_of(text)

    def all(self) -> Iterator[tuple[str, dict[str, Any], Data]]:
        for state in self.states:
            if state['parent'] is not None:
                yield from self._of_state(state)
            if state['kind'] in CONTAINERS:
                yield from self._of_container(state)

    def _children(self, path: str) -> list[dict[str, Any]]:
        return [state for state in self.states if state['parent'] == path]

    def _of_state(self, state: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any], Data]]:
        path, parent = state['path'], next(one for one in self.states if one['path'] == state['parent'])
        siblings = [one['label'] for one in self._children(parent['path'])]
        targets = [*parent['outcomes'], *([] if parent['kind'] == 'concurrency' else siblings)]
        choose = self.random.choice
        own = state['outcomes'] if state['kind'] in CONTAINERS else ['done', *NAMES]
        for table, gesture, names, values in (
            ('transitions', 'set_target', ('outcome', 'target'), targets),
            ('autonomy', 'set_autonomy', ('outcome', 'level'), ['off', 'low', 'high', 'full']),
            ('remapping', 'set_remapping', ('key', 'name'), NAMES),
        ):
            known = list(state_of(self.data, path).get(table, {}))
            for key in {choose(own), *known}:
                for value in (choose(values), *([None] if key in known else [])):
                    data = copy.deepcopy(self.data)
                    put(state_of(data, path), table, key, value)
                    yield gesture, {'state': path, names[0]: key, names[1]: value}, data
        if state['kind'] == 'state':
            yield from self._parameters(path)
        new = choose([name for name in NAMES if name not in (*siblings, *parent['outcomes'])])
        yield 'rename_state', {'state': path, 'label': new}, self._renaming(path, parent, new)
        if len(siblings) > 1:
            instead = choose([one for one in targets if one != state['label']] or [None])
            yield 'remove_state', {'state': path, 'instead': instead}, self._removal(path, parent, instead)
        index = self.random.randrange(len(siblings))
        data = copy.deepcopy(self.data)
        states = content_of(data, parent['path'])['states']
        items = [(key, value) for key, value in states.items() if key != state['label']]
        items.insert(index, (state['label'], states[state['label']]))
        content_of(data, parent['path'])['states'] = dict(items)
        yield 'move_state', {'state': path, 'index': index}, data

    def _parameters(self, path: str) -> Iterator[tuple[str, dict[str, Any], Data]]:
        known = state_of(self.data, path).get('parameters') or {}
        for name in (*known, 'new'):
            for text, value in (('2.5', '2.5'), ('yes', 'yes'), ('[a, yes, {b: 1}]', ['a', 'yes', {'b': '1'}]),
                                ('Is it ok: yes?', 'Is it ok: yes?'), ('a, b', 'a, b'), ('$tree', '$tree'), ('', ''),
                                ('two\nlines # x', 'two\nlines # x'), ('two\x85lines', 'two\x85lines'),
                                ("'quoted'", 'quoted')):  # fmt: skip
                data = copy.deepcopy(self.data)
                put(state_of(data, path), 'parameters', name, value)
                yield 'set_parameter', {'state': path, 'name': name, 'text': text}, data
        for kind, fields in (
            ('retry', {'attempts': 3, 'on': ['off', 'failed'], 'delay': 0.5}),
            ('timeout', {'after': '$limit', 'outcome': 'off'}),
        ):
            data = copy.deepcopy(self.data)
            written = {key: [*value] if isinstance(value, list) else str(value) for key, value in fields.items()}
            state = state_of(data, path)
            if kind in state:
                old = state[kind]
                is_kept = set(old) <= set(written) or set(old) > set(written)  # its entries stay, with their comments
                state[kind] = {
                    key: written[key] for key in ({**old, **written} if is_kept else written) if key in written
                }
            else:
                insert(state, kind, written, ORDER)
            yield 'set_wrapper', {'state': path, 'kind': kind, 'fields': fields}, data
            if kind in state_of(self.data, path):
                data = copy.deepcopy(self.data)
                del state_of(data, path)[kind]
                yield 'set_wrapper', {'state': path, 'kind': kind, 'fields': None}, data

    def _renaming(self, path: str, parent: dict[str, Any], new: str) -> Data:
        data, label = copy.deepcopy(self.data), path.rpartition('/')[2]
        content = content_of(data, parent['path'])
        renamed(content['states'], label, new)
        for one in content['states'].values():
            ways = one.get('transitions', {})
            ways.update({key: new for key, target in ways.items() if target == label})
        for condition in content.get('conditions', []):
            renamed(condition['when'], label, new)
        return data

    def _removal(self, path: str, parent: dict[str, Any], instead: str | None) -> Data:
        data, label = copy.deepcopy(self.data), path.rpartition('/')[2]
        content = content_of(data, parent['path'])
        del content['states'][label]
        for one in content['states'].values():
            ways = one.get('transitions', {})
            ways.update({key: instead for key, target in ways.items() if target == label})
        for condition in content.get('conditions', []):
            condition['when'].pop(label, None)
        if 'conditions' in content:
            content['conditions'] = [one for one in content['conditions'] if one['when']]
        return data

    def _of_container(self, state: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any], Data]]:
        path = state['path']
        children = self._children(path)
        targets = [*state['outcomes'], *([] if state['kind'] == 'concurrency' else [one['label'] for one in children])]
        new = self.random.choice(
            [name for name in NAMES if name not in (*targets, *(one['label'] for one in children))]
        )
        data = copy.deepcopy(self.data)
        target = self.random.choice(targets)
        made = {
            'state': 'Wait',
            'parameters': {'time': '2.0', 'list': ['1', 'off']},
            'transitions': {'done': target, 'no': target},
        }
        content_of(data, path)['states'] = {**(content_of(data, path)['states'] or {}), new: made}
        arguments = {'parameters': {'time': 2.0, 'list': '[1, off]'}, 'transitions': {'done': target, 'no': target}}
        yield 'add_state', {'parent': path, 'label': new, 'type': 'Wait', **arguments}, data
        data = copy.deepcopy(self.data)
        content_of(data, path)['outcomes'].append(new)
        yield 'add_outcome', {'container': path, 'outcome': new}, data
        for outcome in state['outcomes']:
            data = copy.deepcopy(self.data)
            content = content_of(data, path)
            content['outcomes'] = [new if one == outcome else one for one in content['outcomes']]
            for one in content['states'].values():
                ways = one.get('transitions', {})
                ways.update({key: new for key, target in ways.items() if target == outcome})
            for condition in content.get('conditions', []):
                condition['outcome'] = new if condition['outcome'] == outcome else condition['outcome']
            if path != '/':
                for table in ('transitions', 'autonomy'):
                    renamed(state_of(data, path).get(table, {}), outcome, new)
            yield 'rename_outcome', {'container': path, 'outcome': outcome, 'name': new}, data
        for text, value in (('[1, no]', ['1', 'no']), ('a', 'a')):
            data = copy.deepcopy(self.data)
            content = content_of(data, path)
            order = ('outcomes', 'input_keys', 'output_keys', 'io_keys', 'autonomy', 'userdata')
            if 'userdata' in content:
                content['userdata'][new] = value
            else:
                insert(content, 'userdata', {new: value}, order)
            yield 'set_userdata', {'container': path, 'key': new, 'text': text}, data


def comments_of(text: str) -> list[str]:
    return sorted(text[start:end] for start, end in YamlDocument(text).comments.items())


def check(text: str, name: str, arguments: dict[str, Any], expected: Data) -> str:
    """Carry out a gesture, check all that has to hold, and return the new text."""
    edits = YamlDocument(text).gesture(name, arguments)
    after = applied(text, edits)
    assert ordered(data_of(after)) == ordered(expected), (name, arguments, after)
    assert applied(after, inverse(text, edits)) == text
    for kind in ('\r\n', '\n'):
        assert (kind in after.replace('\r\n', '' if kind == '\n' else '\r\n')) <= (
            kind in text.replace('\r\n', '' if kind == '\n' else '\r\n')
        )
    if name != 'remove_state' and None not in arguments.values():
        kept = comments_of(after)
        assert not Counter(comments_of(text)) - Counter(kept), (name, arguments, after)
    if name.startswith('set_') and name != 'set_initial':
        before, now = text.splitlines(), after.splitlines()
        same = sum(1 for _ in itertools.takewhile(lambda pair: pair[0] == pair[1], zip(before, now, strict=False)))
        rest = sum(
            1 for _ in itertools.takewhile(lambda pair: pair[0] == pair[1], zip(before[::-1], now[::-1], strict=False))
        )
        old = data_of(text)
        assert len(before) - same - rest <= 6 or old == expected, (name, arguments, after)
    return after


@pytest.mark.parametrize('style', TEXTS)
def test_a_text_is_read_and_its_spans_are_true(style: str) -> None:
    document = YamlDocument(TEXTS[style])
    assert document.problems == []
    view = document.view()
    assert document.text == TEXTS[style]
    for state in view['states']:
        if state['parent'] is not None:
            start, end = state['label_span']
            assert data_of(document.text[start:end]) == state['label']
            content = content_of(data_of(document.text), state['parent'])
            assert state['initial'] == (state['label'] == next(iter(content['states'])) and 'conditions' not in content)
        for one in state['transitions']:
            assert data_of('{' + document.text[slice(*one['span'])] + '}') == {one['outcome']: one['target']}
            assert data_of(document.text[slice(*one['target_span'])]) == one['target']


@pytest.mark.parametrize('style', TEXTS)
def test_gestures_give_the_meant_model_and_nothing_else(style: str) -> None:
    found = list(Gestures(TEXTS[style], 1).all())
    assert len(found) >= 5
    chosen = random.Random(2).sample(found, min(90 if style in ('plain', 'behavior') else 30, len(found)))
    for name, arguments, expected in chosen:
        check(TEXTS[style], name, arguments, expected)


@pytest.mark.parametrize('style', [style for style in TEXTS if style != 'empty'])
def test_many_gestures_one_after_the_other(style: str) -> None:
    text = TEXTS[style]
    for seed in range(8):
        gestures = [one for one in Gestures(text, seed).all() if one[0] not in ('remove_state',)]
        name, arguments, expected = random.Random(seed).choice(gestures)
        text = check(text, name, arguments, expected)


def done(before: str, gesture: str, /, **arguments: Any) -> str:
    return applied(before, YamlDocument(before).gesture(gesture, arguments))


def test_a_group_and_its_parts_are_the_same_machine() -> None:
    grouped = done(PLAIN, 'group', states=['/Both', '/Rescue'], label='Work', keys={'input_keys': ['place']})
    state = data_of(grouped)['machine']['states']['Work']
    assert state['transitions'] == {'finished': 'finished'}
    assert state['machine']['outcomes'] == ['finished'] and state['machine']['input_keys'] == ['place']
    assert data_of(grouped)['machine']['states']['Find']['transitions'] == {'done': 'Work', 'off': 'off'}
    old = data_of(PLAIN)['machine']['states']
    assert state['machine']['states'] == {label: old[label] for label in ('Both', 'Rescue')}
    assert done(grouped, 'ungroup', state='/Work') == PLAIN
    with pytest.raises(GestureError, match='several are entered'):
        done(PLAIN, 'group', states=['/Find', '/Rescue'], label='Work')


@pytest.mark.parametrize('style', ['behavior', 'crlf', 'no_line_break', 'bom', 'tabs'])
def test_grouping_keeps_comments_and_ungrouping_gives_the_bytes_back(style: str) -> None:
    text = TEXTS[style]
    states = [one for one in YamlDocument(text).view()['states'] if one['parent'] == '/']
    tried = 0
    for many in range(1, len(states) + 1):
        for chosen in itertools.combinations(states, many):
            try:
                grouped = done(text, 'group', states=[one['path'] for one in chosen], label='Group')
            except GestureError:
                continue
            assert comments_of(grouped) == comments_of(text)
            inner, outer = data_of(grouped)['machine']['states'], data_of(text)['machine']['states']
            for one in chosen:
                assert inner['Group']['machine']['states'][one['label']] == outer[one['label']]
            places = [states.index(one) for one in chosen]
            back = done(grouped, 'ungroup', state='/Group')
            if places == list(range(places[0], places[-1] + 1)):
                assert back.rstrip() == text.rstrip()
            tried += 1
    assert tried


LEVELS = """\
machine:
  outcomes: [done]
  autonomy: high
  states:
    First:
      state: WaitState
      timeout: {after: $limit, outcome: late}
      transitions: {done: Second, late: done}
    Second:
      state: WaitState
      transitions: {done: done}
"""


def test_a_group_keeps_the_autonomy_of_its_states() -> None:
    grouped = done(LEVELS, 'group', states=['/First'], label='Group')
    group = data_of(grouped)['machine']['states']['Group']
    assert group['machine']['autonomy'] == 'high' and group['autonomy'] == {'Second': 'off', 'done': 'off'}
    assert done(grouped, 'ungroup', state='/Group') == LEVELS
    with pytest.raises(GestureError, match='autonomy of the states in /Group is full, and around it high'):
        done(grouped.replace('    autonomy: high', '    autonomy: full'), 'ungroup', state='/Group')


REFERRING = """\
behavior:
  description: $limit
  parameters: {limit: {default: 1.0}, limits: {default: [1.0]}}
machine:
  outcomes: [$limit]
  userdata: {a: ['$limit', "$limit", $$limit, $limits, {$limit: $limit}]}
  states:
    $limit:
      state: WaitState
      parameters: {wait_time: $limit}
      retry: {attempts: 2, on: [done], timeout: {after: $limit}}
      transitions: {done: $limit}
"""


@pytest.mark.parametrize('new', ['speed', 'no', 'ärger'])
def test_a_parameter_is_renamed_where_it_is_referred_to_and_where_texts_are_values(new: str) -> None:
    text = done(REFERRING, 'rename_behavior_parameter', name='limit', new=new)
    values = ['{limit: ', "'$limit'", '"$limit"', '$limit: $limit', 'time: $limit', 'after: $limit']
    expected = REFERRING
    for old in values:
        new_key = "'no'" if (new, old) == ('no', '{limit: ') else new
        expected = expected.replace(old, old[: old.rindex('limit')] + new_key + old[old.rindex('limit') + 5 :])
    assert text == expected
    with pytest.raises(GestureError, match='cannot be the name'):
        done(REFERRING, 'rename_behavior_parameter', name='limit', new='class')


def test_a_field_of_a_wrapper_is_changed_beside_a_reference() -> None:
    fields = dict(YamlDocument(LEVELS).states['/First'].wrappers[0])
    del fields['kind'], fields['span']
    text = done(LEVELS, 'set_wrapper', state='/First', kind='timeout', fields={**fields, 'outcome': 'done'})
    assert text == LEVELS.replace('outcome: late', 'outcome: done')


def test_a_field_is_added_and_removed_beside_the_others_and_their_comments() -> None:
    text = PLAIN.replace(
        'machine:\n', 'behavior:\n  parameters:\n    limit:\n      default: 3.0   # measured\nmachine:\n', 1
    )
    state = next(one['path'] for one in YamlDocument(text).view()['states'] if one['kind'] == 'state')
    text = done(text, 'set_wrapper', state=state, kind='retry', fields={'attempts': 3})
    blank = text[: text.index('retry:')].rpartition('\n')[2]
    text = text.replace('retry: {attempts: 3}', f"retry:\n{blank}  attempts: 3   # it slips\n{blank}  'on': [failed]")
    for fields in ({'attempts': 3, 'on': ['failed'], 'delay': 0.5}, {'attempts': 3, 'on': ['failed']}):
        before = text
        text = done(text, 'set_wrapper', state=state, kind='retry', fields=fields)
        row = f'{blank}  delay: 0.5\n'
        assert text.replace(row, '') == before.replace(row, '') and (row in text) == ('delay' in fields)
    after = done(text, 'set_behavior_parameter', name='limit', fields={'default': 3.0, 'unit': 's'})
    assert after == text.replace('  # measured\n', '  # measured\n      unit: s\n')


def test_outcomes_are_removed_with_what_leads_to_them() -> None:
    after = data_of(done(PLAIN, 'remove_outcome', container='/Both', outcome='failed', instead='done'))
    both = after['machine']['states']['Both']
    assert both['concurrency']['outcomes'] == ['done'] and both['transitions'] == {'done': 'finished'}
    assert {one['outcome'] for one in both['concurrency']['conditions']} == {'done'} and 'autonomy' not in both
    with pytest.raises(GestureError, match='name a replacement'):
        done(PLAIN, 'remove_outcome', container='/Both', outcome='failed')


def test_a_list_that_loses_all_its_rows_is_an_empty_list() -> None:
    text = done(TEXTS['columns'], 'remove_state', state='/B')
    assert data_of(text)['concurrency']['conditions'] == [{'outcome': 'done', 'when': {'A': 'done'}}]
    text = done(TEXTS['columns'].replace('      A: done\n', ''), 'remove_state', state='/B')
    assert data_of(text)['concurrency']['conditions'] == [] and '\n  conditions: []\n  states:\n' in text
    text = 'machine:\n  outcomes:  # none: x\n\n    # one\n    - done\n  states: {}\n'
    after = done(text, 'remove_outcome', container='/', outcome='done')
    assert after == 'machine:\n  outcomes: []  # none: x\n  states: {}\n'


def test_the_head_of_a_behavior() -> None:
    text = done(PLAIN, 'set_behavior', key='name', text='Yes: 1')
    assert text == "behavior:\n  name: 'Yes: 1'\n" + PLAIN
    text = done(text, 'set_behavior', key='description', text='two\nlines')
    text = done(
        text, 'set_behavior_parameter', name='limit', fields={'default': 60.0, 'unit': 's', 'choices': [1.5, 60.0]}
    )
    text = done(text, 'set_behavior_parameter', name='tree', fields={'default': 'a b', 'description': 'no'})
    assert yaml.safe_load(text)['behavior'] == {
        'name': 'Yes: 1',
        'description': 'two\nlines',
        'parameters': {
            'limit': {'default': 60.0, 'unit': 's', 'choices': [1.5, 60.0]},
            'tree': {'default': 'a b', 'description': 'no'},
        },
    }
    text = done(text, 'set_parameter', state='/Find', name='tries', text='$limit')
    assert YamlDocument(text).view()['behavior']['parameters'][0]['default'] == '60.0'
    with pytest.raises(GestureError, match=r'\$limit is used in yaml line'):
        done(text, 'set_behavior_parameter', name='limit', fields=None)
    text = done(text, 'rename_behavior_parameter', name='limit', new='most')
    assert data_of(text)['machine']['states']['Find']['parameters'] == {'tries': '$most'}
    for name in ('tree', 'most'):
        text = done(
            done(text, 'set_parameter', state='/Find', name='tries', text='3'),
            'set_behavior_parameter',
            name=name,
            fields=None,
        )
    assert list(data_of(text)['behavior']) == ['name', 'description']
    for key in ('name', 'description'):
        text = done(text, 'set_behavior', key=key, text=None)
    assert text == PLAIN


def test_the_last_state_and_the_first() -> None:
    text = done(TEXTS['empty'], 'add_state', parent='/', label='A', type='X', parameters={}, transitions={'done': 'A'})
    assert text.endswith('  states:   # none yet\n    A:\n      state: X\n      transitions: {done: A}\n')
    assert data_of(done(text, 'remove_state', state='/A')) == data_of(TEXTS['empty'])
    text = done(
        text, 'add_state', parent='/', label='B', type='Inner', parameters={'x': 'yes'}, transitions={}, kind='behavior'
    )
    text = done(
        text, 'add_state', parent='/', label='C', type='', parameters={}, transitions={'ok': 'A'}, kind='machine'
    )
    states = data_of(text)['machine']['states']
    assert states['B'] == {'behavior': {'use': 'Inner', 'parameters': {'x': 'yes'}}} and "'yes'" in text
    assert states['C'] == {'machine': {'outcomes': ['ok'], 'states': {}}, 'transitions': {'ok': 'A'}}


def test_what_is_empty_is_filled() -> None:
    text = 'machine:\n  outcomes:\n  states:\n    A:\n      state: X\n      parameters:  # none\n      transitions:\n'
    for name, arguments in (
        ('add_outcome', {'container': '/', 'outcome': 'done'}),
        ('add_outcome', {'container': '/', 'outcome': 'off'}),
        ('set_parameter', {'state': '/A', 'name': 'x', 'text': '1'}),
        ('set_target', {'state': '/A', 'outcome': 'ok', 'target': 'done'}),
        ('set_userdata', {'container': '/', 'key': 'place', 'text': 'dock'}),
    ):
        text = done(text, name, **arguments)
    state = {'state': 'X', 'parameters': {'x': '1'}, 'transitions': {'ok': 'done'}}
    content = {'outcomes': ['done', 'off'], 'userdata': {'place': 'dock'}, 'states': {'A': state}}
    assert ordered(data_of(text)) == ordered({'machine': content}) and '{x: 1}  # none' in text
    text = 'machine:\n  outcomes: [a]\n  states:\n'
    assert data_of(done(text, 'add_state', parent='/', label='B', type='X', parameters={}, transitions={}))
    for text in (
        'machine:',
        'machine: {}',
        'machine:\n  states: 3\n',
        'machine:\n  states: [a]\n',
        'machine: {states: {A: }}',
    ):
        document = YamlDocument(text)
        for state in document.view()['states']:
            for name in document.gestures():
                parameters = inspect.signature(getattr(document, name)).parameters
                values = {
                    'state': state['path'],
                    'container': state['path'],
                    'parent': state['path'],
                    'states': [state['path']],
                }
                values |= {
                    'parameters': {},
                    'transitions': {},
                    'index': 0,
                    'keys': None,
                    'fields': None,
                    'kind': 'state',
                }
                given = {one: values.get(one, 'done') for one in parameters}
                with contextlib.suppress(GestureError):
                    assert not YamlDocument(applied(text, document.gesture(name, given))).unreadable


def test_comments_are_set_and_removed() -> None:
    text = done(BEHAVIOR, 'set_comment', state='/Inner/One', text='eins\n\n# zwei')
    views = {state['path']: state for state in YamlDocument(text).view()['states']}
    assert views['/Inner/One']['comments'] == ['eins', '', '# zwei']
    assert views['/Inner/Two']['comments'] == ['two', 'last']
    assert done(text, 'set_comment', state='/Inner/One', text='') == BEHAVIOR


def test_anchors_and_aliases_are_shown_and_not_edited() -> None:
    document = YamlDocument(ANCHORS)
    states = {state['path']: state for state in document.view()['states']}
    assert states['/B']['transitions'][0]['target'] == 'B' and 'alias' in states['/D']['locked']
    for name, arguments in (
        ('set_target', {'state': '/A', 'outcome': 'done', 'target': 'C'}),
        ('set_target', {'state': '/B', 'outcome': 'done', 'target': 'C'}),
        ('remove_state', {'state': '/A'}),
        ('rename_state', {'state': '/B', 'label': 'X'}),
        ('rename_state', {'state': '/D', 'label': 'X'}),
    ):
        with pytest.raises(GestureError, match=r'alias|anchor'):
            document.gesture(name, arguments)
    assert '{done: A}' in done(ANCHORS, 'set_target', state='/C', outcome='done', target='A')


@pytest.mark.parametrize('style', ['plain', 'behavior', 'flow', 'columns'])
def test_broken_texts_are_read_as_far_as_they_go_and_not_edited(style: str) -> None:
    random_ = random.Random(3)
    for _ in range(60):
        text = TEXTS[style]
        for _ in range(random_.randrange(1, 4)):
            at = random_.randrange(len(text))
            text = (
                text[:at]
                + random_.choice(['', '\t', ': ', '{', ']', '"', '&a ', '*a', '\x01', '\ud800', '- ', '%', '\n'])
                + text[at + 1 :]
            )
        document = YamlDocument(text)
        view = document.view()
        for problem in document.problems:
            assert 0 <= problem.span.start <= problem.span.end <= len(text) and problem.message
        for state in view['states'][1:3]:
            try:
                edits = document.gesture('set_target', {'state': state['path'], 'outcome': 'done', 'target': 'A'})
            except GestureError:
                continue
            assert not YamlDocument(applied(text, edits)).unreadable


def test_arguments_that_make_no_sense_are_refused() -> None:
    random_ = random.Random(5)
    values = [
        None,
        '',
        '/',
        '/Find',
        '/Both',
        '/Nowhere',
        'x\ny',
        'done',
        -1,
        2,
        1.5,
        True,
        [],
        ['/Find', 3],
        {},
        {'a': [1]},
        '\ud800',
        '{',
        '#',
    ]
    document, tried = YamlDocument(PLAIN), 0
    for name in document.gestures():
        method = getattr(document, name)
        for _ in range(60):
            arguments = {one: random_.choice(values) for one in inspect.signature(method).parameters}
            try:
                edits = document.gesture(name, arguments)
            except GestureError as error:
                assert str(error)
                tried += 1
                continue
            after = YamlDocument(applied(PLAIN, edits))
            assert not after.problems, (name, arguments)
            assert applied(after.text, inverse(PLAIN, edits)) == PLAIN
    assert tried > 500


def test_reading_takes_time_in_proportion_to_the_text() -> None:
    state = '    S{0}:\n      state: X  # {0}\n      transitions: {{done: S{0}, failed: done}}\n'
    text = 'machine:\n  outcomes: [done]\n  states:\n' + ''.join(state.format(number) for number in range(2000))
    document = YamlDocument(text)
    assert len(document.view()['states']) == 2001
    assert len(document.gesture('rename_state', {'state': '/S1000', 'label': 'New'})) == 2
    deep = '{a: ' * 5000 + 'b' + '}' * 5000
    assert 'nested' in YamlDocument(deep).problems[0].message
    assert YamlDocument('x' * 1_000_001).problems[0].message.startswith('the text has 1000001 characters')

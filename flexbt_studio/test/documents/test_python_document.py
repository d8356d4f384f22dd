# SPDX-License-Identifier: BSD-3-Clause
"""Python documents: each gesture changes the call that was meant, and nothing else.

The expected calls are found and edited independent of the document, in Python's syntax tree.
"""

from __future__ import annotations

import ast
import contextlib
import copy
import functools
import inspect
import os
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from machine_texts import PYTHON

from flexbt_studio.documents.python_document import PythonDocument
from flexbt_studio.documents.text import applied, inverse
from flexbt_studio.errors import GestureError

WORKSPACE = Path(__file__).parents[3]
NAMES = ['Next', "it's", 'say "x"', 'é😀', 'a b', 'off']


def texts() -> dict[str, str]:
    """Return all Python files with machines that are at hand."""
    found = dict(PYTHON)
    folders = [*WORKSPACE.glob('flexbt_*'), WORKSPACE.parent / 'shared' / 'data' / 'reports']
    folders += [Path(one) for one in os.environ.get('FLEXBT_TEST_BEHAVIORS', '').split(os.pathsep) if one]
    for file in (file for folder in folders if folder.is_dir() for file in folder.rglob('*.py')):
        data = file.read_bytes()
        if b'.add(' in data and (b'StateMachine' in data or b'Container(' in data) and file.name != 'machine_texts.py':
            with contextlib.suppress(UnicodeDecodeError):
                found[str(file)] = data.decode()
    return found


ALL = texts()


class Calls:
    """The calls of ``add`` and ``Child`` with literal labels in a file, in order."""

    def __init__(self, text: str) -> None:
        self.text = text.removeprefix('\ufeff')
        self.tree = ast.parse(self.text)
        lines = text.removeprefix('\ufeff').splitlines(keepends=True)
        starts = [0]
        for line in lines:
            starts.append(starts[-1] + len(line))
        self.found: list[dict[str, Any]] = []
        self.nodes: list[ast.Call] = []
        for node in ast.walk(self.tree):
            if isinstance(node, ast.Call) and len(node.args) >= 2 and isinstance(node.args[0], ast.Constant):
                name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, 'id', '')
                if name in ('add', 'Child') and isinstance(node.args[0].value, str):
                    self.nodes.append(node)
        self.nodes.sort(key=lambda node: (node.lineno, node.col_offset))
        for node in self.nodes:
            label: Any = node.args[0]
            line = lines[label.lineno - 1]
            column = len(line.encode()[: label.col_offset].decode())
            given = dict(zip(('label', 'state', 'transitions', 'autonomy', 'remapping'), node.args, strict=False))
            given.update({one.arg: one.value for one in node.keywords if one.arg})
            self.found.append({
                'offset': starts[label.lineno - 1] + column + text.startswith('\ufeff'),
                'label': label.value,
                'state': ast.unparse(given['state']),
                **{table: literal(given.get(table)) for table in ('transitions', 'autonomy', 'remapping')},
            })  # fmt: skip

    @functools.cached_property
    def others(self) -> str:
        """What is not in these calls, without imports."""
        return self._without_calls(self.tree)

    def rest(self, *masked: str) -> str:
        """Return what is not in these calls, without imports; some texts count as equal."""
        return self._without_calls(ast.parse(self.text), *masked) if masked else self.others

    def _without_calls(self, tree: ast.Module, *masked: str) -> str:
        places = {(node.lineno, node.col_offset) for node in self.nodes}
        for node in ast.walk(tree):
            for name in ('body', 'orelse', 'elts'):
                block = getattr(node, name, None)
                if isinstance(block, list):
                    setattr(
                        node,
                        name,
                        [one for one in block if not _is_call(one, places) and not isinstance(one, ast.ImportFrom)],
                    )
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                parts = node.value.split('/')
                node.value = '/'.join('§' if part in masked else part for part in parts)
        return ast.dump(tree)


calls_of = functools.lru_cache(maxsize=4)(Calls)


def _is_call(node: Any, places: set[tuple[int, int]]) -> bool:
    call = node.value if isinstance(node, ast.Expr) else node
    return isinstance(call, ast.Call) and (call.lineno, call.col_offset) in places


def literal(node: ast.expr | None) -> Any:
    """Return a mapping of texts to texts or to code; code for other expressions."""
    if node is None:
        return {}
    if isinstance(node, ast.Dict) and all(isinstance(key, ast.Constant) for key in node.keys):
        return {key.value: ast.unparse(value) for key, value in zip(node.keys, node.values, strict=True)}  # type: ignore[union-attr]
    return ast.unparse(node)


def plain(calls: Calls) -> list[dict[str, Any]]:
    return [
        {
            key: list(value.items()) if isinstance(value, dict) else value
            for key, value in one.items()
            if key != 'offset'
        }
        for one in calls.found
    ]


class Trial:
    """One text, and random gestures on it."""

    def __init__(self, text: str, seed: int) -> None:
        self.text = text
        self.random = random.Random(seed)
        self.document = PythonDocument(text, 'x.py')
        self.states = self.document.view()['states']
        self.calls = calls_of(text)
        self.by_offset = {one['offset']: number for number, one in enumerate(self.calls.found)}

    def open_states(self) -> Iterator[tuple[dict[str, Any], int]]:
        """Yield the states that can be edited, each with the number of its call."""
        for state in self.states:
            number = self.by_offset.get(state['label_span'][0])
            if state['parent'] is not None and not state['locked'] and number is not None:
                yield state, number

    def siblings(self, state: dict[str, Any]) -> list[dict[str, Any]]:
        return [one for one in self.states if one['parent'] == state['parent']]

    def run(
        self, name: str, arguments: dict[str, Any], expected: list[dict[str, Any]] | None, *masked: str
    ) -> str | None:
        """Carry out a gesture and check it; return the new text, or None if it was refused."""
        try:
            edits = self.document.gesture(name, arguments)
        except GestureError as error:
            assert str(error)
            return None
        after = applied(self.text, edits)
        assert applied(after, inverse(self.text, edits)) == self.text
        now = calls_of(after)
        assert self.document.after(after).problems == []
        if expected is not None:
            wanted = [
                {
                    key: list(value.items()) if isinstance(value, dict) else value
                    for key, value in one.items()
                    if key != 'offset'
                }
                for one in expected
            ]
            assert plain(now) == wanted, (name, arguments)
            assert now.rest(*masked) == self.calls.rest(*masked), (name, arguments)
        return after


def trials(text: str, seed: int, most: int = 1000) -> Iterator[tuple[str, str | None]]:
    """Try each gesture on each state, on ``most`` of them; yield its name, and the new text or None."""
    trial = Trial(text, seed)
    choose = trial.random.choice
    states = list(trial.open_states())
    for state, number in trial.random.sample(states, min(most, len(states))):
        path, call = state['path'], trial.calls.found[number]
        siblings = trial.siblings(state)
        parent = next(one for one in trial.states if one['path'] == state['parent'])
        targets = [
            *parent['outcomes'],
            *([] if parent['kind'] == 'concurrency' else [one['label'] for one in siblings]),
        ]
        for table, gesture, names, values in (
            ('transitions', 'set_target', ('outcome', 'target'), targets or ['x']),
            ('autonomy', 'set_autonomy', ('outcome', 'level'), ['off', 'low', 'high', 'full']),
            ('remapping', 'set_remapping', ('key', 'name'), NAMES),
        ):
            known = list(call[table]) if isinstance(call[table], dict) else []
            key = choose([*known, *(state['outcomes'] or ['done', *NAMES])])
            for value in (choose(values), *([None] if key in known else [])):
                expected = copy.deepcopy(trial.calls.found)
                if isinstance(call[table], dict) and value is not None:
                    level = f'Autonomy.{value.capitalize()}'
                    if (
                        table == 'autonomy'
                        and str(call[table].get(key, next(reversed(call[table].values()), ''))).isdigit()
                    ):
                        level = str(['off', 'low', 'high', 'full'].index(value))
                    expected[number][table][key] = level if table == 'autonomy' else repr(value)
                elif isinstance(call[table], dict):
                    del expected[number][table][key]
                computed = not isinstance(call[table], dict)
                yield (
                    gesture,
                    trial.run(gesture, {'state': path, names[0]: key, names[1]: value}, None if computed else expected),
                )
        yield from _renaming(trial, state, siblings, choose)
        yield from _parameters(trial, state, number)
        yield from _places(trial, state, number, targets, choose)


def _renaming(
    trial: Trial, state: dict[str, Any], siblings: list[dict[str, Any]], choose: Any
) -> Iterator[tuple[str, str | None]]:
    new = choose(NAMES)
    expected: list[dict[str, Any]] | None = copy.deepcopy(trial.calls.found)
    for one in siblings:
        number = trial.by_offset.get(one['label_span'][0])
        if number is None or not isinstance(trial.calls.found[number]['transitions'], dict):
            expected = None
            break
        assert expected is not None
        ways = expected[number]['transitions']
        ways.update({key: repr(new) for key, target in ways.items() if target == repr(state['label'])})
    number = trial.by_offset[state['label_span'][0]]
    if expected is not None:
        expected[number]['label'] = new
        if 'use_behavior' in expected[number]['state'] or state['kind'] != 'state':
            expected = None  # the path of the behavior changes, too
    yield (
        'rename_state',
        trial.run('rename_state', {'state': state['path'], 'label': new}, expected, state['label'], new),
    )


def _parameters(trial: Trial, state: dict[str, Any], number: int) -> Iterator[tuple[str, str | None]]:
    for one in state['parameters'][:3]:
        tree = ast.parse(trial.calls.found[number]['state'], mode='eval').body
        expected = copy.deepcopy(trial.calls.found)
        if state['wrappers'] or state['kind'] != 'state' or not isinstance(tree, ast.Call):
            expected = None  # type: ignore[assignment]
        elif '*' in one['name']:
            continue
        elif one['name'].isdigit():
            tree.args[int(one['name'])] = ast.parse("['x', 2]", mode='eval').body
        else:
            next(key for key in tree.keywords if key.arg == one['name']).value = ast.parse("['x', 2]", mode='eval').body
        if expected is not None:
            expected[number]['state'] = ast.unparse(tree)
        yield (
            'set_parameter',
            trial.run('set_parameter', {'state': state['path'], 'name': one['name'], 'text': "['x', 2]"}, expected),
        )
        assert trial.run('set_parameter', {'state': state['path'], 'name': one['name'], 'text': 'a, b'}, None) is None


def _places(
    trial: Trial, state: dict[str, Any], number: int, targets: list[str], choose: Any
) -> Iterator[tuple[str, str | None]]:
    path, call = state['path'], trial.calls.found[number]
    instead = choose([one for one in targets if one != state['label']] or ['x'])
    expected: list[dict[str, Any]] | None = copy.deepcopy(trial.calls.found)
    assert expected is not None
    for one in trial.siblings(state):
        other = trial.by_offset.get(one['label_span'][0])
        if (
            other is None
            or not isinstance(expected[other]['transitions'], dict)
            or state['kind'] not in ('state', 'behavior')
        ):
            expected = None
            break
        ways = expected[other]['transitions']
        ways.update({key: repr(instead) for key, target in ways.items() if target == repr(state['label'])})
    if expected is not None:
        del expected[number]
    parent = next(one for one in trial.states if one['path'] == state['parent'])
    if parent['conditions'] or not call['state'].endswith(')') or not isinstance(call['transitions'], dict):
        expected = None
    yield 'remove_state', trial.run('remove_state', {'state': path, 'instead': instead}, expected)
    arguments = {
        'parent': state['parent'],
        'label': 'Brand new',
        'type': 'pkg.mod.NewState',
        'parameters': {'a': 1, 'b': '[x]'},
    }
    target = choose(targets or ['x'])
    after = trial.run('add_state', {**arguments, 'transitions': {'done': target}}, None)
    if after is not None:
        new = [one for one in calls_of(after).found if one['label'] == 'Brand new']
        assert [(one['state'], one['transitions']) for one in new] == [('NewState(a=1, b=[x])', {'done': repr(target)})]
        assert calls_of(after).rest() == trial.calls.rest()
        document = trial.document.after(after)
        added = next(one for one in document.view()['states'] if one['label'] == 'Brand new')
        assert added['parent'] == state['parent'] and document.view()['states'][-1] is not None
        back = document.gesture('remove_state', {'state': added['path']})
        lines = [
            line
            for line in applied(after, back).splitlines(keepends=True)
            if 'import NewState' not in line and 'import Autonomy' not in line
        ]
        assert ''.join(lines) == trial.text or 'Autonomy' in after
    yield 'add_state', after
    after = trial.run('set_initial', {'state': path}, None)
    if after is not None:
        labels = [
            one['label'] for one in trial.document.after(after).view()['states'] if one['parent'] == state['parent']
        ]
        assert labels[0] == state['label'] and sorted(labels) == sorted(one['label'] for one in trial.siblings(state))
        assert calls_of(after).rest() == trial.calls.rest()
        assert sorted(map(str, plain(calls_of(after)))) == sorted(map(str, plain(trial.calls)))
    yield 'set_initial', after
    after = trial.run('set_comment', {'state': path, 'text': 'One.\n\nÜ'}, trial.calls.found)
    if after is not None:
        again = trial.document.after(after)
        same = next(one for one in again.view()['states'] if one['path'] == path)
        assert same['comments'][:3] == ['One.', '', 'Ü']
    yield 'set_comment', after


@pytest.mark.parametrize('style', ['tabs', 'crlf', 'bom'])
def test_gestures_change_what_is_meant(style: str) -> None:
    done = [name for name, after in trials(PYTHON[style], 1) if after is not None]
    assert set(done) >= {
        'set_target',
        'set_autonomy',
        'rename_state',
        'set_parameter',
        'remove_state',
        'add_state',
        'set_comment',
    }


def done(before: str, gesture: str, /, **arguments: Any) -> str:
    return applied(before, PythonDocument(before).gesture(gesture, arguments))


def test_all_behaviors_of_the_workspace_are_read() -> None:
    count = 0
    for name, text in ALL.items():
        document = PythonDocument(text)
        assert document.problems == [] and document.text == text, name
        view, calls = document.view(), Calls(text)
        offsets = {one['offset']: one for one in calls.found}
        for state in view['states']:
            call = offsets.get(state['label_span'][0])
            if call is None or state['locked']:
                continue
            ways = call['transitions'] if isinstance(call['transitions'], dict) else None
            named = [one for one in state['transitions'] if one['target'] is not None]
            shown = {one['outcome']: repr(one['target']) for one in named}
            assert ways is None or shown == {key: way for key, way in ways.items() if way[0] in '\'"'}, name
            for one in named:
                assert ast.literal_eval(text[slice(*one['target_span'])]) == one['target']
            count += 1
    assert count > 150


@pytest.mark.parametrize(
    'ways',
    ["dict(failed='W', done='end')", "OTHERS | {'failed': 'W', 'done': 'end'}", "{'a': 'V', **{'b': 'W', 'c': 'end'}}"],
)
def test_what_computed_transitions_name_is_neither_renamed_nor_removed(ways: str) -> None:
    text = f"""\
from flexbt_core import Child, OperatableStateMachine
machine = OperatableStateMachine(
    outcomes=['end', 'done'],
    children=[Child('W', S(1), {{'done': 'V'}}), Child('V', S(2), transitions={ways})],
)
"""
    for name, arguments in (
        ('rename_state', {'state': '/W', 'label': 'X'}),
        ('remove_state', {'state': '/W'}),
        ('rename_outcome', {'container': '/', 'outcome': 'end', 'name': 'over'}),
    ):
        with pytest.raises(GestureError, match=r'/V .*computed'):
            PythonDocument(text).gesture(name, arguments)
    assert "'over'" in done(text, 'rename_outcome', container='/', outcome='done', name='over')


def test_what_is_computed_is_shown_with_the_reason_and_stays() -> None:
    states = {state['path']: state for state in PythonDocument(PYTHON['forms']).view()['states']}
    assert states["/f'Wait{number}'"]['locked'].startswith('it is in a loop (line ')
    assert states['/Extra']['locked'].startswith('it is in a branch (line ')
    extra = "machine.add('Extra', WaitState(1.0), transitions={'done': 'finished'})"
    blank = ' ' * 12
    caught = f'try:\n{blank}    {extra}\n{blank}except* ValueError:\n{blank}    pass'
    text = PYTHON['forms'].replace(f'if self.limit:\n{blank}    {extra}', caught)
    found = {state['path']: state['locked'] for state in PythonDocument(text).view()['states']}
    assert found['/Extra'].startswith('it is in a branch (line ')
    assert [wrapper['kind'] for wrapper in states['/Drive']['wrappers']] == ['timeout', 'retry']
    assert states['/Drive']['parameters'][0]['text'] == '(2.0)' and states['/Work']['kind'] == 'concurrency'
    assert states['Second:/B']['type'] == 'Ask'
    for name, arguments in (
        ('set_target', {'state': '/Extra', 'outcome': 'done', 'target': 'Ask'}),
        ('set_target', {'state': '/Last', 'outcome': 'done', 'target': 'Ask'}),
        ('rename_state', {'state': "/f'Wait{number}'", 'label': 'X'}),
        ('rename_state', {'state': '/Drive', 'label': 'X'}),  # the loop names it
        ('set_parameter', {'state': '/Last', 'name': '**', 'text': '1'}),
        ('set_initial', {'state': '/Last'}),
    ):
        with pytest.raises(GestureError):
            PythonDocument(PYTHON['forms']).gesture(name, arguments)


def test_what_other_code_uses_too_is_neither_edited_nor_removed_with_a_state() -> None:
    text = """\
class Patrol(Behavior):
    def create(self):
        first = spare = WaitState(1.0)
        self.second = WaitState(2.0)
        ways = others = {'done': 'B'}
        with OperatableStateMachine(['end']) as machine:
            machine.add('A', first, ways)
            machine.add('B', self.second, {'done': 'end'})
            machine.add('C', spare, others)
        return machine

    def tell(self):
        return self.second.log
"""
    for name, arguments in (
        ('set_target', {'state': '/A', 'outcome': 'done', 'target': 'C'}),
        ('set_parameter', {'state': '/A', 'name': '0', 'text': '3.0'}),
        ('set_parameter', {'state': '/B', 'name': '0', 'text': '3.0'}),
    ):
        with pytest.raises(GestureError, match='is used in several places'):
            done(text, name, **arguments)
    removed = text.replace("            machine.add('A', first, ways)\n", '')
    assert done(text, 'remove_state', state='/A', instead='end') == removed
    text = text.replace("{'done': 'B'}", '{}')
    assert done(text, 'remove_state', state='/B', instead='end') == text.replace(
        "            machine.add('B', self.second, {'done': 'end'})\n", ''
    )


def test_a_parameter_in_nested_f_strings_is_renamed_or_refused() -> None:
    text = '''\
class Patrol(Behavior):
    manifest = BehaviorManifest('Patrol', parameters=[BehaviorParameter('speed', 1.0)])

    def create(self):
        text = (f"""ü{rf\'\'\'{ self.speed :.2f}{
 self.x(self.speed)!r}\'\'\'!r}{{self.speed}}""")
        with OperatableStateMachine(['end']) as machine:
            machine.add('A', LogState(text), {'done': 'end'})
        return machine
'''
    with contextlib.suppress(GestureError):  # Python before 3.12 errs about the places
        after = done(text, 'rename_behavior_parameter', name='speed', new='limit')
        assert after == text.replace('speed', 'limit').replace('{{self.limit}}', '{{self.speed}}')


def test_what_names_a_state_of_flexbe_is_renamed_with_it() -> None:
    text = done(PYTHON['flexbe'], 'rename_state', state='/Watch', label='Guard')
    expected = (
        PYTHON['flexbe']
        .replace("'Watch'", "'Guard'")
        .replace("'Watch/Inner'", "'Guard/Inner'")
        .replace('40 /Watch', '40 /Guard')
    )
    assert text == expected
    assert done(text, 'rename_state', state='/Guard', label='Watch') == PYTHON['flexbe']
    text = done(PYTHON['flexbe'], 'remove_state', state='/Watch', instead='finished')
    assert '_sm_watch_0' not in text and text.count('OperatableStateMachine.add') == 1
    assert {'# x:683 y:40, x:683 y:140', '# x:84 y:50 {?hidden = self.speed}'} <= {
        line.strip() for line in text.splitlines()
    }


def test_imports_follow_the_form_of_the_file() -> None:
    arguments: dict[str, Any] = {'label': 'New', 'parameters': {}, 'transitions': {'done': 'Drive'}}
    text = done(PYTHON['flexbe'], 'add_state', parent='/', type='my_states.tell_state.TellState', **arguments)
    assert 'import DriveState\nfrom my_states.tell_state import TellState\nfrom my_states.watch_state' in text
    assert (
        "            # x:284 y:130\n            OperatableStateMachine.add('New',\n" + 39 * ' ' + 'TellState(),\n'
        in text
    )
    text = done(
        PYTHON['forms'], 'add_state', parent='/Work', type='flexbt_states.LogState', **{**arguments, 'transitions': {}}
    )
    assert 'from flexbt_states import BtExecuteState, LogState, WaitState\n' in text
    assert "  # right\n                Child('New', LogState()),\n            ]" in text
    text = done(PYTHON['forms'], 'set_autonomy', state='/Ask', outcome='received', level='low')
    assert (
        'import (\n    Autonomy,\n    Child,' in text
        and "asked, autonomy={'received': Autonomy.Low}, remapping=" in text
    )
    with pytest.raises(GestureError, match='not imported'):
        done(PYTHON['forms'], 'add_state', parent='/', type='LogState', **arguments)


def test_a_syntax_error_has_its_place_and_nothing_is_edited() -> None:
    text = PYTHON['forms'].replace('return machine', 'return ö ö machine', 1)
    document = PythonDocument(text)
    assert (
        text[document.problems[0].span.start :].startswith('ö machine')
        or 'ö ö' in text[document.problems[0].span.start :][:4]
    )
    assert document.view()['states'] == []
    with pytest.raises(GestureError, match='no Python'):
        document.gesture('set_target', {'state': '/Ask', 'outcome': 'x', 'target': 'y'})
    for broken in ('\0', '(' * 5000, '-' * 100_000 + '1', '\ud800', 'x = 1\n\tif', '"""', '', '# only'):
        PythonDocument(broken).view()


@pytest.mark.parametrize('style', ['flexbe', 'forms'])
def test_arguments_that_make_no_sense_are_refused(style: str) -> None:
    random_ = random.Random(5)
    values: list[Any] = [
        None,
        '',
        '/',
        '/Drive',
        '/Watch',
        '/Work',
        'x\ny',
        'done',
        -1,
        2,
        True,
        [],
        {},
        {'a': [1]},
        '\ud800',
        '{',
        '#',
        'f(',
        "'",
    ]
    document, refused = PythonDocument(PYTHON[style]), 0
    for name in document.gestures():
        parameters = inspect.signature(getattr(document, name)).parameters
        for _ in range(80):
            arguments = {one: random_.choice(values) for one in parameters}
            try:
                edits = document.gesture(name, arguments)
            except GestureError as error:
                assert str(error)
                refused += 1
                continue
            after = applied(document.text, edits)
            ast.parse(after)
            assert applied(after, inverse(document.text, edits)) == document.text
    assert refused > 500


def test_a_name_that_is_written_beside_a_variable_is_a_text() -> None:
    text = """from flexbt_core import OperatableStateMachine

NEXT = 'finished'


def create():
    with OperatableStateMachine(outcomes=['finished', 'failed']) as machine:
        OperatableStateMachine.add('Say', LogState('x'), transitions={'done': NEXT})
    return machine
"""
    after = done(text, 'set_target', state='/Say', outcome='other', target='failed')
    assert after == text.replace('NEXT})', "NEXT, 'other': 'failed'})")

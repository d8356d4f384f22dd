# SPDX-License-Identifier: BSD-3-Clause
"""Name, texts and parameters of behaviors in Python: each edit changes what is meant, and Python reads the same."""

from __future__ import annotations

from typing import Any

import pytest

from flexbt_studio.documents.python_document import PythonDocument
from flexbt_studio.documents.text import applied
from flexbt_studio.errors import GestureError

CREATE = """
    def create(self):
        machine = OperatableStateMachine(outcomes=['finished'])
        with machine:
            machine.add('Wait', WaitState(self.seconds), transitions={'done': 'finished'})
        return machine
"""
ROWS = f"""\
from flexbt_core import OperatableStateMachine
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest, BehaviorParameter
from flexbt_states import WaitState


class Waits(Behavior):
    manifest = BehaviorManifest(
        name='Waits',
        description='it waits',
        parameters=[
            # how long
            BehaviorParameter('seconds', 1.0, 'how long', unit='s'),  # not too long
            BehaviorParameter('place', "home"),
        ],
    )

    seconds: float
    place: str
{CREATE}"""
LINE = f"""\
from flexbt_core import OperatableStateMachine
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest, BehaviorParameter
from flexbt_states import WaitState

class Waits(Behavior):
    manifest = BehaviorManifest(
        'Waits', 'it waits', parameters=(BehaviorParameter('seconds', default=1.0), BehaviorParameter('place', 'home')))
{CREATE}"""
FLEXBE = f"""\
from flexbe_core import Behavior, OperatableStateMachine
from flexbe_states.wait_state import WaitState


class WaitsSM(Behavior):
    def __init__(self, node):
        super().__init__()
        self.name = 'Waits'

        # parameters of this behavior
        self.add_parameter('seconds', 1.0)
        self.add_parameter('place', 'home')
{CREATE}"""
FORMS = {'rows': ROWS, 'line': LINE, 'flexbe': FLEXBE}


def after(text: str, gesture: str, /, **arguments: Any) -> tuple[str, dict[str, Any]]:
    """Return the text after a gesture, and the behavior that is read from it."""
    made = applied(text, PythonDocument(text, 'waits.py').gesture(gesture, arguments))
    compile(made, 'waits.py', 'exec')
    behavior: dict[str, Any] = PythonDocument(made).view()['behavior']
    return made, behavior


def parameters(behavior: dict[str, Any]) -> dict[str, tuple[str, str]]:
    return {one['name']: (one['default'], one['description']) for one in behavior['parameters']}


@pytest.mark.parametrize('form', FORMS)
def test_parameters_are_added_changed_renamed_and_removed(form: str) -> None:
    text = FORMS[form]
    before = parameters(PythonDocument(text).view()['behavior'])
    made, behavior = after(text, 'set_behavior_parameter', name='speed', fields={'default': '0.5'})
    assert parameters(behavior) == before | {'speed': ('0.5', '')}
    assert len(made.splitlines()) - len(text.splitlines()) == (form != 'line')
    back, behavior = after(made, 'set_behavior_parameter', name='speed', fields=None)
    assert parameters(behavior) == before and back.split() == text.split()
    _, behavior = after(text, 'set_behavior_parameter', name='seconds', fields={'default': '2 * 3'})
    assert parameters(behavior) == before | {'seconds': ('2 * 3', before['seconds'][1])}
    made, behavior = after(text, 'rename_behavior_parameter', name='seconds', new='duration')
    assert list(parameters(behavior)) == ['duration', 'place'] and 'seconds' not in made
    made, behavior = after(text, 'set_behavior_parameter', name='place', fields=None)
    assert list(parameters(behavior)) == ['seconds'] and 'place' not in made
    with pytest.raises(GestureError, match=r'self\.seconds is used in waits\.py line \d+'):
        after(text, 'set_behavior_parameter', name='seconds', fields=None)
    for name, fields, reason in (
        ('se conds', {'default': '1'}, 'cannot be the name'),
        ('_hidden', {'default': '1'}, 'cannot be the name'),
        ('speed', {}, 'needs a default'),
        ('speed', {'default': '1 +'}, 'no Python expression'),
        ('speed', {'default': '1', 'colour': 'red'}, 'has only'),
        ('sped', None, 'has no parameter'),
    ):
        with pytest.raises(GestureError, match=reason):
            after(text, 'set_behavior_parameter', name=name, fields=fields)
    with pytest.raises(GestureError, match='already'):
        after(text, 'rename_behavior_parameter', name='seconds', new='place')


@pytest.mark.parametrize('form', ['rows', 'line'])
def test_texts_of_a_manifest(form: str) -> None:
    text = FORMS[form]
    for key, new in (('name', "Wait's"), ('description', 'it waits\nand waits'), ('author', 'somebody')):
        made, behavior = after(text, 'set_behavior', key=key, text=new)
        assert behavior[key] == new
        assert len(made.splitlines()) == len(text.splitlines()) + (form == 'rows' and key == 'author')
    _, behavior = after(text, 'set_behavior_parameter', name='place', fields={'description': 'where "it" is'})
    assert parameters(behavior)['place'][1] == 'where "it" is'
    _, behavior = after(ROWS, 'set_behavior', key='description', text=None)
    assert behavior['description'] == ''


def test_the_name_of_a_behavior_of_flexbe_and_what_is_not_written() -> None:
    _, behavior = after(FLEXBE, 'set_behavior', key='name', text='Waits Long')
    assert behavior['name'] == 'Waits Long'
    with pytest.raises(GestureError, match='not written as a text'):
        after(FLEXBE, 'set_behavior', key='description', text='x')
    without = ROWS[: ROWS.index('        parameters=[')] + ROWS[ROWS.index('    )\n\n    seconds') :]
    made, behavior = after(
        without.replace(', BehaviorParameter\n', '\n'),
        'set_behavior_parameter',
        name='speed',
        fields={'default': '1', 'description': 'x'},
    )
    assert parameters(behavior) == {'speed': ('1', 'x')} and ', BehaviorParameter\n' in made

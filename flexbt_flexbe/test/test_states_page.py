# SPDX-License-Identifier: BSD-3-Clause
"""The reference of the states: it is what the states declare, and they declare what they have."""

from __future__ import annotations

import importlib
import inspect
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest

import flexbt_flexbe.states
import flexbt_states
from flexbt_onboard.behaviors.run_context import building

DOCS = Path(__file__).parents[2] / 'docs'

PARAMETERS: Final[dict[str, dict[str, Any]]] = {
    'BtExecuteGoalState': {
        'inputs': {'a': 'int64'},
        'request_id': 'r',
        'request_msg_type': 'string',
        'outputs': {'b': 'int64'},
    },
    'BtExecuteState': {'inputs': {'a': 'int64'}, 'outputs': {'b': 'int64'}},
    'BtGetDataState': {'request_id': 'path', 'request_msg_type': 'string', 'outputs': {'b': 'int64'}},
    'BtLoaderState': {'filepaths': ['flexbt_flexbe/package.xml']},
    'BtSetDataState': {'goal_id': 'goal', 'goal_msg_type': 'int64', 'inputs': {'a': 'int64'}},
    'CalculationState': {'calculation': abs},
    'CallActionState': {
        'action_type': 'nav2_msgs/action/Spin',
        'topic': 'spin',
        'goal': {'target_yaw': '{angle}'},
        'result': {'error_code': 'code'},
        'outcomes': {'turned': ''},
    },
    'CallServiceState': {
        'service_type': 'std_srvs/srv/SetBool',
        'topic': 'lamp',
        'request': {'data': '{on}'},
        'response': {'message': 'said'},
        'outcomes': {'switched': 'response.success'},
    },
    'CheckConditionState': {'predicate': bool},
    'CheckTopicState': {
        'topic': 'in',
        'msg_type': 'std_msgs/msg/String',
        'outcomes': {'same': 'message.data == wanted', 'wanted': ''},
    },
    'DecisionState': {'outcomes': ['one', 'two'], 'conditions': str},
    'ExecuteBehaviorState': {
        'behavior': 'Other',
        'outcomes': ['end'],
        'inputs': {'a': 'int64'},
        'outputs': {'b': 'int64'},
    },
    'FlexibleCalculationState': {'calculation': max, 'input_keys': ['a', 'b']},
    'FlexibleCheckConditionState': {'predicate': max, 'input_keys': ['a', 'b']},
    'InputState': {'request': 0, 'message': 'how many?'},
    'LogKeyState': {'text': '{}'},
    'LogState': {'text': 'hello'},
    'OperatorDecisionState': {'outcomes': ['one', 'two'], 'shows': ['a']},
    'OperatorInputState': {'prompt': 'how many?', 'type': 'int64', 'shows': ['a']},
    'PublishOnceState': {'topic': 'out', 'msg_type': 'std_msgs/msg/String'},
    'PublishState': {'topic': 'out', 'msg_type': 'std_msgs/msg/String', 'message': {'data': '{text}'}},
    'PublisherBoolState': {'topic': 'bool'},
    'PublisherEmptyState': {'topic': 'empty'},
    'PublisherStringState': {'topic': 'string'},
    'ReadTopicState': {
        'topic': 'in',
        'msg_type': 'std_msgs/msg/String',
        'message': {'data': 'text'},
        'outcomes': {'same': 'message.data == wanted', 'wanted': ''},
    },
    'SelectionState': {'message': 'which?'},
    'SubscribeOnceState': {'topic': 'in', 'msg_type': 'std_msgs/msg/String'},
    'SubscriberState': {'topic': 'in', 'msg_type': 'std_msgs/msg/String'},
    'UserdataState': {'data': 1},
    'WaitForServersState': {},
    'WaitState': {'wait_time': 1.0},
}


def all_states() -> list[Any]:
    """Return the states of both modules, in an order."""
    found: set[Any] = {
        getattr(module, name) for module in (flexbt_states, flexbt_flexbe.states) for name in module.__all__
    }
    return sorted(found, key=lambda state: (str(state.__name__), str(state.__module__)))


@pytest.fixture(scope='module')
def declaration() -> Iterator[Any]:
    """Yield what docs/tools/make_states.py reads a docstring with."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(DOCS / 'tools')
        yield importlib.import_module('make_states').declaration


def test_the_page_is_up_to_date(tmp_path: Path) -> None:
    subprocess.run([sys.executable, DOCS / 'tools' / 'make_states.py', tmp_path / 'page.md'], check=True)
    page = (DOCS / 'reference' / 'states.md').read_text()
    assert page == (tmp_path / 'page.md').read_text(), 'run docs/tools/make_states.py'


@pytest.mark.parametrize('state', all_states())
def test_what_a_state_declares_is_what_it_has(state: Any, declaration: Any) -> None:
    entries = declaration(state).entries
    parameters = PARAMETERS[state.__name__]
    with building():
        made = state(**parameters)
        has = {'inputs': made.input_keys, 'outputs': made.output_keys, 'outcomes': made.outcomes}
    for kind, names in has.items():
        declared = {name for name, _ in entries[kind]}
        if declared & {'KEY', 'OUTCOME'}:  # those that a parameter names
            given = [value for value in parameters.values() if isinstance(value, dict | list)]
            named = {key for value in given for key in value}
            named |= {str(key).strip('{}') for value in given if isinstance(value, dict) for key in value.values()}
            assert declared - {'KEY', 'OUTCOME'} == set(names) - named
            assert set(names) & named, f'{kind} that a parameter names'
        else:
            assert declared == set(names)


@pytest.mark.parametrize('state', all_states())
def test_each_parameter_of_a_state_is_declared(state: Any, declaration: Any) -> None:
    declared = [name for name, _ in declaration(state).entries['parameters']]
    assert declared == list(inspect.signature(state).parameters)

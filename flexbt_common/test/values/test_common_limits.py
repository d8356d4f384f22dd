# SPDX-License-Identifier: BSD-3-Clause
"""Bounds of messages from other processes: every text and list of every interface has one, and keeps it."""

from __future__ import annotations

import inspect
from typing import Any

import nav2_msgs.action
import nav2_msgs.srv
import pytest
import simulation_interfaces.srv
from geometry_msgs.msg import PoseStamped
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Goals, Path
from rclpy.serialization import serialize_message

import flexbt_msgs.action
import flexbt_msgs.msg
import flexbt_msgs.srv
from flexbt_common.errors import LimitExceededError
from flexbt_common.values.entries import to_entry
from flexbt_common.values.limits import LIMITS, MESSAGE, TEXT, check_limits, sanitize_message
from flexbt_msgs.action import BtExecute, BtLoad, BtSetData
from flexbt_msgs.msg import (
    BehaviorList,
    BehaviorStructure,
    ExecutiveLog,
    ExecutiveStatus,
    PendingDecision,
    PlaceList,
)
from flexbt_testing.nodes.oversized import MOST_ELEMENTS, oversized


def _interfaces(module: Any, *parts: str) -> list[type[Any]]:
    classes = [one for _, one in inspect.getmembers(module, inspect.isclass)]
    if not parts:
        return [one for one in classes if hasattr(one, 'get_fields_and_field_types')]
    return [getattr(one, part) for one in classes for part in parts if hasattr(one, parts[0])]


RECEIVED = [
    *_interfaces(flexbt_msgs.action, 'Goal', 'Result', 'Feedback'),
    *_interfaces(flexbt_msgs.srv, 'Request', 'Response'),
    *_interfaces(flexbt_msgs.msg),
    *_interfaces(nav2_msgs.action, 'Goal'),
    *_interfaces(nav2_msgs.srv, 'Request'),
    *_interfaces(simulation_interfaces.srv, 'Request'),
]

SENT_BY_EXECUTIVES = [ExecutiveStatus, BehaviorStructure, BehaviorList, PlaceList, ExecutiveLog]


@pytest.mark.parametrize('message_type', RECEIVED, ids=lambda one: one.__name__)
def test_too_much_in_any_field_is_refused_by_its_name(message_type: type[Any]) -> None:
    many = (flexbt_msgs.msg.TreeStructure, flexbt_msgs.msg.BehaviorStructure)
    elements = 110_000 if message_type in many else MOST_ELEMENTS
    for path, message in oversized(message_type, 11_000_000, elements):
        with pytest.raises(LimitExceededError) as refused:
            check_limits(message)
        text = str(refused.value)
        assert text.startswith(f'{path} has ')
        assert 'at most' in text
        assert len(text) < 300


@pytest.mark.parametrize('message_type', SENT_BY_EXECUTIVES, ids=lambda one: one.__name__)
def test_a_text_that_is_too_long_is_cut_to_its_bound(message_type: type[Any]) -> None:
    cut = 0
    for path, message in oversized(message_type, 110_000, 1):
        try:
            check_limits(message)
        except LimitExceededError as error:
            if ' characters' not in str(error):
                continue  # a list
            sanitize_message(message)
            check_limits(message)
            assert 'characters left out' in str(message), path
            cut += 1
    assert cut


def test_what_can_be_sent_is_left_as_it_is_and_the_rest_made_so() -> None:
    prompt = 'x' * LIMITS['flexbt_msgs/PendingDecision.prompt']
    status = ExecutiveStatus(decisions=[PendingDecision(prompt=prompt, outcomes=['a', '\udc80', '\0'])])
    sanitize_message(status)
    serialize_message(status)
    assert (status.decisions[0].prompt, status.decisions[0].outcomes) == (prompt, ['a', '\ufffd', '\ufffd'])


def test_every_bound_of_the_table_is_one_of_a_field() -> None:
    types = {one.__name__: one for one in RECEIVED}
    for key in LIMITS:
        package, _, field = key.partition('/')
        name, _, attribute = field.partition('.')
        if package in ('flexbt_msgs', 'nav2_msgs', 'simulation_interfaces'):
            assert attribute.removesuffix('[]') in types[name].get_fields_and_field_types(), key


def test_what_fits_fits() -> None:
    check_limits(
        BtExecute.Goal(goals=[PoseStamped()] * 10_000, inputs=[to_entry('path', Path(poses=[PoseStamped()] * 1000))])
    )
    check_limits(BtLoad.Goal(files=['x' * 4096] * 200, xml='x' * 8_000_000))
    check_limits(Goals(goals=[PoseStamped()] * 10_000))
    check_limits(flexbt_msgs.msg.ExecutiveLog())


def test_many_fields_that_fit_are_too_much_together() -> None:
    data = bytes(7_000_000)
    entries = [flexbt_msgs.msg.BlackboardEntry(key='k', type='nav_msgs/msg/Path', data=data)] * 3
    with pytest.raises(LimitExceededError, match=f'a message of 21000.* at most {MESSAGE}'):
        check_limits(BtSetData.Goal(entries=entries))


@given(st.text(max_size=2 * TEXT) | st.integers(0, 2 * TEXT).map('x'.__mul__))
def test_the_bound_itself_fits(text: str) -> None:
    goal = BtExecute.Goal(blackboard=text)
    if len(text) <= TEXT:
        check_limits(goal)
    else:
        with pytest.raises(LimitExceededError, match=r'^blackboard has'):
            check_limits(goal)

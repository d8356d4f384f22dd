# SPDX-License-Identifier: BSD-3-Clause
"""The elements of ASCXML for ROS and for behavior trees, and the events that they represent.

The names are those of AS2FM, since properties use them: ``topic_pose_msg``, ``action_go_result``,
``bt_1000_response``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

FIELD: Final = 'ros_fields__'
"""Prefix of the names of fields of ROS messages among the parameters of an event."""
TIMER: Final = 'ros_time_rate.'
SET: Final = 'bt_blackboard_set_'
FIRST_NODE: Final = 1000
"""The number of the root of the tree in the names of events; the others follow in the order of the file."""

_WAITED_FOR: Final = re.compile(
    r'bt_\d+_(tick|halt|response|halt_response)(_asked|_told)?|srv_.+_(response|request|req_client).*'
    r'|action_.+_(goal_.+|result.*|thread_(start|free))'
)


def is_waited_for(name: str) -> bool:
    """Return whether an event waits until its receivers reach a state with a transition for it. A receiver without a
    transition discards other events."""
    return _WAITED_FOR.fullmatch(name) is not None


def ros_name(name: str) -> str:
    """Return a ROS name in the form that event names contain."""
    return name.strip().removeprefix('/').replace('/', '__')


def bt_event(uid: int, what: str) -> str:
    """Return the name of an event of the node ``uid`` (from 1): ``what`` is tick, response, halt, or halt_response."""
    return f'bt_{FIRST_NODE - 1 + uid}_{what}'


class Events:
    """All events of a model by name and number, with the names of their parameters."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.parameters: list[list[str]] = []
        self.sent: set[int] = set()
        self._numbers: dict[str, int] = {}

    def number(self, name: str) -> int:
        """Return the number of an event; a new name gets a new number."""
        number = self._numbers.get(name)
        if number is None:
            number = self._numbers[name] = len(self.names)
            self.names.append(name)
            self.parameters.append([])
        return number

    def find(self, name: str) -> int | None:
        return self._numbers.get(name)

    def send(self, name: str, parameters: Iterable[str] = ()) -> int:
        """Record that an event has a sender with these parameters, and return its number."""
        number = self.number(name)
        self.sent.add(number)
        known = self.parameters[number]
        known += (one for one in parameters if one not in known)
        return number


# The elements of ASCXML for ROS and behavior trees: the event of each, and the name of the message in its body.

_Roots = Mapping[tuple[str, ...], str]
"""Names in a body (by members), with the event parameters that they represent."""


INTERFACES: Final[Mapping[str, str]] = {
    'ros_topic_publisher': 'topic',
    'ros_topic_subscriber': 'topic',
    'ros_service_server': 'service_name',
    'ros_service_client': 'service_name',
    'ros_action_server': 'action_name',
    'ros_action_client': 'action_name',
}
"""Declarations, with the attribute (or child) that contains the ROS name of the interface."""


@dataclass(frozen=True)
class Callback:
    """A transition on an event, whose name is a template for the names of the interface and the automaton.

    ``roots``: the names in its body (by members), with the parameters that they represent. ``code``: the required value
    of the parameter of this name.
    """

    interface: str
    event: str
    roots: _Roots
    code: int | None = None


_GOAL: Final[_Roots] = {('_action', 'goal_id'): 'goal_id', ('_goal',): FIELD}
_RESULT: Final[_Roots] = {
    ('_action', 'goal_id'): 'goal_id',
    ('_wrapped_result', 'code'): 'code',
    ('_wrapped_result', 'result'): FIELD,
}
_RESULT_EVENT: Final = 'action_{0}_result_handle_client_{1}'
PLAIN_ROOTS: Final[_Roots] = {('_event', 'data'): ''}

CALLBACKS: Final[Mapping[str, Callback]] = {
    'ros_topic_callback': Callback('ros_topic_subscriber', 'topic_{0}_msg', {('_msg',): FIELD}),
    'ros_service_handle_request': Callback('ros_service_server', 'srv_{0}_request', {('_req',): FIELD}),
    'ros_service_handle_response': Callback('ros_service_client', 'srv_{0}_response_client_{1}', {('_res',): FIELD}),
    'ros_action_handle_goal': Callback('ros_action_server', 'action_{0}_goal_handle', _GOAL),
    'ros_action_handle_feedback': Callback(
        'ros_action_client',
        'action_{0}_feedback_handle_client_{1}',
        {('_action', 'goal_id'): 'goal_id', ('_feedback',): FIELD},
    ),
    'ros_action_handle_success_result': Callback('ros_action_client', _RESULT_EVENT, _RESULT, 4),
    'ros_action_handle_canceled_result': Callback('ros_action_client', _RESULT_EVENT, _RESULT, 5),
    'ros_action_handle_aborted_result': Callback('ros_action_client', _RESULT_EVENT, _RESULT, 6),
    'ros_action_handle_thread_start': Callback('ros_action_server', 'action_{0}_thread_start', _GOAL),
    'ros_action_handle_thread_free': Callback('ros_action_server', 'action_{0}_thread_free', {}),
}
"""The codes are those of action_msgs/GoalStatus."""


@dataclass(frozen=True)
class Trigger:
    """The send action for an event of an interface, with fields, and ``extra`` parameters from attributes."""

    interface: str
    event: str
    extra: tuple[str, ...] = ()
    code: int | None = None


TRIGGERS: Final[Mapping[str, Trigger]] = {
    'ros_topic_publish': Trigger('ros_topic_publisher', 'topic_{0}_msg'),
    'ros_service_send_request': Trigger('ros_service_client', 'srv_{0}_req_client_{1}'),
    'ros_service_send_response': Trigger('ros_service_server', 'srv_{0}_response'),
    'ros_action_send_goal': Trigger('ros_action_client', 'action_{0}_goal_req_client_{1}'),
    'ros_action_accept_goal': Trigger('ros_action_server', 'action_{0}_goal_accepted', ('goal_id',)),
    'ros_action_reject_goal': Trigger('ros_action_server', 'action_{0}_goal_rejected', ('goal_id',)),
    'ros_action_start_thread': Trigger('ros_action_server', 'action_{0}_thread_start', ('goal_id', 'thread_id')),
    'ros_action_feedback': Trigger('ros_action_server', 'action_{0}_feedback', ('goal_id',)),
    'ros_action_succeed': Trigger('ros_action_server', 'action_{0}_result', ('goal_id',), 4),
    'ros_action_canceled': Trigger('ros_action_server', 'action_{0}_result', ('goal_id',), 5),
    'ros_action_aborted': Trigger('ros_action_server', 'action_{0}_result', ('goal_id',), 6),
    'ros_action_thread_free': Trigger('ros_action_server', 'action_{0}_thread_free'),
}

BT_CALLBACKS: Final[Mapping[str, str]] = {'bt_tick': 'tick', 'bt_halt': 'halt'}
BT_CHILD_CALLBACKS: Final[Mapping[str, str]] = {
    'bt_child_status': 'response_told',
    'bt_child_halted': 'halt_response_told',
}
BT_CHILD_TRIGGERS: Final[Mapping[str, str]] = {'bt_tick_child': 'tick_asked', 'bt_halt_child': 'halt_asked'}
"""Events between a plugin with children and the tree. The tree ticks the children, so these are not their events."""

STATUSES: Final[Mapping[str, int]] = {'SUCCESS': 1, 'FAILURE': 2, 'RUNNING': 3}
"""Numbers of the statuses of nodes in expressions and properties."""

TRANSITIONS: Final = (
    'transition',
    'ros_rate_callback',
    'ros_action_handle_goal_response',
    *CALLBACKS,
    *BT_CALLBACKS,
    *BT_CHILD_CALLBACKS,
)
ACTIONS: Final = (
    'assign',
    'if',
    'send',
    *TRIGGERS,
    'bt_return_status',
    'bt_return_halted',
    'bt_set_output',
    *BT_CHILD_TRIGGERS,
)

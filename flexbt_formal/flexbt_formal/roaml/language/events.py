# SPDX-License-Identifier: BSD-3-Clause
"""The events by which automata talk: what they are called for topics, services, actions and ticks, what they carry.

The names are those of AS2FM, since properties use them: ``topic_pose_msg``, ``action_go_result``, ``bt_1000_response``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final

FIELD: Final = 'ros_fields__'
"""What precedes the name of a field of a ROS message among the parameters of an event."""
TIMER: Final = 'ros_time_rate.'
SET: Final = 'bt_blackboard_set_'
FIRST_NODE: Final = 1000
"""The number of the root of the tree in the names of events; the others follow in the order of the file."""

_WAITED_FOR: Final = re.compile(
    r'bt_\d+_(tick|halt|response|halt_response)(_asked|_told)?|srv_.+_(response|request|req_client).*'
    r'|action_.+_(goal_.+|result.*|thread_(start|free))'
)


def is_waited_for(name: str) -> bool:
    """Whether an event waits until its receivers come to a state that has a transition for it. Others are discarded by
    whoever has none."""
    return _WAITED_FOR.fullmatch(name) is not None


def ros_name(name: str) -> str:
    """A name of ROS as a part of the name of an event."""
    return name.strip().removeprefix('/').replace('/', '__')


def bt_event(uid: int, what: str) -> str:
    """``what`` is tick, response, halt, or halt_response; ``uid`` counts the nodes of the tree from 1."""
    return f'bt_{FIRST_NODE - 1 + uid}_{what}'


class Events:
    """All events of a model by their names and numbers, with the names of what they carry."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.parameters: list[list[str]] = []
        self.sent: set[int] = set()
        self._numbers: dict[str, int] = {}

    def number(self, name: str) -> int:
        """Of an event, which is new when it was not named before."""
        number = self._numbers.get(name)
        if number is None:
            number = self._numbers[name] = len(self.names)
            self.names.append(name)
            self.parameters.append([])
        return number

    def find(self, name: str) -> int | None:
        return self._numbers.get(name)

    def send(self, name: str, parameters: Iterable[str] = ()) -> int:
        """Tell that somebody sends it, with these parameters; its number."""
        number = self.number(name)
        self.sent.add(number)
        known = self.parameters[number]
        known += (one for one in parameters if one not in known)
        return number

# SPDX-License-Identifier: BSD-3-Clause
"""The status of a node, with the numbers of BehaviorTree.CPP."""

from __future__ import annotations

from enum import Enum, IntEnum


class NodeStatus(IntEnum):
    """The result of a tick of a node, and the status that the node stores.

    SKIPPED is only ever returned: it is never stored, so a skipped node keeps the status that it had.
    """

    IDLE = 0
    RUNNING = 1
    SUCCESS = 2
    FAILURE = 3
    SKIPPED = 4


class NodeKind(Enum):
    """The sort of a node. It decides how many children a node may have."""

    ACTION = 'Action'
    CONDITION = 'Condition'
    CONTROL = 'Control'
    DECORATOR = 'Decorator'
    SUBTREE = 'SubTree'


# The engine compares statuses by identity, many times a microsecond, and Python reads module globals fastest.
IDLE = NodeStatus.IDLE
RUNNING = NodeStatus.RUNNING
SUCCESS = NodeStatus.SUCCESS
FAILURE = NodeStatus.FAILURE
SKIPPED = NodeStatus.SKIPPED

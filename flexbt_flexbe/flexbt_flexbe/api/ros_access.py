# SPDX-License-Identifier: BSD-3-Clause
"""What FlexBE's classes know of ROS: the node of the run, under FlexBE's names.

FlexBE keeps its node in class attributes, so that a process can have one. Here the same attributes are looked up when
they are read, in the run on whose thread that happens.
"""

from __future__ import annotations

from typing import Any

from flexbt_onboard.behaviors import current_run


class _RunNode:
    """A class attribute that is the node of the current run: ``self._node`` and ``MyState._node``."""

    def __get__(self, instance: object, owner: type[Any]) -> Any:
        return current_run().services.runtime.node


class RosAccess:
    """Base of what FlexBE initializes with a node."""

    _node = _RunNode()

    @staticmethod
    def initialize_ros(node: Any) -> None:
        """Does nothing, since the node is that of the run; behaviors written by FlexBE's editor call it."""

# SPDX-License-Identifier: BSD-3-Clause
"""The example of a node type, which its class declares."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from .status import NodeStatus

_NO_ENTRIES: Final[Mapping[str, Any]] = {}


class Example(NamedTuple):
    """A tree that shows a node type: the reference page prints it, and a test runs it.

    ``xml`` is the content of the main tree, ``trees`` has the other trees; both may be indented as docstrings are.
    ``ticks`` is what the ticks give, one after the other, each at the time that the tree asks for. ``before`` and
    ``after`` are entries of the blackboard. A node that needs servers has no ticks: its example is only loaded.
    """

    xml: str
    ticks: tuple[NodeStatus, ...] = ()
    before: Mapping[str, Any] = _NO_ENTRIES
    after: Mapping[str, Any] = _NO_ENTRIES
    trees: str = ''

# SPDX-License-Identifier: BSD-3-Clause
"""Why a tree failed, or where in it something was raised: the nodes from the one at fault up to the root.

Nothing of this is kept while a tree is ticked. A node knows which of its children made it fail, and its own part in
that, until it is ticked again; the chain is put together when somebody asks.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple, Protocol

MOST_LINES: Final = 100


class TracedNode(Protocol):
    """What a trace asks a node."""

    @property
    def id(self) -> str: ...

    @property
    def uid(self) -> int: ...

    @property
    def path(self) -> str: ...

    @property
    def attached(self) -> Sequence[Any]:
        """The children, which are such nodes, too."""

    @property
    def decided_by(self) -> object:
        """What has decided the last result in the place of a tick, as text says it; None: the tick itself."""

    def failure_cause(self) -> Any:
        """The child because of which the node failed just now; None when it failed by itself."""

    def failure_reason(self) -> str:
        """Why the node failed just now."""


class FailureStep(NamedTuple):
    """The path of a node, and its part in what happened."""

    path: str
    reason: str

    def __str__(self) -> str:
        return f'{self.path}: {self.reason}'


class FailureTrace(NamedTuple):
    """The node at fault and its reason come first, then its parent and what that made of it, up to the root."""

    steps: tuple[FailureStep, ...]

    @property
    def path(self) -> str:
        """Path of the node at fault."""
        return self.steps[0].path

    @property
    def reason(self) -> str:
        """Why the node at fault failed."""
        return self.steps[0].reason

    @property
    def chain(self) -> tuple[str, ...]:
        """The paths from the root to the node at fault."""
        return tuple(step.path for step in reversed(self.steps))

    def lines(self, most: int = MOST_LINES) -> list[str]:
        """The steps as ``path: reason``; of more than ``most``, those in the middle are left out, which a line says."""
        steps = self.steps
        if len(steps) <= most:
            return [str(step) for step in steps]
        head = most // 2
        tail = most - head - 1
        between = f'({len(steps) - head - tail} nodes in between)'
        return [*map(str, steps[:head]), between, *map(str, steps[len(steps) - tail :])]


def trace_failure(root: TracedNode) -> FailureTrace:
    """Why ``root`` has failed in its last tick."""
    steps: list[FailureStep] = []
    node: TracedNode | None = root
    while node is not None:
        if node.decided_by is not None:
            steps.append(FailureStep(node.path, f'{node.id}: {node.decided_by}'))
            break
        steps.append(FailureStep(node.path, node.failure_reason()))
        node = node.failure_cause()
    return FailureTrace(tuple(reversed(steps)))


def trace_error(nodes: Sequence[TracedNode], uid: int, reason: str) -> FailureTrace:
    """The way from the node ``uid``, which has raised for ``reason``, up to the root of the tree of these nodes."""
    parents = {child.uid: (node, place) for node in nodes for place, child in enumerate(node.attached, 1)}
    steps = [FailureStep(nodes[uid - 1].path, reason)]
    above = parents.get(uid)
    while above is not None:
        node, place = above
        count = len(node.attached)
        which = f'in child {place} of {count}' if count > 1 else 'in the child'
        steps.append(FailureStep(node.path, f'{node.id}: {which}'))
        above = parents.get(node.uid)
    return FailureTrace(tuple(steps))

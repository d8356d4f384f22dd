# SPDX-License-Identifier: BSD-3-Clause
"""Random machines for tests of the engine against a model: descriptions, and the machines built from them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from random import Random
from typing import Any, Final

from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.definition import Child, StateKind
from flexbt_core.state_machine.model.event_state import EventState

from .bench import Scripted, machine

DEPTH: Final = 4
"""Maximum nesting of machines around a state, without the root."""

STATES: Final = int(os.environ.get('HFSM_STATES', '40'))
"""Approximate maximum number of states of a machine."""

UNDECLARED: Final = -1
_LABELS: Final = 'ABCDEF'


@dataclass(frozen=True)
class Visit:
    """The script of one visit of a state.

    ``kind``: 'go' by ``outcome`` at once, 'wait' for an event, 'ask' the operator, suggesting ``outcome`` (or None), or
    raise in 'on_enter' or 'execute'. ``leaving``: '', 'raise' in on_exit, or 'slow': halts when it is requested.
    """

    kind: str
    outcome: str | None
    leaving: str


@dataclass(eq=False)
class RandomNode:
    """A state or machine of a random machine. ``ways`` maps an outcome to a sibling, or to an outcome of the parent.

    The children of a concurrency container have no ways: its ``conditions`` are tried in order.
    """

    path: str
    outcomes: list[str]
    parent: RandomNode | None = None
    children: list[RandomNode] = field(default_factory=list)
    visits: list[Visit] = field(default_factory=list)
    ways: dict[str, RandomNode | str] = field(default_factory=dict)
    required: dict[str, int] = field(default_factory=dict)
    kind: StateKind = StateKind.STATE
    conditions: list[tuple[str, list[tuple[RandomNode, str]]]] = field(default_factory=list)
    runs_on: bool = False
    """True if it runs while it is blocked."""

    def all(self) -> Iterator[RandomNode]:
        """Yield this node and everything in it."""
        yield self
        for child in self.children:
            yield from child.all()


def random_machine(random: Random, states: int = STATES) -> RandomNode:
    """Return a machine of about ``states`` states, up to DEPTH levels below the root. All states are reachable."""
    root = RandomNode('/', _outcomes(random, ['x', 'y', 'z']))
    _fill(random, root, DEPTH, [states])
    return root


def _outcomes(random: Random, names: list[str]) -> list[str]:
    return random.sample(names, random.randint(1, len(names)))


def _fill(random: Random, node: RandomNode, depth: int, left: list[int]) -> None:
    kinds = [StateKind.MACHINE] * 4 + [StateKind.CONCURRENCY] * 3 + [StateKind.PRIORITY] * 2
    node.kind = random.choice(kinds)
    most = 3 if node.kind is StateKind.CONCURRENCY else len(_LABELS)
    for label in _LABELS[: random.randint(1, most)]:
        path = f'{node.path.rstrip("/")}/{label}'
        is_machine = depth > 0 and left[0] > 0 and random.random() < 0.4
        names = ['x', 'y', 'z'] if is_machine else ['done', 'other', 'failed']
        child = RandomNode(path, _outcomes(random, names), node)
        if is_machine:
            _fill(random, child, depth - 1, left)
        else:
            left[0] -= 1
            child.visits = [_visit(random, child.outcomes) for _ in range(random.randint(1, 3))]
            child.runs_on = random.random() < 0.2
        node.children.append(child)
    for number, child in enumerate(node.children):
        # The first outcome leads to the next sibling, the others anywhere.
        following = node.children[number + 1 : number + 2]
        for outcome in child.outcomes:
            outwards = node.outcomes if node.parent is not None or random.random() < 0.1 else []
            anywhere: list[RandomNode | str] = [*node.children, *outwards]
            if node.kind is not StateKind.CONCURRENCY:
                child.ways[outcome] = following.pop() if following else random.choice(anywhere)
            child.required[outcome] = random.choice([UNDECLARED, 0, 0, 1, 1, 2, 3])
    if node.kind is StateKind.CONCURRENCY:
        node.conditions = list(_conditions(random, node))


def _conditions(random: Random, node: RandomNode) -> Iterator[tuple[str, list[tuple[RandomNode, str]]]]:
    for _ in range(random.randint(0, 3)):
        children = random.sample(node.children, random.randint(1, len(node.children)))
        yield random.choice(node.outcomes), [(child, random.choice(child.outcomes)) for child in children]
    last = random.choice(node.children)  # so that some condition holds when all have ended
    for outcome in last.outcomes:
        yield random.choice(node.outcomes), [(last, outcome)]


def _visit(random: Random, outcomes: list[str]) -> Visit:
    faults = ['on_enter', 'execute'] if 'failed' in outcomes or random.random() < 0.1 else []
    kind = random.choice([*('go', 'wait', 'ask') * 4, *faults])
    outcome = None if kind == 'ask' and random.random() < 0.5 else random.choice(outcomes)
    return Visit(kind, outcome, random.choice([*('', '', 'slow') * 4, *(['raise'] if faults else [])]))


class Puppet(Scripted):
    """A state that follows its list of visits, again and again."""

    def __init__(self, node: RandomNode) -> None:
        super().__init__(*node.outcomes)
        self.node = node
        self.runs_while_blocked = node.runs_on  # type: ignore[misc]
        self.at_rest = True
        self._visit = node.visits[-1]

    def forget(self) -> None:
        """Restart with the first visit."""
        self.trace.clear()
        self._calls.clear()

    def rest(self) -> None:
        """Mark it as halted, whatever it was doing."""
        self.at_rest = True
        self.wake()

    def on_enter(self, userdata: Any) -> None:
        self._visit = self.node.visits[self.calls('on_enter') % len(self.node.visits)]
        self.outcome = self._visit.outcome if self._visit.kind == 'go' else None
        self.at_rest = self._visit.leaving != 'slow'
        super().on_enter(userdata)
        self._raise_in('on_enter')

    def execute(self, userdata: Any) -> str | None:
        self._raise_in('execute')
        if self._visit.kind == 'ask':
            self.ask('?', self._visit.outcome)
            return None
        return super().execute(userdata)

    def on_exit(self, userdata: Any) -> None:
        super().on_exit(userdata)
        if self._visit.leaving == 'raise':
            raise ArithmeticError

    def halting(self) -> str | None:
        return None if self.at_rest else 'busy'

    def _raise_in(self, callback: str) -> None:
        if self._visit.kind == callback:
            raise ArithmeticError


def build(node: RandomNode) -> tuple[OperatableStateMachine, list[Puppet]]:
    """Return the machine built from a node, and its states."""
    children, puppets = [], []
    for child in node.children:
        state: EventState | OperatableStateMachine
        if child.children:
            state, inner = build(child)
        else:
            state = Puppet(child)
            inner = [state]
        puppets += inner
        ways = {name: way if isinstance(way, str) else way.path.rpartition('/')[2] for name, way in child.ways.items()}
        levels = {name: level for name, level in child.required.items() if level != UNDECLARED}
        children.append(Child(child.path.rpartition('/')[2], state, ways, levels))
    conditions = [
        (outcome, [(child.path.rpartition('/')[2], wanted) for child, wanted in ended])
        for outcome, ended in node.conditions
    ]
    made = machine(*children, outcomes=node.outcomes, conditions=conditions, priority=node.kind is StateKind.PRIORITY)
    return made, puppets

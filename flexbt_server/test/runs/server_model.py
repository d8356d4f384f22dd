# SPDX-License-Identifier: BSD-3-Clause
"""Random trees of scripted leaves with the results that they may have, and a model of what a BT server may answer."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from flexbt_common.calls.action_call import GoalOutcome, GoalStatus
from flexbt_msgs.action import BtExecute
from flexbt_testing.behavior_trees.faulty_leaves import FAULTS, NONSENSE
from flexbt_testing.nodes.clients import SentGoal

Result = BtExecute.Result
SUCCESS, FAILURE, ERROR, NEVER = 'success', 'failure', 'error', 'never'
CODES: Final = {SUCCESS: Result.SUCCESS, FAILURE: Result.FAILURE, ERROR: Result.ERROR}


@dataclass(frozen=True)
class Plan:
    """XML of a tree, how it may end when nobody interferes, and whether a halt of it may raise."""

    xml: str
    ends: frozenset[str]
    halt_raises: bool = False


def _leaf(chance: random.Random) -> Plan:
    ms = chance.choice([0, 0, 1, 3, 10, 25])
    letter, end = chance.choice([('S', SUCCESS), ('S', SUCCESS), ('S', SUCCESS), ('F', FAILURE)])
    timed = f'ms="{ms}" result="{letter}"'
    kind = chance.choice(list(FAULTS))
    match chance.randrange(16):
        case 0 | 1:
            return Plan(f'<Runs {timed}/>', frozenset({end}))
        case 2:
            return Plan(f'<Blocking {timed}/>', frozenset({end}))
        case 3 | 4:
            return Plan(f'<SlowToStop {timed}/>', frozenset({end}))
        case 5 | 6:
            return Plan(f'<InThread {timed}/>', frozenset({end}))
        case 7:
            return Plan(f'<RaisesInHalt {timed} kind="{kind}"/>', frozenset({end}), halt_raises=True)
        case 8:
            leaf = chance.choice(['RaisesInTick', 'RaisesInThread', 'RaisesWhileRunning', 'RaisesInCoroutine'])
            return Plan(f'<{leaf} kind="{kind}"/>', frozenset({ERROR}))
        case 9:
            return Plan(f'<Returns what="{chance.choice(list(NONSENSE))}"/>', frozenset({ERROR}))
        case 10:
            return Plan('<BackUp/>', frozenset({NEVER}))  # its server holds its goals
        case 11:
            leaf = chance.choice(['Runs', 'SlowToStop', 'InThread'])
            return Plan(f'<{leaf} ms="100000"/>', frozenset({NEVER}))
        case 12 | 13:
            return Plan('<Spin/>', frozenset({SUCCESS}))
        case _:
            return Plan('<AlwaysSuccess/>', frozenset({SUCCESS}))


def make_plan(chance: random.Random, depth: int = 3) -> Plan:
    """Return a random tree. What it may do is a superset: which child of a Parallel is the first is a matter of
    time."""
    if depth == 0 or chance.random() < 0.25:
        return _leaf(chance)
    if chance.random() < 0.3:
        return _decorated(chance, make_plan(chance, depth - 1))
    children = [make_plan(chance, depth - 1) for _ in range(chance.randint(1, 3))]
    inner = ''.join(child.xml for child in children)
    halt_raises = any(child.halt_raises for child in children)
    match chance.choice(['Sequence', 'Fallback', 'Parallel']):
        case 'Parallel':
            ends = frozenset().union(*(child.ends for child in children)) - {SUCCESS}
            if all(SUCCESS in child.ends for child in children):
                ends |= {SUCCESS}
            if FAILURE in ends and halt_raises:
                ends |= {ERROR}
            return Plan(f'<Parallel>{inner}</Parallel>', ends, halt_raises)
        case tag:
            return Plan(
                f'<{tag}>{inner}</{tag}>', _chain(children, SUCCESS if tag == 'Sequence' else FAILURE), halt_raises
            )


def _chain(children: Sequence[Plan], goes_on: str) -> frozenset[str]:
    ends = frozenset({goes_on})
    for child in children:
        if goes_on in ends:
            ends = (ends - {goes_on}) | child.ends
    return ends


def _decorated(chance: random.Random, child: Plan) -> Plan:
    match chance.choice(['Inverter', 'Timeout', 'Repeat', 'Retry']):
        case 'Inverter':
            swapped = {SUCCESS: FAILURE, FAILURE: SUCCESS}
            ends = frozenset(swapped.get(end, end) for end in child.ends)
            return Plan(f'<Inverter>{child.xml}</Inverter>', ends, child.halt_raises)
        case 'Timeout':
            ends = child.ends - {NEVER} | {FAILURE} | ({ERROR} if child.halt_raises else set())
            return Plan(f'<Timeout msec="20">{child.xml}</Timeout>', ends, child.halt_raises)
        case 'Repeat':
            return Plan(f'<Repeat num_cycles="2">{child.xml}</Repeat>', child.ends, child.halt_raises)
        case _:
            tag = 'RetryUntilSuccessful'
            return Plan(f'<{tag} num_attempts="2">{child.xml}</{tag}>', child.ends, child.halt_raises)


@dataclass(eq=False)
class ModelGoal:
    """A goal that was sent, and what has happened to it since."""

    number: int
    slot: tuple[str, str]
    sent: SentGoal
    plans: list[Plan]
    """Versions of its tree that may be the one that runs for it. Empty: it cannot run, and ends as ERROR."""
    canceled: bool = False
    superseded: bool = False

    def problem(self) -> str:
        """Return what is wrong with its end; '' when the server may answer so."""
        outcome = self.sent.wait()
        if len(self.sent.outcomes) != 1:
            return f'{len(self.sent.outcomes)} outcomes'
        if outcome.result is None:
            unsent = self.canceled and outcome.reason == 'canceled before it was sent'
            return '' if unsent else f'no result: {outcome}'
        return self._problem_of_result(outcome, outcome.result)

    def _problem_of_result(self, outcome: GoalOutcome, result: Any) -> str:
        allowed = {CODES[end] for plan in self.plans for end in plan.ends - {NEVER}} or {Result.ERROR}
        if not self.plans:
            allowed = {Result.ERROR}
        elif all(plan.ends == {NEVER} for plan in self.plans):
            allowed = set()
        if self.canceled or self.superseded:
            allowed.add(Result.CANCELED)
        if self.canceled and any(plan.halt_raises for plan in self.plans):
            allowed.add(Result.ERROR)
        if result.code not in allowed:
            return f'code {result.code}, not in {sorted(allowed)}: {result.message}'
        if 'fault in the BT server' in result.message or 'not halted' in result.message:
            return result.message
        expected = {Result.SUCCESS: {GoalStatus.SUCCEEDED}, Result.CANCELED: {GoalStatus.ABORTED}}
        statuses = expected.get(result.code, {GoalStatus.ABORTED})
        if result.code == Result.CANCELED and self.canceled:
            statuses = {GoalStatus.CANCELED} if 'newer goal' not in result.message else set(GoalStatus)
        if outcome.status not in statuses:
            return f'status {outcome.status} with code {result.code}: {result.message}'
        if result.code == Result.ERROR and self.plans and not result.failed_node:
            return f'no failed node: {result.message}'
        return ''


@dataclass
class Model:
    """What the server has been told."""

    trees: dict[str, list[Plan]] = field(default_factory=dict)
    """Versions of each tree since the server last ran nothing."""
    entries: dict[tuple[str, str], Any] = field(default_factory=dict)
    """(Blackboard, key): value."""
    live: list[ModelGoal] = field(default_factory=list)

    def supersede(self, slot: tuple[str, str]) -> None:
        """Take in a goal for the tree and the blackboard of others."""
        for goal in self.live:
            if goal.slot == slot:
                goal.superseded = True

    def load(self, tree: str, plan: Plan) -> None:
        """Another version of a tree; a goal that waits may run it, one that runs keeps its own."""
        self.trees.setdefault(tree, []).append(plan)

    def rest(self) -> None:
        """All goals have ended: the newest versions are the ones that count."""
        self.live.clear()
        for versions in self.trees.values():
            del versions[:-1]

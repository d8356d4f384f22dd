# SPDX-License-Identifier: BSD-3-Clause
"""The trees that run now, and the goals that they run for. All of this is used on the executor thread."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from geometry_msgs.msg import PoseStamped

from flexbt_common.calls import ServedGoal
from flexbt_core.behavior_tree import Blackboard, Tree, TreeKey
from flexbt_core.clock import Timer
from flexbt_server.errors import UnknownRunError
from flexbt_server.runs import RunOutcome, TreeRun
from flexbt_server.trees import FoundTree, Value

_GOALS_REMEMBERED: Final = 100
"""By which a run is known, at most."""


class TreeGoal(ABC):
    """A goal that is being served by the run of a tree. Used on the executor thread, but for :meth:`read`.

    ``served`` is the goal as the action server has it, ``action`` the name of its action; ``tree`` is the tree that it
    names, by ID or file, ``blackboard`` that on which the tree runs, ``owner`` the node that has to be alive meanwhile,
    if any. ``running`` is set once a tree runs for it, or is asked to; ``stop_reason`` once it is to stop.
    ``leave_queue`` takes it back from the thread that reads files; ``on_ended`` is called when the result was sent.
    """

    def __init__(
        self, served: ServedGoal, accepted: float, action: str, tree: str, blackboard: str, owner: str = ''
    ) -> None:
        self.served = served
        self.accepted = accepted
        self.action = action
        self.tree = tree
        self.blackboard = blackboard
        self.owner = owner
        self.leave_queue: Callable[[], None] = lambda: None
        self.on_ended: Callable[[], None] = lambda: None
        self.stop_reason: str | None = None
        self.notice = ''
        self.running: RunningTree | None = None
        self.found: FoundTree | None = None
        self.values: list[Value] = []

    @abstractmethod
    def read(self) -> list[Value]:
        """What is written to the blackboard before the tree works for this goal; on the thread that reads files.

        Raises:
            FlexbtError: the goal cannot be served.
        """

    def fresh_values(self) -> list[Value]:
        """What is written as well when the tree begins to run for this goal, and not when it takes it over."""
        return []

    def when_ready(self, go_on: Callable[[], None]) -> None:
        """Called when tree and values are known; ``go_on`` begins to work. Or the goal is ended here."""
        go_on()

    @abstractmethod
    def feedback(self, running: RunningTree, tree: Tree, pose: PoseStamped, seconds: float) -> Any:
        """The feedback message. ``pose``: the latest of the robot, without a frame while there is none; ``seconds``
        since the acceptance.
        """

    @abstractmethod
    def result(self, outcome: RunOutcome, seconds: float) -> tuple[int, Any]:
        """How the goal ends, as a code of BtExecute.Result, and the result message."""

    @abstractmethod
    def fault_result(self, why: str) -> Any:
        """The result message when the server is at fault."""


@dataclass(eq=False)
class RunningTree:
    """The run of one tree on one blackboard, and the goal that it works for; ``goal_ids`` are those that it has worked
    for, the last ones: whoever has paused the run for one of them has it go on by the same ID. ``paused_for`` are the
    nodes on whose behalf it was asked to pause, '' for nobody's.
    """

    id: str
    key: TreeKey
    blackboard: str
    board: Blackboard
    """That of this name, which stays as long as somebody holds it."""
    run: TreeRun[TreeGoal]
    goal: TreeGoal
    feedback: Timer | None = None
    goal_ids: deque[str] = field(default_factory=lambda: deque(maxlen=_GOALS_REMEMBERED))
    paused_for: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.works_for(self.goal)

    def works_for(self, goal: TreeGoal) -> None:
        """The run has begun, or was taken over."""
        self.goal = goal
        self.goal_ids.append(goal.served.id.hex())

    @property
    def description(self) -> str:
        """Tree and blackboard, for people."""
        where = f'blackboard {self.blackboard!r}' if self.blackboard else 'the shared blackboard'
        return f'tree {self.key.id!r} on {where}'


class RunningTrees:
    """One run at the most for each tree on each blackboard."""

    def __init__(self) -> None:
        self._running: dict[tuple[TreeKey, str], RunningTree] = {}

    def get(self, key: TreeKey, blackboard: str) -> RunningTree | None:
        """The run of a tree on a blackboard, if there is one."""
        return self._running.get((key, blackboard))

    def __contains__(self, running: RunningTree) -> bool:
        return self.get(running.key, running.blackboard) is running

    def all(self) -> tuple[RunningTree, ...]:
        """Every tree that runs."""
        return tuple(self._running.values())

    def on(self, blackboard: str) -> list[RunningTree]:
        """Those that run on a blackboard."""
        return [running for running in self.all() if running.blackboard == blackboard]

    def add(self, running: RunningTree) -> None:
        """It has begun."""
        self._running[running.key, running.blackboard] = running

    def remove(self, running: RunningTree) -> None:
        """It has ended."""
        del self._running[running.key, running.blackboard]

    def find(self, run_id: str) -> RunningTree:
        """The run of this ID (TreeStructure.run_id), or that works or has worked for the goal of this ID; the only one
        there is for ''.

        Raises:
            UnknownRunError: there is none, or there are several; says which.
        """
        runs = self.all()
        found = [running for running in runs if not run_id or run_id == running.id or run_id in running.goal_ids]
        if len(found) == 1:
            return found[0]
        known = '; '.join(f'{running.id} ({running.description})' for running in runs)
        if not known:
            raise UnknownRunError('no tree is running')
        asked = f'no run has the ID {run_id!r}' if run_id else 'several trees are running; say which by run_id'
        raise UnknownRunError(f'{asked}: {known}')

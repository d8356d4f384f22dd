# SPDX-License-Identifier: BSD-3-Clause
"""The trees that run now, and the goals that they run for. All of this is used on the executor thread."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from flexbt_common.calls import ServedGoal
from flexbt_core.behavior_tree import Blackboard, TreeKey, TreeLibrary
from flexbt_core.clock import Timer
from flexbt_server.errors import UnknownRunError
from flexbt_server.runs import RunOutcome, TreeRun
from flexbt_server.trees import Value


@dataclass(eq=False)
class TreeGoal:
    """A goal that is being served. ``running`` is set once a tree runs for it, or is asked to."""

    served: ServedGoal
    accepted: float
    on_end: Callable[[TreeGoal, RunOutcome], None]
    stop_reason: str | None = None
    notice: str = ''
    running: RunningTree | None = None
    found: tuple[TreeLibrary, TreeKey, list[Value]] | None = None
    """Its tree and its values, once they are known."""

    @property
    def request(self) -> Any:
        """The goal message."""
        return self.served.request

    def end(self, outcome: RunOutcome) -> None:
        """Give the goal its outcome; the first one counts."""
        if self.served.active:
            self.on_end(self, outcome)


@dataclass(eq=False)
class RunningTree:
    """The run of one tree on one blackboard, and the goal that it works for."""

    id: str
    key: TreeKey
    blackboard: str
    board: Blackboard
    """That of this name, which stays as long as somebody holds it."""
    run: TreeRun[TreeGoal]
    goal: TreeGoal
    feedback: Timer | None = None

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
        """The run of this ID (TreeStructure.run_id), or that of the goal of this ID; the only one there is for ''.

        Raises:
            UnknownRunError: there is none, or there are several; says which.
        """
        runs = {running.id: running for running in self.all()}
        by_goal = {running.goal.served.id.hex(): running for running in self.all()}
        only = next(iter(runs.values())) if len(runs) == 1 else None
        found = (runs | by_goal).get(run_id) if run_id else only
        if found is not None:
            return found
        known = '; '.join(f'{running.id} ({running.description})' for running in runs.values())
        if not known:
            raise UnknownRunError('no tree is running')
        asked = f'no run has the ID {run_id!r}' if run_id else 'several trees are running; say which by run_id'
        raise UnknownRunError(f'{asked}: {known}')

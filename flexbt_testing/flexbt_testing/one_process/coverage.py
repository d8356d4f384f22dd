# SPDX-License-Identifier: BSD-3-Clause
"""Which transitions, outcomes and tree nodes the missions of a test run have taken (``--mission-coverage``)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, Final

from flexbt_msgs.msg import TreeStatus

_ENDS: Final = {TreeStatus.SUCCESS: 'SUCCESS', TreeStatus.FAILURE: 'FAILURE'}


class Coverage:
    """What was taken, of all that the behaviors and trees have that were run."""

    def __init__(self) -> None:
        self._behaviors: dict[str, dict[tuple[str, str], None]] = {}
        self._taken: set[tuple[str, str, str]] = set()
        self._trees: dict[str, dict[str, set[int]]] = {}
        self._leaves: set[tuple[str, str]] = set()

    def add_behavior(self, structure: Any) -> None:
        """Add the states of a behavior (BehaviorStructure)."""
        known = self._behaviors.setdefault(structure.behavior, {})
        known |= dict.fromkeys((state.path, outcome) for state in structure.states for outcome in state.outcomes)

    def add_transition(self, behavior: str, path: str, outcome: str) -> None:
        """Note that a state was left by an outcome; one that it does not have, as of a stop, does not count."""
        self._taken.add((behavior, path, outcome))

    def add_tree(self, structure: Any) -> None:
        """Add the nodes of a tree (TreeStructure)."""
        seen = self._trees.setdefault(structure.behavior_tree, {})
        for node in structure.nodes:
            seen.setdefault(node.path, set())
            if node.kind in (node.ACTION, node.CONDITION):
                self._leaves.add((structure.behavior_tree, node.path))

    def add_status(self, tree: str, path: str, status: int) -> None:
        """Note a status of a node."""
        self._trees[tree].setdefault(path, set()).add(status)

    def lines(self) -> Iterator[str]:
        """Yield the report: a line for each behavior and tree, with what was never taken."""
        for behavior, known in sorted(self._behaviors.items()):
            for what, is_of_root in (('transitions', False), ('outcomes', True)):
                those = [key for key in known if (key[0] == '/') is is_of_root]
                missed = [
                    outcome if is_of_root else f'{path} {outcome}'
                    for path, outcome in those
                    if (behavior, path, outcome) not in self._taken
                ]
                yield _line(f'behavior {behavior}: {what}', len(those), missed)
        for tree, seen in sorted(self._trees.items()):
            yield _line(f'tree {tree}: nodes', len(seen), [path for path, statuses in seen.items() if not statuses])
            leaves = [path for path, statuses in seen.items() if statuses and (tree, path) in self._leaves]
            for status, name in _ENDS.items():
                yield _line(
                    f'tree {tree}: leaves with {name}', len(leaves), [one for one in leaves if status not in seen[one]]
                )


def _line(what: str, count: int, missed: Iterable[str]) -> str:
    never = tuple(missed)
    return f'{what} {count - len(never)} of {count}' + (f'; never {", ".join(never)}' if never else '')


COVERAGE: Final = Coverage()
"""The coverage of this test run."""

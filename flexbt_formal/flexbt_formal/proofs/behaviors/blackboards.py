# SPDX-License-Identifier: BSD-3-Clause
"""What the trees of a behavior hand to each other on blackboards, as the machine that runs them sees it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from flexbt_core.behavior_tree import TreeKey
from flexbt_formal.exploration import Report, StateModel, TreeSystem
from flexbt_formal.proofs.trees import GOALS
from flexbt_tools.behaviors import TreeUse, UsedTrees
from flexbt_tools.tree_checks import HOST_KEYS


@dataclass(frozen=True)
class Blackboards:
    """The keys that each tree needs before it begins, and what is known of who writes them."""

    needed: Mapping[TreeKey, frozenset[str]]

    @classmethod
    def of(cls, used: UsedTrees, given: Collection[str] = ()) -> Blackboards:
        """Those of a behavior; its trees are given ``given`` from outside, and what their models name. Raises
        TreeLoadError."""
        library = used.library
        known = {*HOST_KEYS, *given}
        return cls(
            {
                key: TreeSystem(library, key, given=GOALS).needed - known - library.model(key.id).keys()
                for key in dict.fromkeys(use.key for use in used.uses if use.key is not None)
            }
        )

    @property
    def observed(self) -> frozenset[str]:
        """The keys that a tree needs and does not write itself."""
        return frozenset().union(*self.needed.values())

    def reads(self, use: TreeUse) -> frozenset[str]:
        """What has to be there when a state begins that uses the BT server, in words."""
        needed = self.needed[use.key] if use.key is not None else frozenset[str]()
        return _named(needed - use.use.writes.keys(), use)

    def writes(self, use: TreeUse, model: StateModel, outcome: str, report: Report | None) -> frozenset[str]:
        """What is there after an outcome of it, in words. Of a tree that is not known, or not proved, anything may be.

        One that has failed, or was canceled, may have been refused: then it has written nothing.
        """
        if use.runs_unknown:
            return _named(self.observed, use)
        if outcome in model.not_written:
            return frozenset()
        if report is not None and not report.is_proof:
            return _named(self.observed, use)
        by_tree = report.written.get('SUCCESS', frozenset()) if report is not None and outcome == 'done' else ()
        return _named(self.observed.intersection((*use.use.writes, *by_tree)), use)

    def note(self, reports: Mapping[TreeKey, Report]) -> str:
        """What is not known of who writes what, since trees are not proved; '' when there is no such."""
        trees = ', '.join(key.id for key, report in reports.items() if not report.is_proof)
        if not trees or not self.observed:
            return ''
        keys = ', '.join(f'[{key}]' for key in sorted(self.observed))
        return (
            f'not known, and taken as written: {keys} after trees that were not followed to their end, or with which '
            f'something is wrong: {trees}'
        )


def _named(keys: frozenset[str], use: TreeUse) -> frozenset[str]:
    board = f'of the blackboard {use.use.blackboard!r}' if use.use.blackboard else 'of the shared blackboard'
    return frozenset(f'[{key}] {board}' for key in keys)

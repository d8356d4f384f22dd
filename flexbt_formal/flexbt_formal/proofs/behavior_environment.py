# SPDX-License-Identifier: BSD-3-Clause
"""The environment of a behavior in a proof: the possible actions of its states, and the keys that its trees write."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

from flexbt_core.behavior_tree.model.definition import TreeKey
from flexbt_core.state_machine.model.definition import StateDefinition
from flexbt_formal.exploration.model import Report
from flexbt_formal.exploration.state_models import StateModel, StateModelKind, StateModels, state_model
from flexbt_formal.exploration.tree_system import TreeSystem
from flexbt_states import OperatorDecisionState, OperatorInputState
from flexbt_tools.behaviors.built_behavior import TreeUse, UsedTrees
from flexbt_tools.tree_checks.check import HOST_KEYS
from flexbt_tools.tree_checks.resources import tree_resources

from .tree_proof import GOALS


def state_models(used: UsedTrees, reports: Mapping[TreeKey, Report], boards: Blackboards) -> StateModels:
    """Return what stands for the states of a behavior. Of one that runs a tree, what was found about the tree holds."""

    resources = tree_resources(used.library)
    uses = {use.path: use for use in used.uses}

    def model(definition: StateDefinition) -> StateModel:
        state = definition.state.unwrapped
        if isinstance(state, OperatorDecisionState):
            return StateModel(StateModelKind.DECISION, suggestion=state.suggestion)
        found = state_model(definition)
        if isinstance(state, OperatorInputState):  # it is the operator who declines
            return replace(found, canceled=frozenset())
        use = uses.get(definition.path)
        if use is None:
            return found
        report = None if use.key is None else reports.get(use.key)
        writes = {outcome: boards.writes(use, found, outcome, report) for outcome in state.outcomes}
        found = replace(found, reads=boards.reads(use), writes=writes)
        if use.key is None:
            return found
        found = replace(found, resources=frozenset(resources[use.key]), server='BT server')
        if report is None or not report.is_proof:
            return found
        outcomes = state.outcomes
        if 'SUCCESS' not in report.ends:
            outcomes = tuple(one for one in outcomes if one != 'done')
        return replace(found, outcomes=outcomes, outputs=writes.get('done', frozenset()))

    return model


# What the trees of a behavior hand to each other on blackboards, as the machine that runs them sees it.


@dataclass(frozen=True)
class Blackboards:
    """The keys that each tree needs before it begins, and their known writers."""

    needed: Mapping[TreeKey, frozenset[str]]

    @classmethod
    def of(cls, used: UsedTrees, given: Collection[str] = ()) -> Blackboards:
        """Return those of a behavior; its trees are given ``given`` from outside, and what their models name. Raises
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
        """Return what has to be there when a state begins that uses the BT server, in words."""
        needed = self.needed[use.key] if use.key is not None else frozenset[str]()
        return _named(needed - use.use.writes.keys(), use)

    def writes(self, use: TreeUse, model: StateModel, outcome: str, report: Report | None) -> frozenset[str]:
        """Return what is there after an outcome of it, in words. Of a tree that is not known, or not proved, anything
        may be.

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
        """Return which writers are not known since trees are not proved; '' if there are none."""
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

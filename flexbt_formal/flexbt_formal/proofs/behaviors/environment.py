# SPDX-License-Identifier: BSD-3-Clause
"""What our own states may do in a proof, beyond what their classes declare."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from flexbt_core.behavior_tree import TreeKey
from flexbt_core.state_machine import StateDefinition
from flexbt_formal.exploration import (
    Report,
    StateKind,
    StateModel,
    StateModels,
    state_model,
)
from flexbt_states import OperatorDecisionState, OperatorInputState
from flexbt_tools.behaviors import UsedTrees
from flexbt_tools.tree_checks import tree_resources

from .blackboards import Blackboards


def state_models(used: UsedTrees, reports: Mapping[TreeKey, Report], boards: Blackboards) -> StateModels:
    """What stands for the states of a behavior. Of one that runs a tree, what was found about the tree holds."""

    resources = tree_resources(used.library)
    uses = {use.path: use for use in used.uses}

    def model(definition: StateDefinition) -> StateModel:
        state = definition.state.unwrapped
        if isinstance(state, OperatorDecisionState):
            return StateModel(StateKind.DECISION, suggestion=state.suggestion)
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

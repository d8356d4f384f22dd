# SPDX-License-Identifier: BSD-3-Clause
"""What our own states may do in a proof, beyond what their classes declare."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from flexbt_core.behavior_tree import TreeKey, TreeLibrary
from flexbt_core.exploration import (
    Report,
    StateKind,
    StateModel,
    StateModels,
    state_model,
)
from flexbt_core.state_machine import StateDefinition
from flexbt_states import OperatorDecisionState
from flexbt_tools.behaviors import TreeUse
from flexbt_tools.tree_checks import tree_resources


def state_models(uses: Mapping[str, TreeUse], reports: Mapping[TreeKey, Report], library: TreeLibrary) -> StateModels:
    """What stands for the states of a behavior. Of one that runs a tree, what was found about the tree holds."""

    resources = tree_resources(library)

    def model(definition: StateDefinition) -> StateModel:
        state = definition.state.unwrapped
        if isinstance(state, OperatorDecisionState):
            return StateModel(StateKind.DECISION, suggestion=state.suggestion)
        found = state_model(definition)
        use = uses.get(definition.path)
        key = None if use is None else use.key
        if key is None:
            return found
        report = reports.get(key)
        outcomes = state.outcomes
        if report is not None and report.is_complete and 'SUCCESS' not in report.ends:
            outcomes = tuple(one for one in outcomes if one != 'done')
        return replace(found, outcomes=outcomes, resources=frozenset(resources[key]), server='BT server')

    return model

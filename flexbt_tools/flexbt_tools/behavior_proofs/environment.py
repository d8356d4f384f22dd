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
    leaf_model,
    state_model,
)
from flexbt_core.state_machine import StateDefinition
from flexbt_states import OperatorDecisionState
from flexbt_tools.behaviors import TreeUse


def resources_of(library: TreeLibrary, key: TreeKey) -> frozenset[str]:
    """The actuators that leaves of a tree use, those of its sub-trees included."""
    found: set[str] = set()
    seen: set[TreeKey] = set()
    ahead = [key]
    while ahead:
        one = ahead.pop()
        if one in seen:
            continue
        seen.add(one)
        for node in library.definition(one).nodes():
            found |= leaf_model(node).resources
            inner = library.find(node.tree_id, one.file) if node.tree_id is not None else None
            if inner is not None:
                ahead.append(inner)
    return frozenset(found)


def state_models(uses: Mapping[str, TreeUse], reports: Mapping[TreeKey, Report], library: TreeLibrary) -> StateModels:
    """What stands for the states of a behavior. Of one that runs a tree, what was found about the tree holds."""

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
        return replace(found, outcomes=outcomes, resources=resources_of(library, key))

    return model

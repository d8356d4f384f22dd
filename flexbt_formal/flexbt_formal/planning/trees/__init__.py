# SPDX-License-Identifier: BSD-3-Clause
"""Trees of plans: branches and their order, what they have in common, whether they reach the goal, their XML."""

from .compaction import Group, Rule, actions_of, chosen, compact
from .coverage import MOST_STATES, Coverage, Disturbance, explore, fault
from .leaf_elements import (
    AGAIN_ENTRY,
    COUNT_ENTRY,
    FAILURE_ENTRY,
    LAST_ENTRY,
    NOTHING_DONE,
    LeafWriter,
    actions_left,
    add,
    add_last_branch,
    allowed_actions,
    failed_action,
    quoted,
)
from .planner import Plan, compiled, hopeless, plan, why_not
from .policy import Branch, Policy
from .tree_xml import tree_entries, tree_xml

__all__ = [
    'AGAIN_ENTRY',
    'COUNT_ENTRY',
    'FAILURE_ENTRY',
    'LAST_ENTRY',
    'MOST_STATES',
    'NOTHING_DONE',
    'Branch',
    'Coverage',
    'Disturbance',
    'Group',
    'LeafWriter',
    'Plan',
    'Policy',
    'Rule',
    'actions_left',
    'actions_of',
    'add',
    'add_last_branch',
    'allowed_actions',
    'chosen',
    'compact',
    'compiled',
    'explore',
    'failed_action',
    'fault',
    'hopeless',
    'plan',
    'quoted',
    'tree_entries',
    'tree_xml',
    'why_not',
]

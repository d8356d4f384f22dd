# SPDX-License-Identifier: BSD-3-Clause
"""Proofs about trees and behaviors: what may happen to them is followed with the real engines, and told to people."""

from .behavior_proof import BehaviorProof, prove_behavior, replay_behavior
from .environment import state_models
from .proof_text import ProgressLine, report_as_json, report_lines
from .saved_test import behavior_test, tree_test
from .tree_proof import prove_tree, replay_tree

__all__ = [
    'BehaviorProof',
    'ProgressLine',
    'behavior_test',
    'prove_behavior',
    'prove_tree',
    'replay_behavior',
    'replay_tree',
    'report_as_json',
    'report_lines',
    'state_models',
    'tree_test',
]

# SPDX-License-Identifier: BSD-3-Clause
"""Proofs about trees, and how any proof is told: what may happen is followed with the real engines."""

from .comparison_report import Compared, comparison_as_json, comparison_lines
from .model_proof import result_as_json, result_lines
from .moves import moves_of
from .proof_cache import ProofCache
from .proof_json import report_as_json
from .proof_text import ProgressLine, report_lines
from .saved_test import File, Replay, requirement_texts, saved_test
from .tree_proof import GOALS, compare_trees, prove_tree, replay_in, replay_tree, requirements_text

__all__ = [
    'GOALS',
    'Compared',
    'File',
    'ProgressLine',
    'ProofCache',
    'Replay',
    'compare_trees',
    'comparison_as_json',
    'comparison_lines',
    'moves_of',
    'prove_tree',
    'replay_in',
    'replay_tree',
    'report_as_json',
    'report_lines',
    'requirement_texts',
    'requirements_text',
    'result_as_json',
    'result_lines',
    'saved_test',
]

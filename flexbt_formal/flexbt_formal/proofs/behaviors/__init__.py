# SPDX-License-Identifier: BSD-3-Clause
"""Proofs about behaviors, with the trees that they run. Apart from those about trees alone, which need no ROS."""

from .behavior_comparison import Version, compare_behaviors
from .behavior_proof import BehaviorProof, prove_behavior, replay_behavior
from .environment import state_models

__all__ = ['BehaviorProof', 'Version', 'compare_behaviors', 'prove_behavior', 'replay_behavior', 'state_models']

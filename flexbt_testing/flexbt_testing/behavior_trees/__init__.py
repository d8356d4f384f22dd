# SPDX-License-Identifier: BSD-3-Clause
"""Random trees, scripted nodes, and BehaviorTree.CPP as the oracle."""

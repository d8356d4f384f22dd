# SPDX-License-Identifier: BSD-3-Clause
"""Scripted and random trees, faulty nodes, and BehaviorTree.CPP as the oracle."""

# SPDX-License-Identifier: BSD-3-Clause
"""Scripted nodes and trees, trees with known defects, and BehaviorTree.CPP as the oracle.

Its modules are its front doors: who takes one is spared what the others import.
"""

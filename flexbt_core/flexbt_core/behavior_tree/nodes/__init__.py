# SPDX-License-Identifier: BSD-3-Clause
"""The node types of BehaviorTree.CPP, one family in a file."""

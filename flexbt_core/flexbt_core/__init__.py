# SPDX-License-Identifier: BSD-3-Clause
"""Behavior trees (BehaviorTree.CPP), state machines (FlexBE), planning, synthesis, proof, without ROS."""

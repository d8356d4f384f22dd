# SPDX-License-Identifier: BSD-3-Clause
"""Behavior trees (BehaviorTree.CPP) and state machines (FlexBE), with skills and monitors, without ROS."""

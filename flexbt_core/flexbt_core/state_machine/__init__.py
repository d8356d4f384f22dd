# SPDX-License-Identifier: BSD-3-Clause
"""The hierarchical state machine. Pure Python, without ROS."""

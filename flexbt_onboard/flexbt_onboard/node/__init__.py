# SPDX-License-Identifier: BSD-3-Clause
"""The executive and the stop guard as ROS nodes, with their parameters and actions."""

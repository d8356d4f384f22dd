# SPDX-License-Identifier: BSD-3-Clause
"""The behavior-tree engine: XML to definitions to running trees. Pure Python, without ROS."""

# SPDX-License-Identifier: BSD-3-Clause
"""The node types of Nav2 that need no ROS."""

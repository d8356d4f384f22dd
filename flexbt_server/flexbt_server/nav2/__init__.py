# SPDX-License-Identifier: BSD-3-Clause
"""The leaves and decorators of Nav2's trees that reach ROS, of both branches of Nav2."""

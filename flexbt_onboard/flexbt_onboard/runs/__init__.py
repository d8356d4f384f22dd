# SPDX-License-Identifier: BSD-3-Clause
"""Runs of behaviors, each on its own thread and seen as values, and the stopping of them and of the robot."""

# SPDX-License-Identifier: BSD-3-Clause
"""Runs of behaviors, each on its own thread and seen as values, and stops of runs and of the robot."""

# SPDX-License-Identifier: BSD-3-Clause
"""Runs of behaviors, each on a separate thread with immutable snapshots, and stops of runs and of the robot."""

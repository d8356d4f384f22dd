# SPDX-License-Identifier: BSD-3-Clause
"""Runs of behaviors, each on a thread of its own and seen as values, and how they and the robot are stopped."""

# SPDX-License-Identifier: BSD-3-Clause
"""Runs as files: recorded from the topics of a robot, and replayed for the console without one."""

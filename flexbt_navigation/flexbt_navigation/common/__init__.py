# SPDX-License-Identifier: BSD-3-Clause
"""Shared by all navigation servers: ends of goals, checks of requests, frames, and parameters of the robot."""

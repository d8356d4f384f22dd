# SPDX-License-Identifier: BSD-3-Clause
"""What all navigation servers share, ends of goals, checks of requests, frames, and parameters of the robot."""

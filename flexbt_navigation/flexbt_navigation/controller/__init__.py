# SPDX-License-Identifier: BSD-3-Clause
"""The controller server, the motions that drive the robot one at a time, and the path follower."""

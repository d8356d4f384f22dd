# SPDX-License-Identifier: BSD-3-Clause
"""The link to the consoles: status, events, the state of the robot and its nodes, and commands received."""

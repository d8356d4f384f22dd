# SPDX-License-Identifier: BSD-3-Clause
"""The simulated world: maps, robots, sensors. Pure."""

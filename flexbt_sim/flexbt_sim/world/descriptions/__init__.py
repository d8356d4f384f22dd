# SPDX-License-Identifier: BSD-3-Clause
"""What a world file may say: robots, what is round them, and faults, with bounds and meaning of each key."""

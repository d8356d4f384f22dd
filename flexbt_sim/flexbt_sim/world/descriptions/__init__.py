# SPDX-License-Identifier: BSD-3-Clause
"""The contents of world files: robots, what is round them, and faults, with bounds and meaning of each key."""

# SPDX-License-Identifier: BSD-3-Clause
"""A robot plans its way to a goal, and plans anew where the world contradicts."""

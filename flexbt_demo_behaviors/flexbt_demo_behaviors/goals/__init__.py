# SPDX-License-Identifier: BSD-3-Clause
"""A robot plans its way to a goal, and plans again where the world contradicts."""

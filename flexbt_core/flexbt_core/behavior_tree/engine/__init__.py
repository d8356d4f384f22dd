# SPDX-License-Identifier: BSD-3-Clause
"""Nodes and their bases, building a tree, ticking and halting it."""

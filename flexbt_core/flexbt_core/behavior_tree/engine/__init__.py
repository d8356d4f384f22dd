# SPDX-License-Identifier: BSD-3-Clause
"""Nodes and their base classes; building, ticking, halting and observing a tree."""

# SPDX-License-Identifier: BSD-3-Clause
"""From a goal to a tree, for one robot or for a team; the tree is tried before it is returned."""

# SPDX-License-Identifier: BSD-3-Clause
"""A behavior runs a tree, and a leaf of the tree runs a behavior of another executive."""

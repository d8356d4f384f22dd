# SPDX-License-Identifier: BSD-3-Clause
"""Random trees by number: of scripted leaves, with decisions, with scripts, of all nodes, and of nodes of users."""

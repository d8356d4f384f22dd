# SPDX-License-Identifier: BSD-3-Clause
"""Random trees by number: of scripted leaves, with decisions, with scripts, of all nodes, and of nodes of users.

Its modules are its front doors: who takes one is spared what the others import.
"""

# SPDX-License-Identifier: BSD-3-Clause
"""Managed nodes, and whether other nodes and operators are alive and present."""

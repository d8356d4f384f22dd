# SPDX-License-Identifier: BSD-3-Clause
"""Managed nodes, and detection of nodes that are alive and operators that are present."""

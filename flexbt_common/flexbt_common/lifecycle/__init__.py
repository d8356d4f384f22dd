# SPDX-License-Identifier: BSD-3-Clause
"""Managed nodes, their parameters and diagnostics."""

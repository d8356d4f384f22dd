# SPDX-License-Identifier: BSD-3-Clause
"""Positions of a run, restoring and switching."""

# SPDX-License-Identifier: BSD-3-Clause
"""Scripted servers and worlds of nodes."""

# SPDX-License-Identifier: BSD-3-Clause
"""Calls to people about what robots need."""

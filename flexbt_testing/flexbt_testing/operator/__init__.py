# SPDX-License-Identifier: BSD-3-Clause
"""Operators, for tests."""

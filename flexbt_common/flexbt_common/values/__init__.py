# SPDX-License-Identifier: BSD-3-Clause
"""Typed values as messages and as text."""

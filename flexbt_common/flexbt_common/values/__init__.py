# SPDX-License-Identifier: BSD-3-Clause
"""Typed values as messages, as plain data and as text, with their limits."""

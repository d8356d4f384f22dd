# SPDX-License-Identifier: BSD-3-Clause
"""Executives for tests."""

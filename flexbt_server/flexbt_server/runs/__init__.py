# SPDX-License-Identifier: BSD-3-Clause
"""Runs of trees, and who watches them."""

# SPDX-License-Identifier: BSD-3-Clause
"""Runs of trees, and what is published, logged and shown of them."""

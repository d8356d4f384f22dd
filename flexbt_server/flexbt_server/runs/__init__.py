# SPDX-License-Identifier: BSD-3-Clause
"""Runs of trees, their log files, topics, and views in Groot2."""

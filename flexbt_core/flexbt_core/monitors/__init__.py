# SPDX-License-Identifier: BSD-3-Clause
"""Monitors that check a run against rules for every mission and the requirements of one mission."""

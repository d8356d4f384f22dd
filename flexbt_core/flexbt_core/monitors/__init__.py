# SPDX-License-Identifier: BSD-3-Clause
"""Monitors that watch a run for rules that hold for every mission and for requirements of one."""

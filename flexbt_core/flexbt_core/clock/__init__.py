# SPDX-License-Identifier: BSD-3-Clause
"""Clocks, timers and how threads wait: time is an object that is handed in."""

# SPDX-License-Identifier: BSD-3-Clause
"""Clocks, timers, and threads that wait."""

# SPDX-License-Identifier: BSD-3-Clause
"""A run of a machine: regions, leaves, operator commands, monitors, resuming elsewhere."""

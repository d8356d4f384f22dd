# SPDX-License-Identifier: BSD-3-Clause
"""A run of a machine: regions, leaves, events, operator commands, and resuming in another run."""

# SPDX-License-Identifier: BSD-3-Clause
"""Demonstrations 1 and 2: a robot drives to the goals of its operator."""

# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors without a robot: checked, shown and drawn with their trees."""

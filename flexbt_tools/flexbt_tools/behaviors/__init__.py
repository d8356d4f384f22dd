# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors without a robot: built but never run, checked with the trees that they use, shown, drawn."""

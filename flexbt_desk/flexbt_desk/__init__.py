# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors at the desk: checked, shown and drawn together with their trees, without a robot and without running."""

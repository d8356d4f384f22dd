# SPDX-License-Identifier: BSD-3-Clause
"""The commands that this package adds to ``bt_tool`` and ``behavior_tool``."""

# SPDX-License-Identifier: BSD-3-Clause
"""The commands ``prove`` and ``synthesize`` of ``behavior_tool``."""

# SPDX-License-Identifier: BSD-3-Clause
"""The commands ``prove`` and ``plan`` of ``bt_tool``."""

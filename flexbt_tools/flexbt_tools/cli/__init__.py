# SPDX-License-Identifier: BSD-3-Clause
"""The executables ``bt_tool``, ``behavior_tool`` and ``security_policy``."""

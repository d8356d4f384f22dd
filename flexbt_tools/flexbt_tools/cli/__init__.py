# SPDX-License-Identifier: BSD-3-Clause
"""The executables bt_tool and behavior_tool."""

# SPDX-License-Identifier: BSD-3-Clause
"""The errors of the BT server (those of the engine are in behavior_tree.errors).

FlexbtError
└── BtServerError
    ├── ServerParameterError    a parameter has a value that cannot work
    ├── UnknownTreeError        a goal names a tree that is not loaded and cannot be
    ├── UnknownRunError         a command names a run that does not exist, or is ambiguous
    └── BreakpointError         a breakpoint cannot be set or cleared
"""

from __future__ import annotations

from flexbt_core.errors import FlexbtError


class BtServerError(FlexbtError):
    """Base of the errors of the BT server."""


class ServerParameterError(BtServerError):
    """A parameter of the node has a value that cannot work."""


class UnknownTreeError(BtServerError):
    """A goal names a tree that is not loaded and cannot be."""


class UnknownRunError(BtServerError):
    """A command names a run that does not exist, or is ambiguous."""


class BreakpointError(BtServerError):
    """A breakpoint cannot be set or cleared: its node does not exist, or its condition is wrong."""

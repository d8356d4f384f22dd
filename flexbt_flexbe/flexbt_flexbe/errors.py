# SPDX-License-Identifier: BSD-3-Clause
"""The errors of flexbt_flexbe.

FlexbtError
├── ProxyError          a proxy was used incorrectly, or cannot serve a request
│   └── NoResultError   a goal or request ended without a result
├── ShimError           FlexBE's modules cannot be replaced
└── FlexbeManifestError a behavior's manifest or class cannot be used
"""

from __future__ import annotations

from flexbt_core.errors import FlexbtError


class ProxyError(FlexbtError, ValueError):
    """A proxy was used incorrectly. (FlexBE raises ValueError, which states catch.)"""


class NoResultError(ProxyError):
    """A goal or request ended without a result; the text describes the end."""


class ShimError(FlexbtError, ImportError):
    """FlexBE's modules cannot be replaced."""


class FlexbeManifestError(FlexbtError):
    """A behavior's manifest, or the class named in it, cannot be used."""

# SPDX-License-Identifier: BSD-3-Clause
"""Fields of Nav2's interfaces that differ between its branches jazzy and main: by what the installed ones have."""

from __future__ import annotations

from typing import Any


def set_success(response: Any) -> None:
    """Say that it was done; the costmaps' services of jazzy have no words for it."""
    if hasattr(response, 'success'):
        response.success = True

# SPDX-License-Identifier: BSD-3-Clause
"""Errors of the studio.

::

    FlexbtError
    └── StudioError            what was asked for cannot be done; the message says why, and what to do
        ├── GestureError       an edit of a document that does not apply to it
        └── ConflictError      the document has another version, or its file was changed by somebody else
"""

from __future__ import annotations

from flexbt_core.errors import FlexbtError


class StudioError(FlexbtError):
    """What was asked for cannot be done. The message says why, and what to do."""


class GestureError(StudioError):
    """An edit that does not apply to this document, or to this part of it."""


class ConflictError(StudioError):
    """The document has another version than the one that was edited, or its file was changed by somebody else."""

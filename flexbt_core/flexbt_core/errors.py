# SPDX-License-Identifier: BSD-3-Clause
"""The base of all errors that are meant for people."""

from __future__ import annotations


class FlexbtError(Exception):
    """Base of the errors that FlexBT raises for bad input; its text is fit for the operator."""

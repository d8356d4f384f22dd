# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_core.core.event_state``."""

from flexbt_flexbe import EventState

__all__ = ['EventState']

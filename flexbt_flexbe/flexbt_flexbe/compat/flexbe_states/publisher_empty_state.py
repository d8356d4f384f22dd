# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_states.publisher_empty_state``."""

from flexbt_flexbe.states import PublisherEmptyState

__all__ = ['PublisherEmptyState']

# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_states.publisher_bool_state``."""

from flexbt_flexbe.states import PublisherBoolState

__all__ = ['PublisherBoolState']

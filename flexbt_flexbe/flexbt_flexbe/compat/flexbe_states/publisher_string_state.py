# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_states.publisher_string_state``."""

from flexbt_flexbe.states import PublisherStringState

__all__ = ['PublisherStringState']

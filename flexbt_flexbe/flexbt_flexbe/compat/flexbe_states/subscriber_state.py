# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_states.subscriber_state``."""

from flexbt_flexbe.states import SubscriberState

__all__ = ['SubscriberState']

# SPDX-License-Identifier: BSD-3-Clause
"""States that publish and subscribe."""

from .publish_once_state import PublishOnceState
from .subscribe_once_state import SubscribeOnceState
from .subscriber_state import SubscriberState

__all__ = ['PublishOnceState', 'SubscribeOnceState', 'SubscriberState']

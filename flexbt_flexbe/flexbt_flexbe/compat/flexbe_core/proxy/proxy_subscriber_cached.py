# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_core.proxy.proxy_subscriber_cached``."""

from flexbt_flexbe.proxy import ProxySubscriberCached

__all__ = ['ProxySubscriberCached']

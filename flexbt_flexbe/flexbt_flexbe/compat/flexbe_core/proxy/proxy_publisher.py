# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_core.proxy.proxy_publisher``."""

from flexbt_flexbe.proxy import ProxyPublisher

__all__ = ['ProxyPublisher']

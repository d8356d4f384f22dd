# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_core.proxy.proxy_service_caller``."""

from flexbt_flexbe.proxy import ProxyServiceCaller

__all__ = ['ProxyServiceCaller']

# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_core.proxy.proxy_action_client``."""

from flexbt_flexbe.proxy import ProxyActionClient

__all__ = ['ProxyActionClient']

# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_core.proxy.proxy_transform_listener``."""

from flexbt_flexbe.proxy import ProxyTransformListener

__all__ = ['ProxyTransformListener']

# SPDX-License-Identifier: BSD-3-Clause
"""The node ``navigation`` with its servers."""

from .navigation_parameters import declare_navigation_parameters
from .navigation_servers import Navigation

__all__ = ['Navigation', 'declare_navigation_parameters']

# SPDX-License-Identifier: BSD-3-Clause
"""The actions and services of Nav2's route server: routes are computed, shown and tracked."""

from .server import RouteServer

__all__ = ['RouteServer']

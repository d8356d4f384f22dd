# SPDX-License-Identifier: BSD-3-Clause
"""Managed nodes: their transitions, what they make when they are configured, and what they tell /diagnostics."""

from .diagnostics import DiagnosticsPublisher, diagnostic_status
from .managed_node import SHUTTING_DOWN, ManagedNode, run_managed_node, unconfigured
from .managed_part import ManagedPart
from .node_scope import NodeScope

__all__ = [
    'SHUTTING_DOWN',
    'DiagnosticsPublisher',
    'ManagedNode',
    'ManagedPart',
    'NodeScope',
    'diagnostic_status',
    'run_managed_node',
    'unconfigured',
]

# SPDX-License-Identifier: BSD-3-Clause
"""What is wrong, or suspicious, in tree files."""

from .check import check_trees, joined
from .diagnostics import (
    MISSION,
    NEVER_WRITTEN,
    REFUSED,
    RULES,
    SHARED_RESOURCE,
    TOO_SHORT,
    TYPE_CLASH,
    UNUSED_PORT,
    Diagnostic,
    Rule,
    Severity,
)
from .lint import HOST_KEYS, findings, lost_write
from .reachability import least_times, never_ticked, short_limits
from .resources import Resources, tree_resources

__all__ = [
    'HOST_KEYS',
    'MISSION',
    'NEVER_WRITTEN',
    'REFUSED',
    'RULES',
    'SHARED_RESOURCE',
    'TOO_SHORT',
    'TYPE_CLASH',
    'UNUSED_PORT',
    'Diagnostic',
    'Resources',
    'Rule',
    'Severity',
    'check_trees',
    'findings',
    'joined',
    'least_times',
    'lost_write',
    'never_ticked',
    'short_limits',
    'tree_resources',
]

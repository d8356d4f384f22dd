# SPDX-License-Identifier: BSD-3-Clause
"""What is wrong, or suspicious, in tree files."""

from .check import check_trees, joined
from .diagnostics import (
    MISSION,
    NEVER_WRITTEN,
    REFUSED,
    RULES,
    SHARED_RESOURCE,
    TYPE_CLASH,
    UNUSED_PORT,
    Diagnostic,
    Rule,
    Severity,
)
from .lint import HOST_KEYS, findings
from .reachability import never_ticked
from .resources import Resources, tree_resources

__all__ = [
    'HOST_KEYS',
    'MISSION',
    'NEVER_WRITTEN',
    'REFUSED',
    'RULES',
    'SHARED_RESOURCE',
    'TYPE_CLASH',
    'UNUSED_PORT',
    'Diagnostic',
    'Resources',
    'Rule',
    'Severity',
    'check_trees',
    'findings',
    'joined',
    'never_ticked',
    'tree_resources',
]

# SPDX-License-Identifier: BSD-3-Clause
"""The node types, one family a file."""

from .builtin import builtin_registry
from .loops import Loop

__all__ = ['Loop', 'builtin_registry']

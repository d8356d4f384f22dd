# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_core.core.priority_container``."""

from flexbt_flexbe import PriorityContainer

__all__ = ['PriorityContainer']

# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_core.behavior``."""

from flexbt_flexbe import Behavior

__all__ = ['Behavior']

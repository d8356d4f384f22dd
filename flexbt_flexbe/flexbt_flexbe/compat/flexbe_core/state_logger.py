# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_core.state_logger``."""

from flexbt_flexbe import StateLogger

__all__ = ['StateLogger']

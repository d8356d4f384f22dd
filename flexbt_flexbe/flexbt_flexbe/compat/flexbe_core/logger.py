# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_core.logger``."""

from flexbt_flexbe import Logger

__all__ = ['Logger']

# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_core.core.user_data``."""

from flexbt_flexbe import UserData

__all__ = ['UserData']

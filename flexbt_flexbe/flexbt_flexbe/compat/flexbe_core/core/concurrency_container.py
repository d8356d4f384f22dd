# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_core.core.concurrency_container``."""

from flexbt_flexbe import ConcurrencyContainer

__all__ = ['ConcurrencyContainer']

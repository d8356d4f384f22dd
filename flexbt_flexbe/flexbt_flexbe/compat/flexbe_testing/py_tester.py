# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_testing.py_tester``."""

from flexbt_flexbe.testing import PyTester

__all__ = ['PyTester']

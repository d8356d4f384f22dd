# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's tests of states and behaviors (``.test`` files, ``PyTester``), run on FlexBT's engine.

``python3 -m flexbt_testing.flexbe FILE.test ...`` runs files; the exit code is 1 when one fails. In tests in Python
there is :func:`run_state_test`, and FlexBE's ``flexbe_testing.py_tester.PyTester`` for those that use it.
"""

from .py_tester import PyTester
from .state_test_file import StateTestError, read_state_test
from .state_test_run import run_state_test

__all__ = ['PyTester', 'StateTestError', 'read_state_test', 'run_state_test']

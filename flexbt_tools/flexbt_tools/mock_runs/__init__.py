# SPDX-License-Identifier: BSD-3-Clause
"""Trees that run without a robot, with mocks."""

from .mock_plan import read_plan
from .mock_run import DEFAULT_RATE, MockRun
from .report import JsonPrinter, TextPrinter, ended

__all__ = ['DEFAULT_RATE', 'JsonPrinter', 'MockRun', 'TextPrinter', 'ended', 'read_plan']

# SPDX-License-Identifier: BSD-3-Clause
"""Damages texts at random and reads them: ``python3 -m flexbt_testing.fuzzing --seconds 600``."""

from .fuzzer import CORPUS, Fuzzer, Target
from .targets import TARGETS

__all__ = ['CORPUS', 'TARGETS', 'Fuzzer', 'Target']

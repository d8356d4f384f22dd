# SPDX-License-Identifier: BSD-3-Clause
"""The line mode: one command, its answer, an exit code."""

from .line_mode import Session, run

__all__ = ['Session', 'run']

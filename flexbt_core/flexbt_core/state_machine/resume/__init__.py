# SPDX-License-Identifier: BSD-3-Clause
"""Going on where another run was, or with another machine."""

from .position import Position
from .restoring import position_of, reasons_against, start_at
from .switching import switch_machine

__all__ = [
    'Position',
    'position_of',
    'reasons_against',
    'start_at',
    'switch_machine',
]

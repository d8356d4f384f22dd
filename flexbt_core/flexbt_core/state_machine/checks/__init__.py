# SPDX-License-Identifier: BSD-3-Clause
"""A machine as a whole: targets, conditions, data flow, endings."""

from .data_flow import LostWrite, Race, Read, lost_writes, problems_of_reads, races, unsure_reads
from .machine_check import problems_of

__all__ = [
    'LostWrite',
    'Race',
    'Read',
    'lost_writes',
    'problems_of',
    'problems_of_reads',
    'races',
    'unsure_reads',
]

# SPDX-License-Identifier: BSD-3-Clause
"""The cheapest plan: what can be reached from the start, lower bounds of costs, and the search back from the goal."""

from .reachability import Reachability
from .search import Outcome, Progress, SearchResult, Step, search

__all__ = [
    'Outcome',
    'Progress',
    'Reachability',
    'SearchResult',
    'Step',
    'search',
]

# SPDX-License-Identifier: BSD-3-Clause
"""Why there is no machine: the smallest conflict in the user's words, and a play against the world."""

from .counter_play import CounterPlay
from .explanation import Explanation, Kind, explained
from .play_text import Step, said_answers, said_state, said_world

__all__ = ['CounterPlay', 'Explanation', 'Kind', 'Step', 'explained', 'said_answers', 'said_state', 'said_world']

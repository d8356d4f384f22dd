# SPDX-License-Identifier: BSD-3-Clause
"""Why there is no machine: the smallest conflict in the user's words, and a play against the world."""

from .counter_play import CounterPlay
from .explanation import Explanation, Kind, explained
from .play_text import Step, answers_text, state_text, world_text

__all__ = ['CounterPlay', 'Explanation', 'Kind', 'Step', 'answers_text', 'explained', 'state_text', 'world_text']

# SPDX-License-Identifier: BSD-3-Clause
"""Executives for tests: the real one with a console to supervise it, and a scripted one for consoles."""

from .bench import DEADLINE, ConsoleBench, ExecutiveBench, behavior_of, entry_of
from .scripted_executive import Faults, ScriptedExecutive

__all__ = ['DEADLINE', 'ConsoleBench', 'ExecutiveBench', 'Faults', 'ScriptedExecutive', 'behavior_of', 'entry_of']

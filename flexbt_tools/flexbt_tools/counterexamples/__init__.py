# SPDX-License-Identifier: BSD-3-Clause
"""What a proof or a synthesis says "no" with, to be looked at: sequence diagrams, and recordings for the console."""

from .course_of_events import course_diagram
from .files import draw_counterexamples, draw_diagram, record_counterexamples
from .way_diagram import way_diagram

__all__ = ['course_diagram', 'draw_counterexamples', 'draw_diagram', 'record_counterexamples', 'way_diagram']

# SPDX-License-Identifier: BSD-3-Clause
"""What a proof or a synthesis says "no" with, to be looked at: sequence diagrams, and recordings for the console."""

from .counterstrategy_diagram import counterstrategy_diagram
from .files import draw_counterexamples, draw_diagram, record_counterexamples

__all__ = ['counterstrategy_diagram', 'draw_counterexamples', 'draw_diagram', 'record_counterexamples']

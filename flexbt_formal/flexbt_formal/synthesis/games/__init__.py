# SPDX-License-Identifier: BSD-3-Clause
"""Games between the world and the system, of the form GR(1): specifications, who wins, how, and the proof of it."""

from .certificate import check_certificate
from .encoding import Diagram, Encoding
from .enumeration import valuations
from .formula import FALSE, TRUE, Compare, Formula, Join, Name, Not, Number, Sum, Truth, names_in, value_of
from .formula_parser import FormulaError, parse_formula
from .solver import FAIR, Game, Layer, Removal, Solution, Watch
from .specification import Line, Section, Specification, Variable
from .strategy import Node, Strategy, strategy_of

__all__ = [
    'FAIR',
    'FALSE',
    'TRUE',
    'Compare',
    'Diagram',
    'Encoding',
    'Formula',
    'FormulaError',
    'Game',
    'Join',
    'Layer',
    'Line',
    'Name',
    'Node',
    'Not',
    'Number',
    'Removal',
    'Section',
    'Solution',
    'Specification',
    'Strategy',
    'Sum',
    'Truth',
    'Variable',
    'Watch',
    'check_certificate',
    'names_in',
    'parse_formula',
    'strategy_of',
    'valuations',
    'value_of',
]

# SPDX-License-Identifier: BSD-3-Clause
"""ASCXML, the language of the automata of a model: its files, expressions, types of data and events."""

from .ascxml import Ascxml, Communication, Instance, is_pointer, ports_of
from .automaton import Action, Around, Automaton, Branches, LocalState, Send, State, Target, Transition, Write
from .data_types import DataType, DataTypeError, DataTypes
from .draws import Draws, EnumeratedDraws, ManyValuesError, SampledDraws
from .events import FIELD, SET, TIMER, Events, bt_event, is_waited_for
from .expressions import (
    Array,
    Call,
    Evaluated,
    Expression,
    ExpressionError,
    Literal,
    Name,
    compiled,
    constant,
    names_in,
    parse_expression,
)
from .source_text import ModelError, ModelFault, Node, read_text, read_xml
from .values import Record

__all__ = [
    'FIELD',
    'SET',
    'TIMER',
    'Action',
    'Around',
    'Array',
    'Ascxml',
    'Automaton',
    'Branches',
    'Call',
    'Communication',
    'DataType',
    'DataTypeError',
    'DataTypes',
    'Draws',
    'EnumeratedDraws',
    'Evaluated',
    'Events',
    'Expression',
    'ExpressionError',
    'Instance',
    'Literal',
    'LocalState',
    'ManyValuesError',
    'ModelError',
    'ModelFault',
    'Name',
    'Node',
    'Record',
    'SampledDraws',
    'Send',
    'State',
    'Target',
    'Transition',
    'Write',
    'bt_event',
    'compiled',
    'constant',
    'is_pointer',
    'is_waited_for',
    'names_in',
    'parse_expression',
    'ports_of',
    'read_text',
    'read_xml',
]

# SPDX-License-Identifier: BSD-3-Clause
"""The scripting language of BehaviorTree.CPP: lexer, parser, values, interpreter."""

from .compiled_script import CONDITION, SCRIPT, BoundScript, CompiledScript, ScriptLibrary
from .parser import Assignment, Binary, Comparison, Conditional, Expression, Literal, Name, Unary, parse_script
from .values import SAME_NUMBER, SMALL_TEXT

__all__ = [
    'CONDITION',
    'SAME_NUMBER',
    'SCRIPT',
    'SMALL_TEXT',
    'Assignment',
    'Binary',
    'BoundScript',
    'Comparison',
    'CompiledScript',
    'Conditional',
    'Expression',
    'Literal',
    'Name',
    'ScriptLibrary',
    'Unary',
    'parse_script',
]

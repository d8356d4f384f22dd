# SPDX-License-Identifier: BSD-3-Clause
"""XML text to elements to definitions; formats 3 and 4."""

from .format3 import is_format_3, make_format_4
from .node_elements import elements_of
from .parser import MAX_BYTES, MAX_DEPTH, Element, decode, parse
from .reader import IncludeResolver, load_xml

__all__ = [
    'MAX_BYTES',
    'MAX_DEPTH',
    'Element',
    'IncludeResolver',
    'decode',
    'elements_of',
    'is_format_3',
    'load_xml',
    'make_format_4',
    'parse',
]

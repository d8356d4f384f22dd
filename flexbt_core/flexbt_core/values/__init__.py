# SPDX-License-Identifier: BSD-3-Clause
"""Text and data from others, with bounds: JSON, YAML, terminal-safe and message-safe text, XML, files of places."""

from typing import TYPE_CHECKING, Any

from .counts import counted
from .escaping import lines, one_line
from .excerpts import excerpt, shown
from .finite_numbers import finite_number
from .message_text import sendable
from .nested_json import load_json
from .places import Place, load_places
from .similar_names import hint, similar_names
from .text_files import TextFileError, open_private, open_regular, read_text, write_text
from .xml_text import xml_attribute, xml_text

if TYPE_CHECKING:
    from .nested_yaml import YamlError, compose_yaml, construct_yaml, load_yaml
    from .yaml_parts import YamlParts, line_of

__all__ = [
    'Place',
    'TextFileError',
    'YamlError',
    'YamlParts',
    'compose_yaml',
    'construct_yaml',
    'counted',
    'excerpt',
    'finite_number',
    'hint',
    'line_of',
    'lines',
    'load_json',
    'load_places',
    'load_yaml',
    'one_line',
    'open_private',
    'open_regular',
    'read_text',
    'sendable',
    'shown',
    'similar_names',
    'write_text',
    'xml_attribute',
    'xml_text',
]

if not TYPE_CHECKING:  # type checkers would take any name for one of this module

    def __getattr__(name: str) -> Any:
        """PyYAML takes a while to be imported, and most who want text need none of it."""
        if name not in __all__:
            raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
        from . import nested_yaml, yaml_parts

        return getattr(nested_yaml, name, None) or getattr(yaml_parts, name)

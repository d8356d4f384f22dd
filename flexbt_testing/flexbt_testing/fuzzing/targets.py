# SPDX-License-Identifier: BSD-3-Clause
"""The targets by their names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from .executive_targets import CommandTarget, JournalTarget
from .fuzzer import Target
from .text_targets import ScriptTarget, ValueTarget, YamlTarget
from .xml_target import XmlTarget

TARGETS: Final[Mapping[str, Callable[[], Target]]] = {
    'xml': XmlTarget,
    'yaml': YamlTarget,
    'script': ScriptTarget,
    'value': ValueTarget,
    'command': CommandTarget,
    'journal': JournalTarget,
}
"""What makes each target."""

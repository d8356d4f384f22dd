# SPDX-License-Identifier: BSD-3-Clause
"""The targets by their names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from .fuzzer import Target
from .text_targets import ScriptTarget, ValueTarget, YamlTarget
from .xml_target import XmlTarget

TARGETS: Final[Mapping[str, Callable[[], Target]]] = {
    'xml': XmlTarget,
    'yaml': YamlTarget,
    'script': ScriptTarget,
    'value': ValueTarget,
}
"""What makes each target."""

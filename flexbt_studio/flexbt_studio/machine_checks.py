# SPDX-License-Identifier: BSD-3-Clause
"""Checks of machines in a process: it makes their states, whose code may do anything, even never end.

The process reads ``{"root": …, "file": …, "text": …}`` and answers ``{"findings": […]}`` with spans in characters, or
``{"error": …}``.
"""

from __future__ import annotations

import json
import os
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from flexbt_core.behavior_tree.engine.registry import node_skills
from flexbt_core.errors import FlexbtError
from flexbt_server.node_types import node_registry

from .documents.diagnostics import Checker, Finding, Fix
from .documents.project import Project
from .documents.text import Span, TextEdit
from .errors import StudioError
from .worker import Worker

MACHINE_SECONDS: Final = 10.0
"""Time for the check of a machine, s; it makes the states."""


class MachineChecks:
    """The process that checks machines. Use it from one thread at a time."""

    def __init__(self) -> None:
        self._worker = Worker(__name__)

    def close(self) -> None:
        """End the process. From any thread."""
        self._worker.close()

    def findings(self, root: str | Path, file: str, text: str) -> list[Finding]:
        """Return the findings for a machine with this text in the project ``root``. Raises StudioError."""
        try:
            answer = self._worker.ask({'root': str(root), 'file': file, 'text': text}, MACHINE_SECONDS)
        except (OSError, ValueError) as error:
            raise StudioError(f'{file} could not be checked: a state of it hangs or ends: {error}') from error
        if 'error' in answer:
            raise StudioError(answer['error'])
        return [_finding(**one) for one in answer['findings']]


def _finding(record: Any, span: list[int], path: str, fixes: list[dict[str, Any]]) -> Finding:
    made = [Fix(one['title'], [TextEdit(*edit) for edit in one['edits']]) for one in fixes]
    return Finding(record, Span(*span), path, made)


def main() -> None:
    """Answer until the input ends."""
    answers = os.fdopen(os.dup(1), 'w', encoding='utf-8')
    os.dup2(2, 1)  # what states print is no answer
    registry = node_registry(lambda nodes, error: None)
    skills = node_skills(registry, lambda text: None)
    print('ready', file=answers, flush=True)
    for line in sys.stdin:
        asked = json.loads(line)
        project = Project(asked['root'])
        try:
            project.adopt(asked['file'], asked['text'])
            found = Checker(project, registry, skills).findings(asked['file'])
            answer: dict[str, Any] = {'findings': [asdict(one) for one in found]}
        except FlexbtError as error:
            answer = {'error': str(error)}
        print(json.dumps(answer), file=answers, flush=True)

# SPDX-License-Identifier: BSD-3-Clause
"""A worker that checks machines: it makes their states, whose code may do anything, even never end.

It reads ``{"root": …, "file": …, "text": …}`` and answers ``{"findings": […]}`` with spans in characters, or
``{"error": …}``.
"""

from __future__ import annotations

import json
import os
import sys
from dataclasses import asdict
from typing import Any

from flexbt_core.behavior_tree.engine.registry import node_skills
from flexbt_core.errors import FlexbtError
from flexbt_server.node_types import node_registry
from flexbt_studio.documents.diagnostics import Checker
from flexbt_studio.documents.project import Project


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

# SPDX-License-Identifier: BSD-3-Clause
"""The examples of the page about scripts."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.script.interpreter import ScriptLibrary

PAGE = (Path(__file__).parents[4] / 'docs' / 'reference' / 'bt_scripts.md').read_text().replace(r'\|', '|')
VALUES = re.findall(r"^\| `(.+)` \| ([-\d.']+.*) \|$", PAGE, re.MULTILINE)
ENTRIES = re.findall(r'^\| `(.+)` \| (\w+) = (\S+) \|$', PAGE, re.MULTILINE)


def test_the_page_has_examples() -> None:
    assert len(VALUES) >= 15
    assert len(ENTRIES) >= 5


@pytest.mark.parametrize(('text', 'value'), VALUES)
def test_a_script_has_the_value_on_the_page(text: str, value: str) -> None:
    script = ScriptLibrary().script(text)
    assert repr(script.evaluate(script.scope(Blackboard()))) == repr(ast.literal_eval(value))


@pytest.mark.parametrize(('text', 'key', 'value'), ENTRIES)
def test_a_script_leaves_the_entry_on_the_page(text: str, key: str, value: str) -> None:
    board = Blackboard()
    script = ScriptLibrary().script(text)
    script.evaluate(script.scope(board))
    assert repr(board.get(key)) == repr(ast.literal_eval(value))

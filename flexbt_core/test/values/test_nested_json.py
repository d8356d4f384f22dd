# SPDX-License-Identifier: BSD-3-Clause
"""JSON that is nested too deep is refused before the parser sees it, and nothing else is."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexbt_core.values.json_data import MAX_JSON_DEPTH, load_json

texts = st.text(st.sampled_from('[]{}"\\a:,0'), max_size=40)
documents = st.recursive(
    texts | st.none() | st.integers(), lambda inner: st.lists(inner) | st.dictionaries(texts, inner)
)


@given(documents, st.integers(MAX_JSON_DEPTH - 3, MAX_JSON_DEPTH + 3))
def test_the_depth_decides(document: object, depth: int) -> None:
    text = json.dumps(document)
    assert load_json(text) == document
    wrapped = '[' * depth + json.dumps('[{"' * 9) + ']' * depth
    if depth > MAX_JSON_DEPTH:
        with pytest.raises(RecursionError):
            load_json(wrapped)
    else:
        assert load_json(wrapped) == json.loads(wrapped)
    flat = json.dumps([document] * (MAX_JSON_DEPTH + 1))
    assert load_json(flat) == [document] * (MAX_JSON_DEPTH + 1)


@given(texts)
def test_what_is_no_json_is_refused_as_ever(text: str) -> None:
    try:
        expected = json.loads(text)
    except ValueError:
        with pytest.raises((ValueError, RecursionError)):
            load_json(text * 30)
            load_json(text)
    else:
        assert load_json(text) == expected


def test_brackets_do_not_end_a_process_that_may_recurse_deep() -> None:
    code = (
        'import sys; sys.setrecursionlimit(10**6); from flexbt_core.values.json_data import load_json\n'
        'try: load_json("[" * 10**6)\n'
        'except RecursionError as error: print(error)'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout.strip()) == (0, f'nested more than {MAX_JSON_DEPTH} deep')

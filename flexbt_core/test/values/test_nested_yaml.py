# SPDX-License-Identifier: BSD-3-Clause
"""YAML that costs too much is refused while it is read; everything else is what PyYAML says."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from flexbt_core.values.yaml_data import MAX_YAML_DEPTH, YamlError, load_yaml
from flexbt_testing.hostile_yaml import HOSTILE_YAML

scalars = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=9) | st.dates()
documents = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=9), inner, max_size=4)
)
TAGS = ['!!int ', '!!bool ', '!!float ', '!!binary ', '!!timestamp ', '!!set ', '!!omap ', '!!python/tuple ']
WORDS = ['a', '1', '-1', '0x', '_', '.', '.inf', 'yes', '2001-01-01', '&x ', '*x ', '<<', '=', '---', 'é']
pieces = (
    st.sampled_from(TAGS)
    | st.sampled_from(WORDS)
    | st.sampled_from(':-?[]{},"\'#|%@ \t\n')
    | st.sampled_from([': ', '- '])
)


@given(documents, st.booleans(), st.integers(1, MAX_YAML_DEPTH + 3))
def test_the_depth_decides(document: object, is_flow: bool, depth: int) -> None:
    text = yaml.safe_dump(document, default_flow_style=is_flow)
    assert load_yaml(text) == document
    wrapped = '[' * depth + '1, "[[{"' + ']' * depth
    if depth > MAX_YAML_DEPTH:
        with pytest.raises(YamlError, match='nested more than'):
            load_yaml(wrapped)
    else:
        assert load_yaml(wrapped) == yaml.safe_load(wrapped)


@given(st.lists(pieces, max_size=12).map(''.join))
def test_any_text_is_what_it_was_or_refused(text: str) -> None:
    try:
        expected = repr(yaml.safe_load(text))
    except Exception:  # PyYAML raises errors of many kinds
        with pytest.raises(YamlError):
            load_yaml(text)
        with pytest.raises(YamlError):
            load_yaml(text, aliases=True)
        return
    try:
        assert repr(load_yaml(text, aliases=True)) == expected
        assert repr(load_yaml(text)) == expected
    except YamlError as error:
        assert '*x' in text and '*x' in error.reason
        assert text.splitlines()[error.line - 1][error.column - 1 :].startswith('*x')


@pytest.mark.parametrize('text', HOSTILE_YAML.values(), ids=HOSTILE_YAML)
@pytest.mark.parametrize('aliases', [False, True])
def test_what_is_meant_to_do_harm_is_refused_in_time(text: str, aliases: bool) -> None:
    began = time.process_time()
    with pytest.raises(YamlError) as caught:
        load_yaml(text, aliases=aliases)
    assert time.process_time() - began < 10.0
    assert len(str(caught.value)) < 300


def test_brackets_do_not_end_a_process_that_may_recurse_deep() -> None:
    code = (
        'import sys; sys.setrecursionlimit(10**6); from flexbt_core.values.yaml_data import load_yaml\n'
        'try: load_yaml("[" * 10**6, aliases=True)\n'
        'except ValueError as error: print(error)'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout.strip()) == (0, f'line 1: nested more than {MAX_YAML_DEPTH} levels deep')

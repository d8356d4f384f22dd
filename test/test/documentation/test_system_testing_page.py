# SPDX-License-Identifier: BSD-3-Clause
"""The page about tests: its examples are tests that pass."""

import re
from pathlib import Path
from typing import Any

import pytest

PAGE = (Path(__file__).parents[3] / 'docs' / 'reference' / 'api' / 'testing.md').read_text(encoding='utf-8')
STATE, LEAF, *_ = re.findall(r'^```python\n(.*?)^```$', PAGE, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize('example', [STATE, LEAF], ids=['state', 'leaf'])
def test_the_example_passes(example: str) -> None:
    written: dict[str, Any] = {'__name__': 'example'}
    exec(example, written)  # noqa: S102 - the text of the page
    [test] = [value for name, value in written.items() if name.startswith('test_')]
    test()

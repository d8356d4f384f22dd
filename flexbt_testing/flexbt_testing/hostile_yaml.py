# SPDX-License-Identifier: BSD-3-Clause
"""Texts that make a careless YAML reader hang, crash, or raise unexpected errors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

HOSTILE_YAML: Final[Mapping[str, str]] = {
    'nested lists': '[' * 100_000 + ']' * 100_000,
    'never closed': '[' * 100_000,
    'nested maps': '{"a":' * 50_000 + '1' + '}' * 50_000,
    'nested blocks': '- ' * 5000,
    'nested keys': '? ' * 20_000,
    'billion laughs': 'a0: &a0 [x, x]\n'
    + ''.join(f'a{n}: &a{n} [{", ".join([f"*a{n - 1}"] * 10)}]\n' for n in range(1, 12)),
    'laughs that are merged': 'a0: &a0 {k: 1}\n'
    + ''.join(f'a{n}: &a{n} {{<<: [{", ".join([f"*a{n - 1}"] * 10)}]}}\n' for n in range(1, 12)),
    'a cycle': '&a [*a]',
    'sexagesimal': ':'.join(['1'] * 300_000),
    'sexagesimal float': ':'.join(['1'] * 2000) + '.5',
    'code': '!!python/object/apply:os.system ["true"]',
    'an integer that is none': '!!int ""',
    'a truth value that is none': '!!bool perhaps',
    'a time that is none': '!!timestamp noon',
    'quotes': '"' * 100_000,
    'NUL': '\0',
}

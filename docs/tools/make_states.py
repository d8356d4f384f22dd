# SPDX-License-Identifier: BSD-3-Clause
"""Writes docs/reference/states.md, the reference of the states, from their declarations.

In a shell with the environment of the workspace.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, Final

from target import target

import flexbt_flexbe.states
import flexbt_states
from flexbt_core.skills import class_of

PAGE: Final = Path(__file__).parents[1] / 'reference' / 'states.md'
HEAD: Final = """\
# The states

Every state that comes with FlexBT, with its parameters, keys and outcomes. The text comes from the declarations of the
states (`docs/tools/make_states.py` writes this page). KEY and OUTCOME stand for what a parameter names. Any state can
be put into `with_timeout` or `with_retry`; one of your own is written as the [tutorial](../tutorials/errands.md) shows.

## Overview
"""
FLEXBE: Final = """\
## Generic states of FlexBE

In `flexbt_flexbe.states`, and in `flexbe_states` for code that imports them there; see
[Coming from FlexBE](../how_to/coming_from_flexbe.md). Those that are missing here are states of `flexbt_states`.
"""
OVERVIEW: Final = """\
| state | parameters | reads | writes | outcomes |
|---|---|---|---|---|"""

_MARKS: Final = {'--': 'parameters', '>#': 'inputs', '#>': 'outputs', '<=': 'outcomes'}
_ENTRY: Final = re.compile(r'^(--|>#|#>|<=)\s+(\S+)\s*(.*)$')


@dataclass(frozen=True)
class Declaration:
    """What a docstring declares: pairs of name and text for each mark, and the text in front of them."""

    text: str
    entries: dict[str, list[tuple[str, str]]]


def declaration(state: type[Any]) -> Declaration:
    """Read the docstring of a state, in FlexBE's form."""
    text: list[str] = []
    entries: dict[str, list[tuple[str, str]]] = {kind: [] for kind in _MARKS.values()}
    for line in inspect.cleandoc(state.__doc__ or '').splitlines():
        found = _ENTRY.match(line.strip())
        if found:
            entries[_MARKS[found[1]]].append((found[2], found[3]))
        else:
            text.append(line)
    return Declaration(' '.join(' '.join(text).split()).replace('``', '`'), entries)


def page() -> str:
    """The whole page."""
    lines = [HEAD, *overview(flexbt_states), '']
    lines += ['## States of `flexbt_states`', '', *sections(flexbt_states)]
    lines += [FLEXBE, *overview(flexbt_flexbe.states, without=flexbt_states), '']
    lines += [*sections(flexbt_flexbe.states, without=flexbt_states)]
    return '\n'.join(lines).rstrip('\n') + '\n'


def states_of(module: Any, without: Any = None) -> Iterator[type[Any]]:
    """The states that a module exports; not those that only pass on one of the module ``without``."""
    for name in sorted(module.__all__):
        state = getattr(module, name)
        if inspect.isclass(state) and name == state.__name__ and not _passes_on(state, without):
            yield state


def overview(module: Any, without: Any = None) -> Iterator[str]:
    """The table of the states of a module, each with its other names."""
    yield OVERVIEW
    for state in states_of(module, without):
        entries = declaration(state).entries
        cells = (', '.join(f'`{name}`' for name, _ in entries[kind]) for kind in _MARKS.values())
        names = sorted(name for name in module.__all__ if getattr(module, name) is state)
        yield f'| {", ".join(f"`{name}`" for name in names)} | {" | ".join(cells)} |'


def sections(module: Any, without: Any = None) -> Iterator[str]:
    """What the page says of the states of a module."""
    for state in states_of(module, without):
        yield from section(state)


def section(state: type[Any]) -> Iterator[str]:
    """What the page says of one state."""
    declared = declaration(state)
    defaults = {one.name: one.default for one in inspect.signature(state).parameters.values()}
    yield f'### {state.__name__}'
    yield ''
    yield declared.text
    yield ''
    if declared.entries['parameters']:
        yield '| parameter | type | default | meaning |'
        yield '|---|---|---|---|'
        for name, rest in declared.entries['parameters']:
            kind, _, meaning = rest.partition(' ')
            yield f'| `{name}` | {kind} | {_shown(defaults[name])} | {_cell(meaning)} |'
        yield ''
    rows = [
        *((f'`{name}`', 'reads', text) for name, text in declared.entries['inputs']),
        *((f'`{name}`', 'writes', text) for name, text in declared.entries['outputs']),
        *((f'`{name}`', _outcome(name), text) for name, text in declared.entries['outcomes']),
    ]
    yield '| key or outcome | | meaning |'
    yield '|---|---|---|'
    yield from (f'| {name} | {what} | {_cell(text)} |' for name, what, text in rows)
    yield ''


def _outcome(name: str) -> str:
    """An outcome with its class, where the name tells it."""
    kind = class_of(name)
    return 'outcome' if kind is None else f'outcome, {kind.value.replace("_", " ")}'


def _passes_on(state: type[Any], module: Any) -> bool:
    same = getattr(module, state.__name__, None)
    return same is not None and issubclass(state, same)


def _shown(default: Any) -> str:
    if default is inspect.Parameter.empty:
        return 'required'
    return f'`{default}`' if isinstance(default, Enum) else f'`{default!r}`'


def _cell(text: str) -> str:
    return text.strip().replace('|', r'\|')


if __name__ == '__main__':
    target(__doc__, PAGE).write_text(page(), encoding='utf-8')

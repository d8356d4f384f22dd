# SPDX-License-Identifier: BSD-3-Clause
"""Write docs/reference/states.md, the reference of the states, from their declarations.

In a shell with the environment of the workspace.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, Final

from target import target

import flexbt_flexbe.states
import flexbt_states
from flexbt_core.skills.skill import usual_outcome_class
from flexbt_studio.documents.palette import declared

PAGE: Final = Path(__file__).parents[1] / 'reference' / 'states.md'
HEAD: Final = """\
# The states

All states of FlexBT, with their parameters, keys and outcomes. The text comes from the declarations of the
states (`docs/tools/make_states.py` writes this page). KEY and OUTCOME stand for the value of a parameter. You can wrap
any state in `with_timeout` or `with_retry`. The [tutorial](../tutorials/errands.md) shows how to write your own.

## Overview
"""
FLEXBE: Final = """\
## Generic states of FlexBE

Import them from `flexbt_flexbe.states`; existing code may use `flexbe_states`
([Coming from FlexBE](../how_to/coming_from_flexbe.md)). FlexBE's other generic states are in `flexbt_states`.
"""
OVERVIEW: Final = """\
| State | Parameters | Reads | Writes | Outcomes |
|---|---|---|---|---|"""


@dataclass(frozen=True)
class Declaration:
    """The declarations of a docstring: its text, and pairs of name and text for each mark."""

    text: str
    entries: dict[str, list[tuple[str, str]]]


def declaration(state: type[Any]) -> Declaration:
    """Read the docstring of a state, in FlexBE's form."""
    text, entries = declared(state)
    return Declaration(' '.join(' '.join(text).split()).replace('``', '`'), entries)


def page() -> str:
    """Return the whole page."""
    lines = [HEAD, *overview(flexbt_states), '']
    lines += ['## States of `flexbt_states`', '', *sections(flexbt_states)]
    lines += [FLEXBE, *overview(flexbt_flexbe.states, without=flexbt_states), '']
    lines += [*sections(flexbt_flexbe.states, without=flexbt_states)]
    return '\n'.join(lines).rstrip('\n') + '\n'


def states_of(module: Any, without: Any = None) -> Iterator[type[Any]]:
    """Return the states that a module exports, except those that only subclass one of the module ``without``."""
    for name in sorted(module.__all__):
        state = getattr(module, name)
        if inspect.isclass(state) and name == state.__name__ and not _passes_on(state, without):
            yield state


def overview(module: Any, without: Any = None) -> Iterator[str]:
    """Return the table of the states of a module, each with its other names."""
    yield OVERVIEW
    for state in states_of(module, without):
        entries = declaration(state).entries
        cells = (', '.join(f'`{name}`' for name, _ in entries[kind]) for kind in entries)
        names = sorted(name for name in module.__all__ if getattr(module, name) is state)
        yield f'| {", ".join(f"`{name}`" for name in names)} | {" | ".join(cells)} |'


def sections(module: Any, without: Any = None) -> Iterator[str]:
    """Return the sections of the states of a module."""
    for state in states_of(module, without):
        yield from section(state)


def section(state: type[Any]) -> Iterator[str]:
    """Return the section of one state."""
    declared = declaration(state)
    defaults = {one.name: one.default for one in inspect.signature(state).parameters.values()}
    yield f'### {state.__name__}'
    yield ''
    yield declared.text
    yield ''
    if declared.entries['parameters']:
        yield '| Parameter | Type | Default | Meaning |'
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
    yield '| Key or outcome | | Meaning |'
    yield '|---|---|---|'
    yield from (f'| {name} | {what} | {_cell(text)} |' for name, what, text in rows)
    yield ''


def _outcome(name: str) -> str:
    """Return an outcome, with its class if the name shows it."""
    kind = usual_outcome_class(name)
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

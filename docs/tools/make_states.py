# SPDX-License-Identifier: BSD-3-Clause
"""Write docs/reference/states.md, the reference of the states, from their declarations.

In a shell with the environment of the workspace.
"""

from __future__ import annotations

import inspect
from collections.abc import Collection, Iterator
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

All states of FlexBT, with their parameters, keys and outcomes. `docs/tools/make_states.py` writes this page from the
declarations of the states. KEY and OUTCOME stand for the value of a parameter. You can wrap any state in `with_timeout`
or `with_retry`. The [tutorial](../tutorials/errands.md) shows how to write your own.

A value after the type of a parameter is its default; a parameter without one is required. A word after an outcome is
its [class](skills.md).
"""
FLEXBE: Final = """\
## Generic states of FlexBE

Import them from `flexbt_flexbe.states`; existing code may use `flexbe_states`
([Coming from FlexBE](../how_to/coming_from_flexbe.md)). FlexBE's other generic states are in `flexbt_states`.
"""


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
    own, flexbe = list(states_of(flexbt_states)), list(states_of(flexbt_flexbe.states, without=flexbt_states))
    lines = [HEAD, '## States of `flexbt_states`', '']
    for state in own:
        lines += section(state, [name for name in flexbt_states.__all__ if is_alias(name, state)])
    lines += [FLEXBE]
    for state in flexbe:
        lines += section(state)
    return '\n'.join(lines).rstrip('\n') + '\n'


def is_alias(name: str, state: type[Any]) -> bool:
    """Return whether ``flexbt_states`` exports a state under this other name, too."""
    return name != state.__name__ and getattr(flexbt_states, name) is state


def states_of(module: Any, without: Any = None) -> Iterator[type[Any]]:
    """Return the states that a module exports, except those that only subclass one of the module ``without``."""
    for name in sorted(module.__all__):
        state = getattr(module, name)
        if inspect.isclass(state) and name == state.__name__ and not _passes_on(state, without):
            yield state


def lists(state: type[Any]) -> dict[str, list[str]]:
    """Return the items of a state by the title of their list."""
    entries = declaration(state).entries
    defaults = {one.name: one.default for one in inspect.signature(state).parameters.values()}
    parameters = [(name, *rest.partition(' ')[::2]) for name, rest in entries['parameters']]
    outcomes = [(name, _outcome(name), text) for name, text in entries['outcomes']]
    return {
        'Parameters': [_item(name, f'{kind}{_shown(defaults[name])}', text) for name, kind, text in parameters],
        'Reads': [_item(name, '', text) for name, text in entries['inputs']],
        'Writes': [_item(name, '', text) for name, text in entries['outputs']],
        'Outcomes': [_item(*outcome) for outcome in outcomes],
    }


def _item(name: str, what: str, meaning: str) -> str:
    return f'- `{name}`{f" ({what})" if what else ""}: {meaning.strip()}'


def section(state: type[Any], aliases: Collection[str] = ()) -> Iterator[str]:
    """Return the section of one state."""
    yield f'### {state.__name__}'
    yield ''
    yield ' '.join([declaration(state).text, *(f'Also exported as `{alias}`.' for alias in aliases)])
    yield ''
    for heading, items in lists(state).items():
        if items:
            yield from (f'{heading}:', '', *map(str, items), '')


def _outcome(name: str) -> str:
    """Return the class of an outcome if the name shows it."""
    kind = usual_outcome_class(name)
    return '' if kind is None or kind.value == name else kind.value.replace('_', ' ')


def _passes_on(state: type[Any], module: Any) -> bool:
    same = getattr(module, state.__name__, None)
    return same is not None and issubclass(state, same)


def _shown(default: Any) -> str:
    """Return a default behind the type of its parameter."""
    if default is inspect.Parameter.empty:
        return ''
    return f', `{default}`' if isinstance(default, Enum) else f', `{default!r}`'


if __name__ == '__main__':
    target(__doc__, PAGE).write_text(page(), encoding='utf-8')

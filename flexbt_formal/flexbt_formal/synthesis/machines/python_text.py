# SPDX-License-Identifier: BSD-3-Clause
"""A machine as a behavior in Python, for parameters that are code, and for who goes on from there by hand."""

from __future__ import annotations

import keyword
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

from flexbt_formal.synthesis.errors import SynthesisError

from .machine import Part, State, SynthesizedMachine
from .yaml_text import is_code, why

_LEVELS: Final = ('Off', 'Low', 'High', 'Full')


def machine_as_python(machine: SynthesizedMachine, module_of: Callable[[str], str]) -> str:
    """The text of a module with a behavior; ``module_of`` says from where a state class is imported.

    Raises:
        SynthesisError: a name cannot be one in Python.
    """
    return '\n'.join(_lines(machine, module_of)) + '\n'


def class_name(name: str) -> str:
    """A name for a class: ``night watch`` is ``NightWatch``."""
    words = re.findall(r'[A-Za-z0-9]+', name)
    joined = ''.join(word[:1].upper() + word[1:] for word in words)
    return joined if joined[:1].isalpha() else f'Machine{joined}'


def _lines(machine: SynthesizedMachine, module_of: Callable[[str], str]) -> Iterator[str]:
    classes = sorted({part.state_class for state in machine.states.values() for part in state.parts})
    bad = [one for one in classes if not _local(one).isidentifier() or keyword.iskeyword(_local(one))]
    if bad:
        raise SynthesisError([f"'{one}' is no name of a class" for one in bad])
    several = any(len(state.parts) > 1 for state in machine.states.values())
    retries = machine.attempts > 1 and any(part.retry_on for state in machine.states.values() for part in state.parts)
    taken = ['Autonomy', 'Child', *(['ConcurrencyContainer'] if several else []), 'OperatableStateMachine']
    yield f'"""{_doc(machine.name)}: synthesized; the comment of a state tells what it stands for."""'
    yield ''
    yield f'from flexbt_core.state_machine import {", ".join([*taken, *(["with_retry"] if retries else [])])}'
    yield 'from flexbt_onboard.behaviors import Behavior, BehaviorManifest'
    for module in sorted({module_of(one) for one in classes}):
        yield f'from {module} import {", ".join(_local(one) for one in classes if module_of(one) == module)}'
    yield from ('', '', f'class {class_name(machine.name)}(Behavior):')
    yield f"    manifest = BehaviorManifest(name={machine.name!r}, description='Synthesized.', author='behavior_tool')"
    yield from ('', '    def create(self) -> OperatableStateMachine:', '        return OperatableStateMachine(')
    yield f'            outcomes={list(machine.outcomes)!r},'
    if machine.keys:
        yield f'            input_keys={list(machine.keys)!r},'
    yield '            children=['
    for state in machine.states.values():
        yield f'                # {_doc(why(state))}'
        yield from (f'                {line}' for line in _child(state, machine.attempts))
    yield from ('            ],', '        )')


def _child(state: State, attempts: int) -> Iterator[str]:
    yield 'Child('
    yield f'    {state.name!r},'
    if len(state.parts) == 1:
        yield f'    {_made(state.parts[0], attempts)},'
    else:
        yield '    ConcurrencyContainer('
        yield f'        outcomes={list(state.transitions)!r},'
        for kind in ('reads', 'writes'):
            keys = sorted({key for part in state.parts for key in getattr(part, kind).values()})
            if keys:
                yield f'        {"input_keys" if kind == "reads" else "output_keys"}={keys!r},'
        yield f'        conditions={[(outcome, list(pairs)) for outcome, pairs in state.combinations.items()]!r},'
        yield '        children=['
        for part in state.parts:
            remapping = f', remapping={part.remapping!r}' if part.remapping else ''
            yield f'            Child({part.capability!r}, {_made(part, attempts)}{remapping}),'
        yield from ('        ],', '    ),')
    yield f'    {dict(state.transitions)!r},'
    levels = ', '.join(f'{outcome!r}: Autonomy.{_LEVELS[level]}' for outcome, level in state.autonomy.items())
    yield f'    autonomy={{{levels}}},'
    if len(state.parts) == 1 and state.parts[0].remapping:
        yield f'    remapping={state.parts[0].remapping!r},'
    yield '),'


def _made(part: Part, attempts: int) -> str:
    made = f'{_local(part.state_class)}({_arguments(part.parameters)})'
    return f'with_retry({made}, {attempts}, on={list(part.retry_on)!r})' if part.retry_on and attempts > 1 else made


def _arguments(parameters: Mapping[str, Any]) -> str:
    bad = [key for key in parameters if not key.isidentifier() or keyword.iskeyword(key)]
    if bad:
        raise SynthesisError([f"'{key}' is no name of a parameter" for key in bad])
    return ', '.join(
        f'{key}={value.removeprefix("*") if is_code(value) else repr(value)}' for key, value in parameters.items()
    )


def _local(name: str) -> str:
    return name.rpartition('/')[2]


def _doc(text: str) -> str:
    """A text that cannot end what it stands in."""
    return ' '.join(text.replace('\\', '/').replace('"', "'").split())

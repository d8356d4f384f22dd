# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors as data: their manifest and their state machine in YAML.

A package installs such a file as a behavior with an entry point that names the Python package and the file, which has
to be among its ``package_data``. It registers states for machines in YAML with an entry point that names a module::

    entry_points={
        'flexbt.behaviors': ['patrol = my_package:patrol.yaml'],
        'flexbt.states': ['my_states = my_package.states'],
    }

:mod:`flexbt_core.state_machine.authoring.yaml_form` describes the file.
"""

from __future__ import annotations

import dataclasses
import importlib
import math
from collections.abc import Callable, Iterable
from contextvars import ContextVar
from importlib.metadata import entry_points
from typing import Any, Final, TypeVar

import yaml

from flexbt_core.state_machine.authoring.yaml_form import MAX_CHARACTERS, machine_error, read_machine
from flexbt_core.state_machine.model.definition import MachineDefinition
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import MachineError
from flexbt_core.values.findings import finding_record
from flexbt_core.values.text import did_you_mean, one_line, short_repr
from flexbt_core.values.yaml_data import StrictYamlParts
from flexbt_onboard.errors import BehaviorError, BrokenBehaviorError, ManifestError

from .behavior import Behavior, BehaviorInput, BehaviorManifest, BehaviorParameter, OperatorGone

STATES_GROUP: Final = 'flexbt.states'
"""Entry point group under which packages list modules of states for machines in YAML."""


def state_modules() -> list[str]:
    """Return the names of the modules that packages list as modules of states, sorted."""
    return sorted({point.value for point in entry_points(group=STATES_GROUP)})


def states_of(modules: Iterable[str]) -> dict[str, type[EventState]]:
    """Return the state classes of modules by name. If several modules have the same name, the last one counts.

    Raises:
        BrokenBehaviorError: a module cannot be imported.
    """
    found: dict[str, type[EventState]] = {}
    for module in modules:
        try:
            values = vars(importlib.import_module(module))
        except Exception as error:  # the module may raise anything
            raise BrokenBehaviorError(
                f'the states of module {module!r} cannot be had: {type(error).__name__}: {error}'
            ) from error
        for name, value in values.items():
            if isinstance(value, type) and issubclass(value, EventState) and value is not EventState:
                found[name] = value
    return found


def installed_states() -> tuple[dict[str, Callable[..., EventState]], list[str]]:
    """Return the states of all packages by ``Name`` and by ``package/Name``, and why modules cannot be imported.

    A name that several packages use for different states is refused without a package.
    """
    found: dict[str, Callable[..., EventState]] = {}
    broken: list[str] = []
    owners: dict[str, dict[object, str]] = {}
    for module in state_modules():
        try:
            of_module = states_of([module])
        except BrokenBehaviorError as error:
            broken.append(str(error))
            continue
        for name, state in of_module.items():
            whole = f'{module.partition(".")[0]}/{name}'
            owners.setdefault(name, {}).setdefault(state, whole)
            found[name] = found[whole] = state
    clashes = {name: list(wholes.values()) for name, wholes in owners.items() if len(wholes) > 1}
    return {**found, **{name: _clash(name, wholes) for name, wholes in clashes.items()}}, broken


def _clash(name: str, wholes: list[str]) -> Callable[..., EventState]:
    def refuse(**_parameters: object) -> EventState:
        raise BehaviorError(f'several packages have a state {name!r}; write {" or ".join(wholes)}')

    return refuse


_open_behaviors: ContextVar[tuple[str, ...]] = ContextVar('open_behaviors', default=())
"""Names of the behaviors that are being built, outermost first."""


class MachineBehavior(Behavior):
    """A behavior made from a YAML text.

    ``name`` is used if the text gives none. Problems name the file ``source``. ``find`` makes the behaviors that the
    text embeds.

    Raises:
        MachineError: the head of the text has problems; the error lists all of them.
    """

    def __init__(self, name: str, text: str, source: str, find: Callable[[str], Behavior]) -> None:
        parts = StrictYamlParts(source)
        root = parts.root(text, MAX_CHARACTERS)
        node = parts.mapping(root, 'the text').get('behavior')
        head = parts.mapping(node, 'behavior')
        known = ('name', 'description', 'author', 'parameters', 'inputs', 'operator_gone', 'operator_gone_after')
        parts.refuse_others(head, known, 'behavior')
        texts = {key: parts.name(head[key], f'{key} of the behavior', 'a text') for key in known[:3] if key in head}
        comment = one_line(text.partition('\n')[0].removeprefix('#').strip()) if text.startswith('#') else ''
        parameters = _declared(parts, BehaviorParameter, 'parameter', head.get('parameters'))
        inputs = _declared(parts, BehaviorInput, 'input', head.get('inputs'))
        if 'operator_gone' in head:
            reaction, known_ones = (
                parts.name(head['operator_gone'], 'operator_gone'),
                [one.value for one in OperatorGone],
            )
            if reaction in known_ones:
                self.operator_gone = OperatorGone(reaction)
            else:
                text_of = f'operator_gone is none of {", ".join(known_ones)}: {short_repr(reaction)}'
                parts.problem(head['operator_gone'], f'{text_of}{did_you_mean(reaction, known_ones, "")}')
        if 'operator_gone_after' in head:
            self.operator_gone_after = parts.value(head['operator_gone_after'], 'operator_gone_after')
            if type(self.operator_gone_after) not in (int, float) or not 0.0 < self.operator_gone_after < math.inf:
                parts.problem(head['operator_gone_after'], 'operator_gone_after has to be a number of seconds above 0')
        try:
            self.manifest = BehaviorManifest(
                **{'name': name, 'description': comment, **texts}, parameters=parameters, inputs=inputs
            )
            super().__init__()
        except ManifestError as error:
            place = head.get('name', node or root)
            if place is not None:  # else the text has a problem
                parts.problem(place, str(error))
        if parts.records:
            raise machine_error(parts.records)
        self._text, self._source, self._find = text, source, find

    def create(self) -> MachineDefinition:
        """Return the machine.

        Raises:
            MachineError: the text has problems; the error lists all of them.
            BehaviorError: the behavior embeds itself.
        """
        around = _open_behaviors.get()
        if self.name in around:
            raise BehaviorError(f'{self.name!r} embeds itself: {" in ".join([self.name, *reversed(around)])}')
        states, broken = installed_states()
        values = {name: getattr(self, name) for name in self.parameters}
        token = _open_behaviors.set((*around, self.name))
        try:
            return read_machine(self._text, states, self._source, parameters=values, behaviors=self._find)
        except MachineError as error:  # it may need the states of a broken package
            records = [*error.records, *(finding_record('refused', 'error', one) for one in broken)]
            raise MachineError([*error.problems, *broken], records) from error
        finally:
            _open_behaviors.reset(token)


_Declared = TypeVar('_Declared', BehaviorParameter, BehaviorInput)


def _declared(parts: StrictYamlParts, make: type[_Declared], kind: str, node: yaml.Node | None) -> list[_Declared]:
    """Return the parameters or inputs of a behavior. Texts are read literally, other fields as values."""
    made = []
    _name, *fields = dataclasses.fields(make)
    types = {field.name: str(field.type) for field in fields}
    for name, one in parts.mapping(node, f'{kind}s of the behavior').items():
        before, parts.owner, what = len(parts.records), name, f'{kind} {name}'
        entries = parts.mapping(one, what)
        parts.refuse_others(entries, types, what)
        values: dict[str, Any] = {}
        for key, value in entries.items():
            if types.get(key) == 'str':
                values[key] = parts.name(value, f'{key} of {what}', 'a text')
            elif key in types:
                values[key] = parts.value(value, f'{key} of {what}')
                expected, kinds = _TYPES.get(types[key], ('', ()))
                if kinds and type(values[key]) not in kinds and len(parts.records) == before:
                    parts.problem(value, f'{key} of {what} has to be {expected}')
        if kind == 'parameter' and 'default' not in entries:
            parts.problem(parts.key_of(one), f'{what} has no default; it determines the type')
        if len(parts.records) == before:
            try:
                made.append(make(name, **values))
            except ManifestError as error:
                parts.problem(parts.key_of(one), str(error))
    parts.owner = ''
    return made


_TYPES: Final[dict[str, tuple[str, tuple[type, ...]]]] = {
    'bool': ('true or false', (bool,)),
    'float | None': ('a number', (int, float)),
    'Sequence[ParameterValue]': ('a list', (list,)),
}

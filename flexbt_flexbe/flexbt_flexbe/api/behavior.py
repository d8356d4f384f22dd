# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's Behavior: parameters with their conversion, embedded behaviors, and the state machine it creates."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Iterable, Mapping
from typing import Any, Final

from flexbt_common.files import resolve_file
from flexbt_core.errors import FlexbtError
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine, embedded
from flexbt_core.state_machine.model.definition import Machine
from flexbt_core.values.text import short_repr
from flexbt_core.values.text_files import read_text
from flexbt_core.values.yaml_data import load_yaml
from flexbt_flexbe.errors import FlexbeManifestError
from flexbt_onboard.behaviors.behavior import to_bool
from flexbt_onboard.errors import ParameterError

_OWN: Final = ('name', 'beh_id', 'contains')
"""Attributes of every behavior that the operator cannot set."""

_NO_VALUES: Final = (property, staticmethod, classmethod)


class Behavior:
    """The base class of FlexBE's behaviors, whose constructor takes the node.

    The executive runs it; see :mod:`flexbt_flexbe.hosted_behavior`. FlexBE's methods to control a run (``confirm``,
    ``execute``, ``prepare_for_switch``, ``preempt``) do not exist here, since the executive does that.
    """

    def __init__(self) -> None:
        self.name = 'unnamed behavior'
        self.beh_id = 0
        self.contains: dict[str, Behavior] = {}
        self._state_machine: OperatableStateMachine | None = None

    def create(self) -> OperatableStateMachine:
        """Build the state machine, after the parameters are set. Each behavior implements it."""
        raise NotImplementedError(f'behavior {self.name!r} does not implement create()')

    def add_parameter(self, name: str, default: Any) -> None:
        """Declare a parameter; the type of ``default`` is its type."""
        setattr(self, name, default)

    def add_behavior(self, behavior_class: type[Any], behavior_id: str, node: Any = None) -> None:
        """Embed a behavior; :meth:`use_behavior` puts it into the state machine."""
        self.contains[behavior_id] = behavior_class(node)

    def use_behavior(
        self,
        behavior_class: type[Any],
        behavior_id: str,
        default_keys: Iterable[str] | None = None,
        parameters: Mapping[str, Any] | None = None,
    ) -> Machine:
        """Return the state machine of an embedded behavior; add it like a state.

        The machine around it must supply its input keys, except ``default_keys``, which keep the behavior's own
        values. ``parameters`` override the operator's choice.

        Raises:
            FlexbeManifestError: the behavior was not added.
        """
        behavior = self.contains.get(behavior_id)
        if behavior is None:
            known = ', '.join(self.contains) or 'none'
            raise FlexbeManifestError(
                f'behavior {self.name!r} uses {behavior_id!r} without having added it (added: {known})'
            )
        for name, value in (parameters or {}).items():
            setattr(behavior, name, value)
        return embedded(behavior.create(), default_keys or ())

    def get_contained_behaviors(self) -> dict[str, Behavior]:
        """Return all embedded behaviors by path, such as ``/Outer/Inner``."""
        found: dict[str, Behavior] = {}
        for key, behavior in self.contains.items():
            found[f'/{key}'] = behavior
            found.update({f'/{key}{path}': inner for path, inner in behavior.get_contained_behaviors().items()})
        return found

    def set_parameter(self, name: str, value: Any) -> bool:
        """Set a parameter, with the value converted to its type. As in FlexBE, each attribute with a value is one.

        A bare name sets the parameter in this behavior and in all embedded ones that have it. A name with a path, such
        as ``/Inner/speed``, sets it in that behavior and those embedded in it. Return whether any has the parameter.

        Raises:
            ParameterError: the value is not of the type; the error names the parameter with its path.
        """
        path, _, key = name.rpartition('/')
        path = f'/{path.strip("/")}' if path else ''
        behaviors = {'': self, **self.get_contained_behaviors()}
        meant = {
            own: behavior
            for own, behavior in behaviors.items()
            if (own == path or own.startswith(f'{path}/')) and behavior.has_parameter(key)
        }
        for own, behavior in meant.items():
            setattr(behavior, key, converted(f'{own}/{key}' if own else key, value, getattr(behavior, key)))
        return bool(meant)

    def parameter_names(self) -> list[str]:
        """Return the names of the attributes that can be set as parameters."""
        return [name for name in dir(self) if self.has_parameter(name)]

    def has_parameter(self, name: str) -> bool:
        """Return whether the behavior itself has a parameter of this name."""
        value = inspect.getattr_static(self, name, property())
        return not (name.startswith('_') or name in _OWN or callable(value) or isinstance(value, _NO_VALUES))

    def set_own_parameter(self, name: str, value: Any) -> None:
        """Set a parameter of this behavior, but not of embedded ones, with the value converted to its type.

        Raises:
            ParameterError: the value is not of the type.
        """
        setattr(self, name, converted(name, value, getattr(self, name)))

    def set_up(self, beh_id: int, autonomy_level: int, debug: bool) -> None:
        """Store the id. The run has the level and the other settings."""
        self.beh_id = beh_id


# Values of parameters, converted from the operator's text or a YAML file to the type that the behavior declares.

YAML_PREFIX: Final = '/YAML:'
"""FlexBE's prefix of the name of an argument whose value is a file and a key in it."""

_FILE: Final = re.compile(r'(?P<file>[\w.-]+/[\w./-]+\.ya?ml)(?::(?P<key>\S*))?')


def converted(name: str, value: Any, like: Any) -> Any:
    """Return ``value`` converted to the type of ``like``. An int is not a bool, nor the reverse.

    Raises:
        ParameterError: it cannot be converted without loss.
    """
    try:
        if isinstance(like, float):
            return _float(value)
        if type(value) is type(like):
            return value
        if isinstance(like, bool):
            return to_bool(str(value))
        if isinstance(like, int):
            return _int(value)
        if isinstance(like, dict | list):
            return _structure(value, type(like))
        return str(value) if isinstance(like, str) else value
    except (TypeError, ValueError, OverflowError) as error:
        kind = type(like).__name__
        raise ParameterError(
            f'parameter {name!r}: {short_repr(value)} is not a value of type {kind}: {error}'
        ) from None


def from_yaml_file(name: str, text: str) -> Any:
    """Return the content of a YAML file: ``package/relative/path.yaml``, or a key in it after a colon.

    Raises:
        ParameterError: the file is not in an installed package or not YAML, or the key is missing.
    """
    found = _FILE.fullmatch(text.strip())
    if found is None:
        raise ParameterError(f'parameter {name!r}: {text!r} is not a package/relative/path.yaml, with or without :KEY')
    try:
        content = load_yaml(read_text(resolve_file(found['file'])), aliases=True)
    except (FlexbtError, OSError, ValueError) as error:
        raise ParameterError(f'parameter {name!r}: {error}') from None
    key = found['key']
    if not key:
        return content
    if not isinstance(content, dict) or key not in content:
        raise ParameterError(f'parameter {name!r}: {found["file"]} has no key {key!r}')
    return content[key]


def is_yaml_file(text: str) -> bool:
    """Return whether a text names a YAML file of a package."""
    return _FILE.fullmatch(text.strip()) is not None


def _float(value: Any) -> float:
    number = float(value)
    if math.isnan(number):  # no limit would hold it
        raise ValueError('write a number')
    return number


def _int(value: Any) -> int:
    is_digits = isinstance(value, str) and re.fullmatch(r'\s*[+-]?\d+\s*', value)
    number = int(value) if is_digits else float(value)
    whole = int(number)
    if whole != number:
        raise ValueError('write a whole number')
    if not -(2**63) <= whole < 2**63:
        raise ValueError('write a number of 64 bits')
    return whole


def _structure(value: Any, kind: type[Any]) -> Any:
    content = load_yaml(value) if isinstance(value, str) else value
    if not isinstance(content, kind):
        example = '[1, 2]' if kind is list else '{name: 1}'
        raise ValueError(f'it is a {type(content).__name__}; write {example}')
    return content

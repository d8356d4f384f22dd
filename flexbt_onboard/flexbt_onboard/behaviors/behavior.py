# SPDX-License-Identifier: BSD-3-Clause
"""An installed behavior: a manifest, parameters, and the state machine that it builds.

A package registers a behavior with an entry point in its ``setup.py``::

    entry_points={'flexbt.behaviors': ['patrol = my_package.patrol:Patrol']}
"""

from __future__ import annotations

import copy
import keyword
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any, Final

import yaml

from flexbt_core.values.text import short_repr
from flexbt_core.values.yaml_data import load_yaml, yaml_line
from flexbt_onboard.errors import ManifestError, ParameterError

if TYPE_CHECKING:
    from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
    from flexbt_core.state_machine.model.definition import MachineDefinition

ParameterValue = bool | int | float | str | list[Any] | dict[Any, Any]

_TYPE_NAMES: Final[dict[type, str]] = {
    bool: 'bool',
    int: 'int',
    float: 'float',
    str: 'string',
    list: 'list',
    dict: 'dict',
}
_TRUE: Final = frozenset({'true', 'yes', 'on', '1'})
_FALSE: Final = frozenset({'false', 'no', 'off', '0'})


def _check_texts(where: str, texts: Mapping[str, object]) -> None:
    """Raise ManifestError unless all are texts: a list of behaviors with anything else would end the process."""
    for name, text in texts.items():
        if not isinstance(text, str):
            raise ManifestError(f'{where}: {name} is {short_repr(text)}, not text; quote it')


@dataclass(frozen=True)
class BehaviorParameter:
    """A parameter that an operator can set when starting a behavior.

    ``default`` determines the type: bool, int, float, str, list or dict. An operator writes lists and dicts in YAML.
    ``choices`` lists the allowed values; if it is empty, any value of the type is allowed. ``minimum`` and ``maximum``
    limit a number; None means no limit. Consoles show ``label`` (or else the name), ``unit`` and ``description``.

    Raises:
        ManifestError: the name is not a public Python identifier, the default does not fit a type or the choices, or
            another value has a wrong type.
    """

    name: str
    default: ParameterValue
    description: str = ''
    choices: Sequence[ParameterValue] = ()
    label: str = ''
    unit: str = ''
    minimum: float | None = None
    maximum: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, 'choices', tuple(self.choices))
        texts = {'name': self.name, 'description': self.description, 'label': self.label, 'unit': self.unit}
        _check_texts(f'parameter {self.name!r}', texts)
        for limit in (self.minimum, self.maximum):
            if limit is not None and (isinstance(limit, bool) or not isinstance(limit, int | float)):
                raise ManifestError(f'parameter {self.name!r}: the limit {short_repr(limit)} is not a number')
        if not self.name.isidentifier() or keyword.iskeyword(self.name) or self.name.startswith('_'):
            raise ManifestError(f'parameter {self.name!r}: the name must be a Python identifier without leading "_"')
        if type(self.default) not in _TYPE_NAMES:
            raise ManifestError(
                f'parameter {self.name!r}: the default {self.default!r} is a {type(self.default).__name__}; '
                f'a parameter is one of {", ".join(_TYPE_NAMES.values())}'
            )
        if isinstance(self.default, list | dict) and not _is_plain(self.default):
            raise ManifestError(
                f'parameter {self.name!r}: the default {short_repr(self.default)} cannot be written in YAML'
            )
        for choice in self.choices:
            if type(choice) is not type(self.default):
                raise ManifestError(f'parameter {self.name!r}: the choice {choice!r} is not a {self.type}')
        if self.choices and self.default not in self.choices:
            raise ManifestError(f'parameter {self.name!r}: the default {self.default!r} is not one of its choices')

    @property
    def type(self) -> str:
        """Name of the type: one of bool, int, float, string, list, dict."""
        return _TYPE_NAMES[type(self.default)]

    def from_text(self, text: str) -> ParameterValue:
        """Convert the text that an operator wrote to a value.

        Raises:
            ParameterError: the text is not a value of the type, or not one of the choices, or beyond the limits.
        """
        try:
            return self.checked(_CONVERTERS[self.type](text))
        except ValueError as error:
            raise ParameterError(
                f'parameter {self.name!r}: {short_repr(text)} is not a value of type {self.type}: {error}'
            ) from None

    def checked(self, value: ParameterValue) -> ParameterValue:
        """Check a value and return it. An int is converted where the parameter is a float.

        Raises:
            ParameterError: the value has another type, is not one of the choices, or is beyond the limits.
        """
        if self.type == 'float' and type(value) is int:
            value = float(value)
        if type(value) is not type(self.default):
            raise ParameterError(
                f'parameter {self.name!r}: {value!r} is a {type(value).__name__}, not a value of type {self.type}'
            )
        if self.choices and value not in self.choices:
            allowed = ', '.join(parameter_text(choice) for choice in self.choices)
            raise ParameterError(
                f'parameter {self.name!r}: {parameter_text(value)!r} is none of its choices ({allowed})'
            )
        if isinstance(value, int | float):
            low, high = self.minimum, self.maximum
            is_within = (low is None or value >= low) and (high is None or value <= high)
            if not is_within:  # nor is NaN
                limits = f'{-math.inf if low is None else low:.15g} to {math.inf if high is None else high:.15g}'
                raise ParameterError(f'parameter {self.name!r}: {short_repr(value)} is outside of its limits {limits}')
        return value


@dataclass(frozen=True)
class BehaviorInput:
    """An input userdata key of a behavior, for the form with which an operator starts it.

    ``type`` is as in BlackboardEntry (``string``, ``geometry_msgs/PoseStamped``), or empty for any type. ``needed`` is
    True if the machine has no default for the key.

    Raises:
        ManifestError: a value has a wrong type.
    """

    key: str
    type: str = ''
    description: str = ''
    needed: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, 'needed', bool(self.needed))
        _check_texts(f'input {self.key!r}', {'key': self.key, 'type': self.type, 'description': self.description})


@dataclass(frozen=True)
class BehaviorManifest:
    """The manifest of a behavior: its unique name, and the information that consoles show to the operator.

    ``inputs`` declares the input userdata of its machine, so that consoles can ask the operator for each.

    Raises:
        ManifestError: the name is empty or contains "/", two parameters have the same name, or a value is not text.
    """

    name: str
    description: str = ''
    author: str = ''
    parameters: Sequence[BehaviorParameter] = ()
    inputs: Sequence[BehaviorInput] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, 'parameters', tuple(self.parameters))
        object.__setattr__(self, 'inputs', tuple(self.inputs))
        texts = {'name': self.name, 'description': self.description, 'author': self.author}
        _check_texts(f'behavior {self.name!r}', texts)
        if not self.name.strip() or '/' in self.name:
            raise ManifestError(f'behavior {self.name!r}: the name must not be empty or contain "/"')
        names = [parameter.name for parameter in self.parameters]
        for name in names:
            if names.count(name) > 1:
                raise ManifestError(f'behavior {self.name!r}: two parameters have the name {name!r}')


class OperatorGone(Enum):
    """The reaction of a run after no operator has been connected for some time."""

    CONTINUE = 'continue'
    HOLD = 'hold'
    STOP = 'stop'


class Behavior:
    """Base of the behaviors: derive, set :attr:`manifest`, and implement :meth:`create`.

    Each parameter is an attribute of the instance, with the operator's value or the default. The constructor takes no
    arguments. It also runs when behaviors are listed, so it should only declare parameters. Make states in
    :meth:`create`, which is called once for each run.
    """

    manifest: BehaviorManifest

    operator_gone: OperatorGone = OperatorGone.CONTINUE
    """Reaction when no operator has been connected for :attr:`operator_gone_after`: continue, pause, or stop."""

    operator_gone_after: float = 10.0
    """Seconds of wall time without an operator, after which the run reacts."""

    def __init__(self) -> None:
        manifest = getattr(self, 'manifest', None)
        if not isinstance(manifest, BehaviorManifest):
            raise ManifestError(f'class {type(self).__name__}: set the class attribute manifest to a BehaviorManifest')
        self.name = manifest.name
        self._parameters: dict[str, BehaviorParameter] = {}
        for parameter in manifest.parameters:
            self._declare(parameter)

    @property
    def parameters(self) -> Mapping[str, BehaviorParameter]:
        """Declared parameters by name."""
        return self._parameters

    def add_parameter(
        self,
        name: str,
        default: ParameterValue,
        description: str = '',
        choices: Sequence[ParameterValue] = (),
    ) -> None:
        """Declare a parameter, as FlexBE behaviors do in their constructor.

        A parameter of the manifest may be declared again with the same default.

        Raises:
            ManifestError: the declaration is invalid, or contradicts the one in the manifest.
        """
        known = self._parameters.get(name)
        if known is None:
            self._declare(BehaviorParameter(name, default, description, choices))
        elif type(known.default) is not type(default) or known.default != default:
            raise ManifestError(
                f'behavior {self.name!r}: parameter {name!r} is declared twice, with the defaults '
                f'{known.default!r} and {default!r}'
            )

    def set_parameter(self, name: str, value: ParameterValue) -> None:
        """Set a parameter to a value of its type.

        Raises:
            ParameterError: the parameter does not exist, or does not accept the value.
        """
        setattr(self, name, self._parameter(name).checked(value))

    def set_arguments(self, arguments: Sequence[tuple[str, str]]) -> None:
        """Set parameters from pairs of name and text, as an operator wrote them: all of them, or none.

        Raises:
            ParameterError: a name is not declared or occurs twice, or a parameter does not accept its text.
        """
        values: dict[str, ParameterValue] = {}
        for name, text in arguments:
            if name in values:
                raise ParameterError(f'parameter {name!r} is given twice')
            values[name] = self._parameter(name).from_text(text)
        for name, value in values.items():
            setattr(self, name, value)

    def create(self) -> OperatableStateMachine | MachineDefinition:
        """Build the state machine from the values of the parameters. Called on the thread of the run.

        A definition, such as :func:`read_machine` makes from YAML, contains the state objects of one run. Each call
        must therefore make a new one.
        """
        raise NotImplementedError(f'behavior {self.name!r} does not implement create()')

    def _declare(self, parameter: BehaviorParameter) -> None:
        if hasattr(Behavior, parameter.name) or parameter.name == 'name':
            raise ManifestError(
                f'behavior {self.name!r}: a parameter cannot have the name {parameter.name!r}: '
                'every behavior has an attribute of that name'
            )
        self._parameters[parameter.name] = parameter
        setattr(self, parameter.name, copy.deepcopy(parameter.default))

    def _parameter(self, name: str) -> BehaviorParameter:
        try:
            return self._parameters[name]
        except KeyError:
            known = ', '.join(self._parameters) or 'none'
            raise ParameterError(f'behavior {self.name!r} has no parameter {name!r}; it has: {known}') from None


def parameter_text(value: ParameterValue) -> str:
    """Return a parameter's value as text. :meth:`BehaviorParameter.from_text` converts it back to the same value."""
    if isinstance(value, list | dict):
        return yaml_line(value)
    return str(value).lower() if isinstance(value, bool) else str(value)


def _is_plain(value: list[Any] | dict[Any, Any]) -> bool:
    try:
        return bool(load_yaml(parameter_text(value)) == value)
    except (ValueError, yaml.YAMLError, RecursionError):
        return False


def to_bool(text: str) -> bool:
    """Convert true or false, as an operator wrote it, to a bool. Raise ValueError for any other text."""
    word = text.strip().lower()
    if word in _TRUE:
        return True
    if word in _FALSE:
        return False
    raise ValueError('write true or false')


def _to_int(text: str) -> int:
    try:
        return int(text.strip())
    except ValueError:
        raise ValueError('write a whole number') from None


def _to_float(text: str) -> float:
    try:
        value = float(text.strip())
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise ValueError('write a number')
    return value


def _to_kind(kind: type[Any], example: str) -> Callable[[str], ParameterValue]:
    def convert(text: str) -> ParameterValue:
        value: ParameterValue = load_yaml(text)
        if not isinstance(value, kind):
            raise ValueError(f'write a {example}')
        return value

    return convert


_CONVERTERS: Final[dict[str, Callable[[str], ParameterValue]]] = {
    'bool': to_bool,
    'int': _to_int,
    'float': _to_float,
    'string': str,
    'list': _to_kind(list, 'list in YAML, such as [1, 2]'),
    'dict': _to_kind(dict, 'mapping in YAML, such as {name: 1}'),
}

# SPDX-License-Identifier: BSD-3-Clause
"""Parameters that a node reads at its start, and a managed node at each configuration."""

from __future__ import annotations

import array
import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterValue,
    SetParametersResult,
)
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.parameter import Parameter

from flexbt_common.errors import ResourceError, UnfitParameterError
from flexbt_common.files import home_path, with_package_shares
from flexbt_common.middleware.rclpy_private import given_parameters
from flexbt_core.values.parameter_fields import ParameterField, parameters_of
from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_core.values.yaml_data import YamlError, load_yaml

READ_WHEN_CONFIGURED: Final = 'read when the node is configured; can be set while it is unconfigured'
"""Note in the descriptors of the parameters of managed nodes."""

ALLOWED_DIRECTORIES_TEXT: Final = (
    'directories from which services load files, beside package shares and those of files that parameters name'
)
"""Description of the parameter ``allowed_directories`` of a node whose services get the names of files."""

MOST_PARAMETERS: Final = 1_000
"""Maximum number of parameters, names or prefixes in one request."""

_ASKED_FOR: Final = {
    DescribeParameters: 'names',
    GetParameters: 'names',
    GetParameterTypes: 'names',
    ListParameters: 'prefixes',
    SetParameters: 'parameters',
    SetParametersAtomically: 'parameters',
}

_TYPES: Final = frozenset(type.value for type in Parameter.Type)

_ELEMENTS: Final[Mapping[Parameter.Type, Parameter.Type]] = {
    Parameter.Type.BOOL_ARRAY: Parameter.Type.BOOL,
    Parameter.Type.INTEGER_ARRAY: Parameter.Type.INTEGER,
    Parameter.Type.DOUBLE_ARRAY: Parameter.Type.DOUBLE,
    Parameter.Type.STRING_ARRAY: Parameter.Type.STRING,
}

_SAMPLES: Final[Mapping[Parameter.Type, Any]] = {
    Parameter.Type.BOOL: True,
    Parameter.Type.INTEGER: 1,
    Parameter.Type.DOUBLE: 1.0,
    Parameter.Type.STRING: 'text',
}
"""Sample values, shown if neither the given value nor a default helps."""

_NUMBER_CHARACTERS: Final = 30

_OF_QOS: Final = 'qos_overrides.'
"""Prefix of the names of parameters that are declared with a publisher or subscription."""


P = TypeVar('P', bound=Any)


class ParameterDeclarer:
    """A helper that declares parameters on a node once and returns their values; each has a description and bounds.

    A parameter is read-only, unless said otherwise, except on a managed node, where :func:`refuse_while_configured`
    decides about those that are not :attr:`fixed`.

    Every method raises UnfitParameterError if no value fits the type and the bounds.
    """

    def __init__(self, node: Node, *, is_fixed: bool = False) -> None:
        self._node = node
        self._is_fixed = is_fixed

    @property
    def fixed(self) -> ParameterDeclarer:
        """Declarer of parameters that keep their start values on a managed node, too: those for files, addresses and
        limits. Every program of the domain can call the services that set parameters.
        """
        return ParameterDeclarer(self._node, is_fixed=True)

    def fields(self, defaults: P) -> P:
        """Return a dataclass with the values of the fields that are parameters, also of dataclasses in it.

        Its own values are the defaults; see :func:`flexbt_core.values.parameter_fields.parameter`.
        """
        values: dict[str, Any] = {}
        parameters = parameters_of(defaults)
        for one in dataclasses.fields(defaults):
            default = getattr(defaults, one.name)
            if one.name in parameters:
                values[one.name] = self._field(parameters[one.name], default)
            elif dataclasses.is_dataclass(default):
                values[one.name] = self.fields(default)
        return dataclasses.replace(defaults, **values)

    def _field(self, one: ParameterField, default: Any) -> Any:
        declare = self.fixed if one.is_fixed else self
        match default:
            case bool():
                return declare.flag(one.name, default, one.description)
            case int():
                return declare.integer(one.name, default, one.least, one.most, one.description)
            case float():
                return declare.real(one.name, default, one.least, one.most, one.description)
            case str():
                value: Any = declare.text(one.name, default, one.description)
            case _:
                value = declare.texts(one.name, default, one.description)
        for text in [value] if isinstance(value, str) else value:
            if one.choices and text not in one.choices:
                near = did_you_mean(text, one.choices, '')
                known = ', '.join(one.choices)
                raise UnfitParameterError(
                    one.name, f'there is no {short_repr(text)}; known: {known}{near}; {one.description}'
                )
        return value

    def directories(self, name: str, default: Sequence[str], description: str) -> tuple[Path, ...]:
        """Return absolute directories; ``~`` is the home of the user."""
        directories = tuple(map(home_path, self.texts(name, default, description)))
        for directory in directories:
            if not directory.is_absolute():
                raise UnfitParameterError(name, f'{short_repr(str(directory))} is not an absolute path; {description}')
        return directories

    def real(
        self, name: str, default: float, least: float, most: float, description: str, read_only: bool = True
    ) -> float:
        """Return a number within bounds, both included."""
        bounds = [FloatingPointRange(from_value=least, to_value=most)]
        return float(self._declare(name, default, description, read_only, floating_point_range=bounds))

    def integer(self, name: str, default: int, least: int, most: int, description: str) -> int:
        """Return a whole number within bounds, both included."""
        bounds = [IntegerRange(from_value=least, to_value=most, step=1)]
        return int(self._declare(name, default, description, integer_range=bounds))

    def reals(self, name: str, default: Sequence[float], description: str) -> list[float]:
        """Return a list of numbers of any length."""
        return [float(value) for value in self._declare(name, list(default), description)]

    def text(self, name: str, default: str, description: str) -> str:
        """Return a string."""
        return str(self._declare(name, default, description))

    def texts(self, name: str, default: Sequence[str], description: str) -> tuple[str, ...]:
        """Return strings without empty ones: an empty array has no type in ROS 2, so [''] stands for it."""
        return tuple(text for text in self._declare(name, list(default) or [''], description) if text)

    def flag(self, name: str, default: bool, description: str) -> bool:
        """Declare a parameter that is true or false."""
        return bool(self._declare(name, default, description))

    def _declare(self, name: str, default: Any, description: str, read_only: bool = True, **bounds: Any) -> Any:
        descriptor = ParameterDescriptor(description=description, read_only=read_only, **bounds)
        meaning = f'{description}; the default is {_as_yaml(default)}'
        try:
            if not self._node.has_parameter(name):
                _declare(self._node, name, default, descriptor, self._is_fixed)
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            given = given_parameters(self._node).get(name)
            fitted = None if given is None else Parameter(name, value=_fitted(given.value, default))
            why = '' if fitted is None else _misfit(fitted, descriptor, default)
            raise UnfitParameterError(name, f'{why or error}; {meaning}') from None
        except ResourceError as error:
            raise UnfitParameterError(name, f'{error}; {meaning}') from None
        value = self._node.get_parameter_or(name).value
        if value is not None:
            return value
        given = given_parameters(self._node).get(name)
        if given is not None and given.value is not None:
            why = _misfit(given, self._node.describe_parameter(name), default)
            raise UnfitParameterError(
                name, f'{why or short_repr(given.value)} (the node was started with it); {meaning}'
            )
        if given is None or not isinstance(default, list):
            what = f'it has no value, or [], which has no type in ROS 2; write {name}: {_as_yaml(default)}'
            raise UnfitParameterError(name, f'{what}; {meaning}')
        return []


# -------------------------------------------------------------------------------------------------------- refusals


def refused_declaration(prefix: str, declared: Sequence[tuple[Any, ...]], given: Mapping[str, Parameter]) -> str:
    """Return why a parameter cannot have the value that was given, or its default, and what to write; '' if all can.

    ``declared`` is what was given to :meth:`rclpy.node.Node.declare_parameters`, each with its descriptor.
    """
    for name, default, descriptor in declared:
        is_value = not isinstance(default, Parameter.Type | ParameterValue)
        parameter = given.get(prefix + name) or Parameter(prefix + name, value=default if is_value else None)
        if parameter.value is not None:
            why = _misfit(parameter, descriptor, default if is_value else None)
            if why:
                return f'{_named(parameter.name)}{why}'
    return ''


def refused_setting(node: Node, parameters: Sequence[Parameter]) -> str:
    """Return why these parameters of a node cannot be set, and what to do; '' to leave that to other checks."""
    for parameter in parameters:
        name = parameter.name
        if not node.has_parameter(name):
            continue
        descriptor = node.describe_parameter(name)
        why = _misfit(parameter, descriptor, node.get_parameter_or(name).value)
        if not why and descriptor.read_only:
            why = f'it is read when the node starts; start the node with -p {name}:={_as_yaml(parameter.value)}'
        if why:
            return f'{_named(name)}{why}'
    return ''


def undeclared(node: Node, parameters: Sequence[Parameter]) -> str:
    """Return the error text for a node that lacks one of these parameters, with a similar name if one exists."""
    name = next((one.name for one in parameters if not node.has_parameter(one.name)), '')
    return f'there is no parameter {short_repr(name)}{did_you_mean(name, tuple(node.get_parameters_by_prefix("")))}'


def _named(name: str) -> str:
    return f'parameter {name!r}: '


def _misfit(parameter: Parameter, descriptor: ParameterDescriptor, example: Any) -> str:
    """Return why the value of a parameter does not fit, and what to write instead; '' if it fits."""
    value, name = parameter.value, parameter.name
    meant: tuple[Any, ...]
    wanted = parameter.type_ if descriptor.dynamic_typing else Parameter.Type(descriptor.type)
    if parameter.type_ is not wanted:
        what = f'{_as_yaml(value)} is of type {_words(parameter.type_)}, not {_words(wanted)}; write '
        if value is None:
            what = f'it cannot be without a value of type {_words(wanted)}; write '
        meant = (_meant(value, wanted), example, _SAMPLES.get(wanted), [_SAMPLES.get(_ELEMENTS.get(wanted, wanted))])
    else:
        is_number = wanted in (Parameter.Type.INTEGER, Parameter.Type.DOUBLE)
        bounds = next(iter((*descriptor.integer_range, *descriptor.floating_point_range)), None) if is_number else None
        if bounds is None or bounds.from_value <= value <= bounds.to_value:
            return ''
        low, high = bounds.from_value, bounds.to_value
        what = f'{_as_yaml(value)} is out of range; write a value from {low} to {high}, such as '
        meant = (example, low)
    for one in meant:
        if one is not None and wanted.check(one) and not _misfit(Parameter(name, wanted, one), descriptor, None):
            return f'{what}{name}: {_as_yaml(one)}'
    return f'{what}another value'


def _meant(value: Any, wanted: Parameter.Type) -> Any:
    """Return the value that was probably meant, converted to the wanted type; None if it is not clear."""
    if wanted in _ELEMENTS:
        parts = list(value) if isinstance(value, list | tuple | array.array) else [value]
        meant = [_meant(part, _ELEMENTS[wanted]) for part in parts]
        return None if any(part is None for part in meant) else meant
    if wanted is Parameter.Type.STRING:
        return value if isinstance(value, str) else None if isinstance(value, list | array.array) else _as_yaml(value)
    if isinstance(value, str) and len(value) <= _NUMBER_CHARACTERS:
        try:
            value = load_yaml(value.strip('"\' '))
        except YamlError:
            return None
    if not isinstance(value, bool | int | float):
        return None
    if wanted is Parameter.Type.BOOL:
        return bool(value) if value in (0, 1) else None
    if isinstance(value, bool):
        return None
    if wanted is Parameter.Type.INTEGER:
        return int(value) if float(value).is_integer() else None
    return float(value)


def _words(type: Parameter.Type) -> str:
    return type.name.lower().replace('_', ' ')


def _as_yaml(value: Any) -> str:
    """Return a value in the form of a parameter file."""
    if isinstance(value, bool):
        return 'true' if value else 'false'
    return short_repr(list(value) if isinstance(value, array.array) else value)


# -------------------------------------------------------------------------------------------------------- declaring


def _fitted(given: Any, default: Any) -> Any:
    """Return the value of a parameter, converted to the type of its default if that loses nothing.

    Convert a whole number to a real one, and replace ``$(find-pkg-share PACKAGE)`` as a launch file does.

    Raises:
        ResourceError: the package is not installed.
    """
    if isinstance(default, float) and type(given) is int and int(float(given)) == given:
        return float(given)
    if isinstance(default, str) and isinstance(given, str):
        return with_package_shares(given)
    if isinstance(default, list) and default and isinstance(given, list):
        fitted = [_fitted(one, default[0]) for one in given]
        return fitted if all(type(one) is type(default[0]) for one in fitted) else given
    return given


def _declare(node: Node, name: str, default: Any, descriptor: ParameterDescriptor, is_fixed: bool) -> None:
    is_managed = isinstance(node, LifecycleNode) and not is_fixed
    if is_managed:
        descriptor.read_only = False
        descriptor.additional_constraints = READ_WHEN_CONFIGURED
    given = given_parameters(node).get(name)
    fitted = None if given is None else _fitted(given.value, default)
    is_fitted = given is not None and fitted is not given.value
    try:
        node.declare_parameter(name, fitted if is_fitted else default, descriptor, ignore_override=is_fitted)
    except (InvalidParameterTypeException, InvalidParameterValueException):
        if is_managed:  # it has no value now, but can get one
            type = Parameter(name, value=default).type_
            node.declare_parameter(name, type, descriptor, ignore_override=True)
        raise


def bounded(request_type: Any, answer: Callable[[Any, Any], Any], node: Node) -> Callable[[Any, Any], Any]:
    """Return a callback for a parameter service that refuses requests which rclpy's callback, ``answer``, cannot serve.

    It refuses a request for more than :data:`MOST_PARAMETERS` unread: rclpy takes 3 s for a million names and blocks
    the node meanwhile. For a parameter of an unknown type rclpy's callback raises, and its client waits forever. Only
    the services that set parameters can return a reason; for the others the node logs it.
    """
    asked = _ASKED_FOR[request_type]

    def answer_bounded(request: Any, response: Any) -> Any:
        count = len(getattr(request, asked))
        if count > MOST_PARAMETERS:
            reason = f'{count} {asked} in one request, of at most {MOST_PARAMETERS}; nothing was done: ask for fewer'
        elif asked == 'parameters':
            reason = next((_unknown_type(one) for one in request.parameters if one.value.type not in _TYPES), '')
        else:
            reason = ''
        if not reason:
            return answer(request, response)
        refused = SetParametersResult(successful=False, reason=reason)
        if isinstance(response, SetParameters.Response):
            response.results = [refused] * min(count, MOST_PARAMETERS)
        elif isinstance(response, SetParametersAtomically.Response):
            response.result = refused
        else:
            node.get_logger().warning(f'{request_type.__name__} refused: {reason}', throttle_duration_sec=10.0)
        return response

    return answer_bounded


def is_parameter_service(request_type: Any) -> bool:
    """Return whether this is the type of one of rclpy's parameter services."""
    return request_type in _ASKED_FOR


def _unknown_type(parameter: Any) -> str:
    return f'{short_repr(parameter.name)} is of type {parameter.value.type}, which does not exist; nothing was set'


def unknown_parameters(nodes: Sequence[Node]) -> Iterator[str]:
    """Yield a line for each parameter from arguments or files for nodes of a process that none of these nodes has
    declared."""
    known = tuple(name for node in nodes for name in node.get_parameters_by_prefix(''))
    for name in dict.fromkeys(name for node in nodes for name in given_parameters(node)):
        if not any(node.has_parameter(name) for node in nodes) and not name.startswith(_OF_QOS):
            yield f'there is no parameter {short_repr(name)}, so it is ignored{did_you_mean(name, known, "")}'


def refuse_while_configured(node: LifecycleNode, parameters: list[Parameter], state: str) -> SetParametersResult:
    """Return whether these parameters can be set while the node is in ``state``: a callback for setting parameters."""
    for parameter in parameters:
        if state != 'unconfigured' and node.has_parameter(parameter.name):
            descriptor = node.describe_parameter(parameter.name)
            if descriptor.additional_constraints == READ_WHEN_CONFIGURED:
                return SetParametersResult(
                    successful=False,
                    reason=f'{parameter.name} is {READ_WHEN_CONFIGURED}; it is {state}',
                )
    return SetParametersResult(successful=True)

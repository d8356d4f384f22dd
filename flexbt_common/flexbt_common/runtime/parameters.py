# SPDX-License-Identifier: BSD-3-Clause
"""Parameters that a node reads once: when it starts or, if it is a managed node, each time when it is configured."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException, ParameterException
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.parameter import Parameter

from flexbt_common.errors import ResourceError, UnfitParameterError
from flexbt_core.values import hint, shown

from .rclpy_private import given_parameters
from .resources import with_package_shares

READ_WHEN_CONFIGURED: Final = 'read when the node is configured; can be set while it is unconfigured'
"""Said by the descriptors of the parameters of managed nodes."""

ALLOWED_DIRECTORIES_TEXT: Final = (
    'directories, beside the package shares and those of the files that parameters name, from which services load files'
)
"""Description of the parameter ``allowed_directories`` of a node whose services get the names of files."""

MOST_PARAMETERS: Final = 1_000
"""Parameters, or names or prefixes of such, in one request."""

_ASKED_FOR: Final = {
    DescribeParameters: 'names',
    GetParameters: 'names',
    GetParameterTypes: 'names',
    ListParameters: 'prefixes',
    SetParameters: 'parameters',
    SetParametersAtomically: 'parameters',
}

_TYPES: Final = frozenset(type.value for type in Parameter.Type)

_OF_QOS: Final = 'qos_overrides.'
"""What the names of those begin with that are declared with a publisher or subscription."""


class ParameterDeclarer:
    """Declares parameters on a node, unless that was done, and gives their values; each with a description and bounds.

    A parameter is read-only, unless said otherwise, except on a managed node, where :func:`refuse_while_configured`
    decides about those that are not :attr:`fixed`.

    Every method raises UnfitParameterError where there is no value that the type and the bounds allow.
    """

    def __init__(self, node: Node, *, is_fixed: bool = False) -> None:
        self._node = node
        self._is_fixed = is_fixed

    @property
    def fixed(self) -> ParameterDeclarer:
        """Declares parameters that are as the node was started with, on a managed node, too: what decides over files,
        addresses and limits. The services that set parameters are open to every program of the domain.
        """
        return ParameterDeclarer(self._node, is_fixed=True)

    def directories(self, name: str, default: Sequence[str], description: str) -> tuple[Path, ...]:
        """Absolute directories, with ``~`` for the home of the user."""
        directories = tuple(Path(text).expanduser() for text in self.texts(name, default, description))
        for directory in directories:
            if not directory.is_absolute():
                raise UnfitParameterError(name, f'{shown(str(directory))} is not an absolute path; {description}')
        return directories

    def real(
        self, name: str, default: float, least: float, most: float, description: str, read_only: bool = True
    ) -> float:
        """A number within bounds, both included."""
        bounds = [FloatingPointRange(from_value=least, to_value=most)]
        return float(self._declare(name, default, description, read_only, floating_point_range=bounds))

    def integer(self, name: str, default: int, least: int, most: int, description: str) -> int:
        """A whole number within bounds, both included."""
        bounds = [IntegerRange(from_value=least, to_value=most, step=1)]
        return int(self._declare(name, default, description, integer_range=bounds))

    def reals(self, name: str, default: Sequence[float], description: str) -> list[float]:
        """Any number of numbers."""
        return [float(value) for value in self._declare(name, list(default), description)]

    def text(self, name: str, default: str, description: str) -> str:
        """A string."""
        return str(self._declare(name, default, description))

    def texts(self, name: str, default: Sequence[str], description: str) -> tuple[str, ...]:
        """Strings. Empty ones are left out: an empty array has no type in ROS 2, so [''] stands for it."""
        return tuple(text for text in self._declare(name, list(default) or [''], description) if text)

    def flag(self, name: str, default: bool, description: str) -> bool:
        """True or false."""
        return bool(self._declare(name, default, description))

    def _declare(self, name: str, default: Any, description: str, read_only: bool = True, **bounds: Any) -> Any:
        descriptor = ParameterDescriptor(description=description, read_only=read_only, **bounds)
        meaning = f'{description}; the default is {default!r}'
        try:
            if not self._node.has_parameter(name):
                _declare(self._node, name, default, descriptor, self._is_fixed)
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            raise UnfitParameterError(name, f'{refusal(error)}; {meaning}') from None
        except ResourceError as error:
            raise UnfitParameterError(name, f'{error}; {meaning}') from None
        value = self._node.get_parameter_or(name).value
        if value is not None:
            return value
        given = given_parameters(self._node).get(name)
        if given is not None and given.value is not None:
            raise UnfitParameterError(name, f'{shown(given.value)}, as it was started with, is refused; {meaning}')
        if given is None or not isinstance(default, list):
            raise UnfitParameterError(name, f'it has no value, or [], which has no type in ROS 2; {meaning}')
        return []


def refusal(error: ParameterException) -> str:
    """Return why rclpy refuses the value of a parameter, and what to write where that is plain."""
    told = str(error).rpartition(': ')[0]  # it ends with the name once more
    return f'{told}; write it without quotes' if "of type 'STRING'" in told and 'STRING_ARRAY' not in told else told


def _fitted(given: Any, default: Any) -> Any:
    """Give the value of a parameter the type of its default, where nothing is lost by that; otherwise it is as given.

    A whole number stands for a real one. Where a launch file would replace ``$(find-pkg-share PACKAGE)``, so does this.

    Raises:
        ResourceError: there is no such package.
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
    """Return a callback for one of the parameter services that refuses what rclpy's own, ``answer``, cannot serve.

    A request for more than :data:`MOST_PARAMETERS` is refused before it is looked at: rclpy takes 3 s for a million
    names, in which the node hears nothing. For a parameter of a type that does not exist rclpy's callback raises, and
    its client waits for ever. Only the services that set parameters can give a reason; for the others it is logged.
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
    """Return whether this is the type of one of the services that rclpy's nodes have for their parameters."""
    return request_type in _ASKED_FOR


def _unknown_type(parameter: Any) -> str:
    return f'{shown(parameter.name)} is of type {parameter.value.type}, which does not exist; nothing was set'


def unknown_parameters(nodes: Sequence[Node]) -> Iterator[str]:
    """A line for each parameter that arguments or files have given to nodes of a process, and that none of them has
    declared."""
    known = tuple(name for node in nodes for name in node.get_parameters_by_prefix(''))
    for name in dict.fromkeys(name for node in nodes for name in given_parameters(node)):
        if not any(node.has_parameter(name) for node in nodes) and not name.startswith(_OF_QOS):
            yield f'there is no parameter {shown(name)}, so it is ignored{hint(name, known, "")}'


def refuse_while_configured(node: LifecycleNode, parameters: list[Parameter], state: str) -> SetParametersResult:
    """Whether these parameters can be set while the node is in ``state``: a callback for setting parameters."""
    for parameter in parameters:
        if state != 'unconfigured' and node.has_parameter(parameter.name):
            descriptor = node.describe_parameter(parameter.name)
            if descriptor.additional_constraints == READ_WHEN_CONFIGURED:
                return SetParametersResult(
                    successful=False,
                    reason=f'{parameter.name} is {READ_WHEN_CONFIGURED}; it is {state}',
                )
    return SetParametersResult(successful=True)

# SPDX-License-Identifier: BSD-3-Clause
"""Parameters that a node reads once: when it starts or, if it is a managed node, each time when it is configured."""

from __future__ import annotations

from typing import Any, Final

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterUninitializedException,
)
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.parameter import Parameter

from flexbt_common.errors import UnfitParameterError

READ_WHEN_CONFIGURED: Final = 'read when the node is configured; can be set while it is unconfigured'
"""Said by the descriptors of the parameters of managed nodes."""


def declare(node: Node, name: str, default: Any, descriptor: ParameterDescriptor) -> Any:
    """Declare a parameter, unless that was done, and give its value.

    It is read-only, except on a managed node, where :func:`refuse_while_configured` decides.

    Raises:
        UnfitParameterError: there is no value that its type and its limits allow.
    """
    try:
        if not node.has_parameter(name):
            _declare(node, name, default, descriptor)
        return node.get_parameter(name).value
    except (InvalidParameterTypeException, InvalidParameterValueException) as error:
        raise UnfitParameterError(name, f'{error}; {descriptor.description}') from None
    except ParameterUninitializedException:
        raise UnfitParameterError(name, f'its value was refused, set another one; {descriptor.description}') from None


def _declare(node: Node, name: str, default: Any, descriptor: ParameterDescriptor) -> None:
    is_managed = isinstance(node, LifecycleNode)
    descriptor.read_only = not is_managed
    if is_managed:
        descriptor.additional_constraints = READ_WHEN_CONFIGURED
    try:
        node.declare_parameter(name, default, descriptor)
    except (InvalidParameterTypeException, InvalidParameterValueException):
        if is_managed:  # it has no value now, but can get one
            type = Parameter(name, value=default).type_
            node.declare_parameter(name, type, descriptor, ignore_override=True)
        raise


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

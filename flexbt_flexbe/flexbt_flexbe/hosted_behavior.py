# SPDX-License-Identifier: BSD-3-Clause
"""A FlexBE behavior for the executive, without the harmless faults that FlexBE allows in a state machine."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final

from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.definition import Child, StateKind
from flexbt_core.state_machine.model.state_host import Severity
from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_flexbe.api.behavior import YAML_PREFIX, converted, from_yaml_file, is_yaml_file
from flexbt_flexbe.api.behavior import Behavior as FlexbeBehavior
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorParameter
from flexbt_onboard.behaviors.run_context import current_run
from flexbt_onboard.errors import ParameterError

from .errors import FlexbeManifestError
from .manifest import FlexbeManifest

_SLASH: Final = '/'


class HostedBehavior(Behavior):
    """A behavior with the parameters of the manifest. It creates FlexBE's behavior when the run builds the machine.

    Arguments may also name parameters of embedded behaviors by path, such as ``/Inner/speed``.
    """

    def __init__(self, source: FlexbeManifest, of_code: Sequence[BehaviorParameter] = ()) -> None:
        """``of_code`` are the parameters that only the code has."""
        self.manifest = source.manifest
        super().__init__()
        self._source = source
        self._of_code = {parameter.name: parameter for parameter in of_code}
        self._given: dict[str, Any] = {}

    def set_arguments(self, arguments: Sequence[tuple[str, str]]) -> None:
        """Set parameters to the operator's values: all of them, or none.

        A name that the manifest lacks may be in the code; :meth:`create` checks it there.

        Raises:
            ParameterError: a name appears twice, or a text is not a value of the type.
        """
        given: dict[str, Any] = {}
        for argument, text in arguments:
            is_file = argument.startswith(YAML_PREFIX)
            name = argument.removeprefix(YAML_PREFIX)
            key = f'/{name.strip(_SLASH)}' if _SLASH in name.strip(_SLASH) else name.strip(_SLASH)
            if key in given:
                raise ParameterError(f'parameter {key!r} is given twice')
            given[key] = self._value_in_file(key, text) if is_file else self._value(key, text)
        self._given = given

    def create(self) -> OperatableStateMachine:
        """Build the machine of FlexBE's behavior. Call it on the thread of a run.

        Raises:
            ParameterError: the behavior lacks a parameter, or does not accept its value.
        """
        run = current_run()
        behavior = load_class(self._source)(run.services.runtime.node)
        for parameter in self.manifest.parameters:
            if behavior.has_parameter(parameter.name) and parameter.name not in self._given:
                default = self._content(parameter.name, parameter.default)
                if default != '' or isinstance(getattr(behavior, parameter.name), str):
                    behavior.set_own_parameter(parameter.name, default)
        for name, value in self._given.items():
            if not behavior.set_parameter(name, value):
                why = _embedded_hint(behavior, name) or did_you_mean(name, behavior.parameter_names())
                raise ParameterError(f'behavior {self.name!r}: its code has no parameter {name!r}{why}')
        machine = behavior.create()
        if isinstance(machine, OperatableStateMachine):  # else the run reports that it is not a machine
            without_harmless_faults(machine, partial(run.log, Severity.WARN, ''))
        return machine

    def _declared(self, name: str) -> BehaviorParameter | None:
        return next((one for one in self.manifest.parameters if one.name == name), None)

    def _value_in_file(self, name: str, text: str) -> Any:
        value, parameter = from_yaml_file(name, text), self._declared(name)
        if parameter is None or (isinstance(parameter.default, str) and not parameter.choices):
            return value  # the code has the type; for the manifest everything else is text
        return parameter.checked(converted(name, value, parameter.default))

    def _value(self, name: str, text: str) -> Any:
        parameter = self._declared(name)
        if parameter is None:
            if name in self._of_code:
                converted(name, text, self._of_code[name].default)
            return text  # the code or an embedded behavior has the type, and checks it later
        return self._content(name, parameter.from_text(text))

    def _content(self, name: str, value: Any) -> Any:
        """Return a parameter's value; for a YAML parameter, read the file that it names."""
        is_file = name in self._source.yaml and is_yaml_file(str(value))
        return from_yaml_file(name, str(value)) if is_file else value


def load_class(source: FlexbeManifest) -> type[Any]:
    """Return the class named in a manifest; its constructor takes the node. Raises any error of the module's import.

    Raises:
        FlexbeManifestError: the module lacks the class, or the class is for FlexBE on ROS 1.
    """
    module = importlib.import_module(source.module)
    found = getattr(module, source.class_name, None)
    if not (isinstance(found, type) and issubclass(found, FlexbeBehavior)):
        problem = (
            'has no such class'
            if found is None
            else f'has {short_repr(found)} there, which is not a Behavior of flexbe_core'
        )
        raise FlexbeManifestError(f'{source.file}: class {source.class_name}: module {source.module} {problem}')
    try:
        inspect.signature(found).bind(None)
    except TypeError as error:
        raise FlexbeManifestError(
            f'{inspect.getfile(found)}: class {source.class_name}: __init__ cannot be called with the node alone '
            f'({error}); behaviors of FlexBE for ROS 1 take none: write __init__(self, node), and bring the states '
            'from rospy to rclpy, too'
        ) from error
    return found


def _embedded_hint(behavior: FlexbeBehavior, name: str) -> str:
    """Return a hint with the embedded behaviors, if the path of a parameter names none of them."""
    path = name.rpartition(_SLASH)[0]
    embedded = behavior.get_contained_behaviors()
    if not path or path in embedded:
        return ''
    return f'; there is no embedded behavior {path!r}, there are: {", ".join(sorted(embedded)) or "none"}'


# Harmless faults in a state machine that FlexBE accepts and the engine's check would refuse.


def without_harmless_faults(machine: OperatableStateMachine, warn: Callable[[str], None], path: str = '') -> None:
    """Remove parts without an effect from a machine and its nested machines; call ``warn`` for each.

    These are states that no transition leads to, and autonomy levels, transitions and remappings for outcomes or keys
    that a state does not have.
    """
    if machine.kind is not StateKind.CONCURRENCY:
        reached = _reached(machine)
        for child in machine.children:
            if child.label not in reached:
                warn(f'{path}/{child.label}: left out, since no transition leads to it from the initial state')
        machine.children[:] = [child for child in machine.children if child.label in reached]
    machine.children[:] = [_without_unknown_names(child, warn, f'{path}/{child.label}') for child in machine.children]
    for child in machine.children:
        if isinstance(child.state, OperatableStateMachine):
            without_harmless_faults(child.state, warn, f'{path}/{child.label}')


def _reached(machine: OperatableStateMachine) -> set[str]:
    children = {child.label: child for child in machine.children}
    reached: set[str] = set()
    ahead = [child.label for child in machine.children[:1]]
    while ahead:
        label = ahead.pop()
        if label in children and label not in reached:
            reached.add(label)
            child = children[label]
            ahead += [target for outcome, target in child.transitions.items() if outcome in child.state.outcomes]
    return reached


def _without_unknown_names(child: Child, warn: Callable[[str], None], path: str) -> Child:
    outcomes = child.state.outcomes
    keys = {*child.state.input_keys, *child.state.output_keys}
    for what, names, known in (
        ('transition', child.transitions, outcomes),
        ('autonomy', child.autonomy, outcomes),
        ('remapping', child.remapping, keys),
    ):
        for name in names:
            if name not in known:
                warn(f'{path}: its {what} of {name!r} has no effect, since it has nothing of that name')
    return replace(
        child,
        transitions={name: target for name, target in child.transitions.items() if name in outcomes},
        autonomy={name: level for name, level in child.autonomy.items() if name in outcomes},
        remapping={name: key for name, key in child.remapping.items() if name in keys},
    )

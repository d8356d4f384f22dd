# SPDX-License-Identifier: BSD-3-Clause
"""Userdata, which the states of a machine pass to each other, and the errors of the state-machine engine.

StateMachineError
├── MachineError     a machine cannot run; the error lists all problems
├── UserDataError    a userdata key is not declared or was never written
└── StateError       a state is used incorrectly
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

from flexbt_core.values.findings import FindingRecord, finding_record
from flexbt_core.values.text import short_repr, truncate_middle

from .state_host import Severity, StateHost


class StateMachineError(Exception):
    """Base of the errors of the engine."""


@dataclass(frozen=True, slots=True)
class MachineProblem:
    """A problem of a machine. ``path`` is the state or machine, and ``part`` leads from there to what is wrong, as
    ``('transitions', 'done')``: to the name there, or if ``is_value`` to its value."""

    path: str
    text: str
    part: tuple[str | int, ...] = ()
    is_value: bool = False

    def __str__(self) -> str:
        return f'{self.path}: {self.text}'


class MachineError(StateMachineError):
    """A machine cannot run. ``problems`` lists all its problems, in the order of its states; ``found`` are the same as
    they were given, and ``records`` the same for programs, with their places if it was read from a text."""

    def __init__(self, problems: Iterable[str | MachineProblem], records: Sequence[FindingRecord] = ()) -> None:
        self.found = tuple(problems)
        self.problems: tuple[str, ...] = tuple(map(str, self.found))
        self.records = tuple(records) or tuple(
            finding_record('refused', 'error', one)
            if isinstance(one, str)
            else finding_record('refused', 'error', one.text, node=one.path)
            for one in self.found
        )
        super().__init__('; '.join(self.problems))


class UserDataError(StateMachineError):
    """A state used a userdata key that is not declared or was never written."""


class StateError(StateMachineError):
    """A state was used incorrectly."""


def check_names(owner: object, outcomes: Iterable[object], keys: Iterable[object]) -> None:
    """Check that outcomes and userdata keys are text. YAML reads on, off, yes and no as booleans.

    Raises:
        StateError: one of them is not.
    """
    for what, names in (('an outcome', outcomes), ('a userdata key', keys)):
        for name in names:
            if not isinstance(name, str):
                said = f'{short_repr(name)} cannot be {what}: it is not text; in YAML, quote it'
                raise StateError(f'{type(owner).__name__}: {said}')


# Userdata: the values that the states of a machine pass to each other.
#
# Each machine has its own scope. A state sees only the keys that it declares, through a :class:`UserData` view;
# remapping maps them to the names in its machine. A state that reads a key without writing it gets a copy, so that
# only a state that declares an output can change the value. (FlexBE instead hashes the text of such values in every
# tick, which is slow and misses changes.) Values that cannot be copied, such as a driver or a lock, are passed without
# a copy, with a warning.

_IMMUTABLE: Final = (bool, int, float, complex, str, bytes, type(None))


def _copied(value: Any) -> tuple[Any, Exception | None]:
    """Return a copy of a value and None; or the value itself and the error, if it cannot be copied."""
    try:
        return (value if isinstance(value, _IMMUTABLE) else copy.deepcopy(value)), None
    except Exception as error:  # code of the value
        return value, error


class Scope:
    """The userdata of one machine while it is active.

    It starts with copies of ``defaults``. ``inputs`` and ``outputs`` map its keys to those of the parent: an input
    that was not written here is read there, and an output is also written there. A key that is both is that of the
    parent, where a concurrent state may write it too: this scope holds no value of its own for it.
    """

    __slots__ = ('_data', '_inputs', '_outputs', '_parent', 'now', 'shared_types', 'writers')

    def __init__(
        self,
        defaults: Mapping[str, Any],
        parent: Scope | None = None,
        inputs: Mapping[str, str] = MappingProxyType({}),
        outputs: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        self._data: dict[str, Any] = {}
        self.writers: dict[str, tuple[str, float]] = {}
        """The state that has written a key last, and when, s; without keys that no state has written."""
        self.now: Callable[[], float] = float if parent is None else parent.now
        self._parent = parent
        self._inputs = inputs
        self._outputs = outputs
        self.shared_types: set[type[Any]] = set() if parent is None else parent.shared_types
        for key, value in defaults.items():
            # A value of the parent overrides the default.
            if parent is None or key not in inputs or inputs[key] not in parent:
                self.set(key, _copied(value)[0])

    def __contains__(self, key: object) -> bool:
        if key in self._data:
            return True
        return self._parent is not None and key in self._inputs and self._inputs[str(key)] in self._parent

    def get(self, key: str) -> Any:
        """Return the value of a key. Raises KeyError if it was never written."""
        if key in self._data:
            return self._data[key]
        if self._parent is not None and key in self._inputs:
            return self._parent.get(self._inputs[key])
        raise KeyError(key)

    def set(self, key: str, value: Any, writer: str = '') -> None:
        """Write a key. ``writer`` is the path of the state, '' if it is no state."""
        if self._parent is not None and key in self._outputs:
            self._parent.set(self._outputs[key], value, writer)
            if key in self._inputs:
                return
        self._data[key] = value
        if writer:
            self.writers[key] = writer, self.now()
        else:
            self.writers.pop(key, None)

    def note_shared(self, value: Any) -> bool:
        """Record that a value is passed without a copy. Return whether it is the first of its type in the run."""
        is_first = type(value) not in self.shared_types
        self.shared_types.add(type(value))
        return is_first

    def values(self) -> dict[str, Any]:
        """Return the keys and values of this scope, without those of its inputs."""
        return dict(self._data)

    def visible(self) -> dict[str, Any]:
        """Return the keys and values of this scope and of its inputs."""
        inputs = {key: self.get(key) for key in self._inputs if key in self}
        return {**inputs, **self._data}

    def restore(self, values: Mapping[str, Any]) -> None:
        """Restore the values of an earlier scope of this machine, without writing them to the parent."""
        shared = self._inputs.keys() & self._outputs.keys()
        self._data.update((key, value) for key, value in values.items() if key not in shared)


def _reason(error: Exception) -> str:
    try:
        return truncate_middle(str(error)) or type(error).__name__
    except Exception:  # code of the value
        return type(error).__name__


class UserData:
    """A state's view of its machine's userdata: ``userdata.key`` or ``userdata['key']``."""

    __slots__ = ('_copies', '_inputs', '_outputs', '_owner', '_remap', '_scope')

    def __init__(
        self,
        scope: Scope,
        input_keys: frozenset[str],
        output_keys: frozenset[str],
        remap: Mapping[str, str],
        owner: StateHost,
    ) -> None:
        set_slot = object.__setattr__
        set_slot(self, '_scope', scope)
        set_slot(self, '_inputs', input_keys)
        set_slot(self, '_outputs', output_keys)
        set_slot(self, '_remap', remap)
        set_slot(self, '_owner', owner)
        set_slot(self, '_copies', {})

    def __getitem__(self, key: str) -> Any:
        if key not in self._inputs and key not in self._outputs:
            raise UserDataError(f"{self._owner.path}: cannot read userdata key '{key}'; declare it in input_keys")
        name = self._remap.get(key, key)
        is_shared = key in self._outputs
        shown = f"'{key}'" if name == key else f"'{key}' (remapped to '{name}')"
        try:
            value = self._scope.get(name)
        except KeyError:
            raise UserDataError(
                f'{self._owner.path}: userdata key {shown} has no value; nobody has written it'
            ) from None
        if is_shared or isinstance(value, _IMMUTABLE):
            return value
        original, copy_of_it = self._copies.get(name, (None, None))
        if original is value:  # else a concurrent state has written another value
            return copy_of_it
        own, reason = _copied(value)
        if reason is not None and self._scope.note_shared(value):
            self._owner.log(
                Severity.WARN,
                f"the {type(value).__name__} in userdata key '{name}' cannot be copied ({_reason(reason)}): states get "
                'the object itself, and see what others change in it',
            )
        self._copies[name] = value, own
        return own

    def __setitem__(self, key: str, value: Any) -> None:
        if key not in self._outputs:
            raise UserDataError(f"{self._owner.path}: cannot write userdata key '{key}'; declare it in output_keys")
        name = self._remap.get(key, key)
        self._copies.pop(name, None)  # also copies read by another key that maps to this name
        self._scope.set(name, value, self._owner.path)

    def __getattr__(self, key: str) -> Any:
        if key.startswith('_'):
            raise AttributeError(key)
        return self[key]

    def __setattr__(self, key: str, value: Any) -> None:
        if key.startswith('_'):
            raise AttributeError(f'{key}: userdata keys do not begin with an underscore')
        self[key] = value

    def __contains__(self, key: object) -> bool:
        declared = key in self._inputs or key in self._outputs
        return declared and self._remap.get(str(key), str(key)) in self._scope

    def __iter__(self) -> Iterator[str]:
        return (key for key in sorted(self._inputs | self._outputs) if key in self)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __repr__(self) -> str:
        return f'UserData({", ".join(f"{key}={short_repr(self[key])}" for key in self)})'


class DefaultUserData:
    """The defaults of a machine, written while it is built: ``machine.userdata.key = value``."""

    def __init__(self) -> None:
        object.__setattr__(self, '_data', {})

    def __getattr__(self, key: str) -> Any:
        if key.startswith('_') or key not in self._data:
            raise AttributeError(f"the machine has no default for userdata key '{key}'")
        return self._data[key]

    def __setattr__(self, key: str, value: Any) -> None:
        self[key] = value

    def __getitem__(self, key: str) -> Any:
        return self._data[key]

    def __setitem__(self, key: str, value: Any) -> None:
        if not key or key.startswith('_'):
            raise UserDataError(f"'{key}' cannot be a userdata key: it is empty or begins with an underscore")
        self._data[key] = value

    def __contains__(self, key: object) -> bool:
        return key in self._data

    def values(self) -> dict[str, Any]:
        """Return the keys and default values."""
        return dict(self._data)

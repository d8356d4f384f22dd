# SPDX-License-Identifier: BSD-3-Clause
"""The common part of all proxies: their run, and the states that wait for messages."""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType, MethodType
from typing import Any, TypeVar

from flexbt_common.values.value_types import resolve_type
from flexbt_core.errors import FlexbtError
from flexbt_core.state_machine.model.event_state import EventState, called_state
from flexbt_core.values.text import short_repr
from flexbt_flexbe.errors import ProxyError
from flexbt_onboard.behaviors.run_context import RunContext, current_run

Proxy = TypeVar('Proxy', bound=type[Any])


class RunProxy:
    """The base class of the proxies. A proxy belongs to the run in which it is created."""

    def __init__(self) -> None:
        self._run = current_run()

    @classmethod
    def of_run(cls, _run: RunContext) -> Any:
        """Return the proxy of a run whose methods are called on the class."""
        return cls()

    @staticmethod
    def initialize(node: Any) -> None:
        """Do nothing: a proxy finds the node of its run. (The paper's package calls it ``_initialize``.)"""

    _initialize = initialize

    @staticmethod
    def shutdown() -> None:
        """Do nothing: the resources of proxies are closed with the run."""


class _OnClassToo:
    """See :func:`callable_on_class`."""

    def __init__(self, method: Callable[..., Any]) -> None:
        self._method = method
        self.__doc__ = method.__doc__

    def __get__(self, proxy: Any, owner: type[Any]) -> Callable[..., Any]:
        return MethodType(self._method, current_run().shared(owner.of_run) if proxy is None else proxy)


def callable_on_class(proxy: Proxy) -> Proxy:
    """Make methods callable on the class too, as in FlexBE. For proxies that share their data within a run."""
    for name, method in tuple(vars(proxy).items()):
        if isinstance(method, FunctionType) and not name.startswith('_'):
            setattr(proxy, name, _OnClassToo(method))
    return proxy


def calling_state() -> EventState | None:
    """Return the calling state, without its wrappers."""
    state = called_state()
    return None if state is None else state.unwrapped


class Listeners:
    """The states that have requested data and are woken when it arrives."""

    def __init__(self) -> None:
        self._states: set[EventState] = set()

    def note_caller(self) -> None:
        """Add the calling state to the states to wake."""
        state = calling_state()
        if state is not None:
            self._states.add(state)

    def has_caller(self) -> bool:
        """Return whether the calling state is one of them."""
        return calling_state() in self._states

    def has(self, state: EventState) -> bool:
        """Return whether a state is one of them."""
        return state in self._states

    def wake(self) -> None:
        """Wake the states, since data has arrived. Callable from any thread."""
        for state in tuple(self._states):
            state.wake()


def message_class(topic: str, message: str | type[Any]) -> type[Any]:
    """Return the message class of a topic, from the class or its name, such as ``std_msgs/msg/String``.

    Raises:
        ProxyError: ``message`` is neither a message class nor the name of one.
    """
    if isinstance(message, type) and hasattr(message, 'get_fields_and_field_types'):
        return message
    if not isinstance(message, str):
        raise ProxyError(f'topic {topic!r}: {short_repr(message)} is neither a message class nor the name of one')
    try:
        resolved = resolve_type(message)
    except FlexbtError as error:
        raise ProxyError(f'topic {topic!r}: {error}') from None
    if resolved.message is None or resolved.is_array:
        raise ProxyError(f'topic {topic!r}: {message} is not a message; a topic carries package/msg/Name')
    return resolved.message

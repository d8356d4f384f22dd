# SPDX-License-Identifier: BSD-3-Clause
"""The private parts of rclpy that this code uses, and their replacements where rclpy has changed.

Everything also works without them (rclpy 7.1, ROS 2 Jazzy): each use below only makes something faster, or completes
something that rclpy leaves undone. Once in a process, before the first node is created, this module checks that rclpy
has each part with the expected signature. If one is missing, its use is left out as a whole, documented functions
replace it, and every node logs a warning at its start (:func:`warnings`).

The environment variable FLEXBT_STOCK_RCLPY=1 disables all uses. :func:`release_lifecycle` needs no private name: it
finds an attribute by its type, and does nothing without one.
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Coroutine, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from types import FunctionType
from typing import Any, Final

from rclpy.executors import Executor
from rclpy.impl import rcutils_logger
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription
from rclpy.waitable import NumberOfEntities

SWITCH: Final = 'FLEXBT_STOCK_RCLPY'


@dataclass(frozen=True)
class PrivatePart:
    """A private part of rclpy: a method with the number of its parameters after ``self``, an attribute that methods of
    the class set (``parameters`` None), or a member of a compiled class (None as well)."""

    owner: type
    name: str
    parameters: int | None = None

    def fault(self) -> str:
        """Return the difference from the expected part, or ''."""
        where = f'{self.owner.__module__}.{self.owner.__qualname__}.{self.name}'
        if not (hasattr(self.owner, self.name) or self.name in _named_in_methods(self.owner)):
            return f'{where} is missing'
        if self.parameters is None:
            return ''
        signature = inspect.signature(getattr(self.owner, self.name))
        return '' if len(signature.parameters) == 1 + self.parameters else f'{where}{signature} has another signature'


@dataclass(frozen=True)
class PrivateUse:
    """A use of private parts. ``loss`` is what is slower or missing without them; it follows a colon."""

    parts: tuple[PrivatePart, ...]
    loss: str


ExtendedLogger: Final[Any] = rcutils_logger.RcutilsLogger
"""The logger of rclpy's nodes, as a base; it has no public name."""


def log_for_callers_of(file: str) -> None:
    """Make rclpy's logger treat callers of functions in this file as the place that logs, by which it throttles.

    rclpy keeps names that other code adds to this list.
    """
    rcutils_logger._internal_callers.append(os.path.realpath(file))


def _named_in_methods(owner: type) -> set[str]:
    functions = (member for base in owner.__mro__ for member in vars(base).values() if isinstance(member, FunctionType))
    return {name for function in functions for name in function.__code__.co_names}


_STATE_MACHINE: Final = getattr(rclpy_implementation, 'LifecycleStateMachine', ())
_WAIT_SET: Final = getattr(rclpy_implementation, 'WaitSet', object)
_SUBSCRIPTION: Final = getattr(rclpy_implementation, 'Subscription', object)
_WAIT_SET_MEMBERS: Final = (
    'add_client',
    'add_guard_condition',
    'add_service',
    'add_subscription',
    'add_timer',
    'clear_entities',
    'get_ready_entities',
    'wait',
)

EXECUTOR: Final = PrivateUse(
    (
        *(
            PrivatePart(Executor, f'_take_{kind}', 1)
            for kind in ('timer', 'subscription', 'client', 'service', 'guard_condition', 'waitable')
        ),
        PrivatePart(_SUBSCRIPTION, 'take_message'),
        *(PrivatePart(_WAIT_SET, member) for member in _WAIT_SET_MEMBERS),
    ),
    'the stock executor takes about 0.15 ms of processor time longer for each callback, is woken by each message of '
    '/clock, and does not tell who has written a message: floods of commands are not told from those of operators, nor '
    'names that others use',
)
PARAMETERS: Final = PrivateUse(
    (PrivatePart(Node, '_parameter_overrides'),),
    'a parameter that was given and that a node does not have is not told; a whole number is refused where a parameter '
    'is a real one, [] where it is a list, and $(find-pkg-share PACKAGE) is not replaced',
)
_USES: Final = (EXECUTOR, PARAMETERS)


@cache
def _faults(use: PrivateUse) -> tuple[str, ...]:
    return tuple(fault for part in use.parts if (fault := part.fault()))


def is_usable(use: PrivateUse) -> bool:
    """Return whether rclpy has all the parts for it, and the environment does not forbid them."""
    return os.environ.get(SWITCH, '0') in ('', '0') and not _faults(use)


def warnings() -> Iterator[str]:
    """Yield a line for each use for which a part is missing: which ones, and what is slower or lost."""
    for use in _USES:
        if _faults(use):
            yield f'this version of rclpy is not fully known: {", ".join(_faults(use))}. Without: {use.loss}'


# --------------------------------------------------------------------------------------------------------- executor

Take = Callable[[Any], Callable[[], Coroutine[Any, Any, None]] | None]
"""A function that takes the data of an entity and returns the call of its callback, or None."""


class ExtendedExecutor(Executor):
    """rclpy's executor, with what a custom loop needs. EXECUTOR has to be usable."""

    def takes(self) -> dict[str, Take]:
        """Return the functions that take data, by the wait set's names for kinds of entities, and 'waitable'."""
        return {
            'timer': self._take_timer,
            'subscription': self._take_subscription,
            'guard_condition': self._take_guard_condition,
            'client': self._take_client,
            'service': self._take_service,
            'waitable': self._take_waitable,
        }

    def taking_all(self, subscription: Subscription) -> Callable[[Subscription], object] | None:
        """Return the function that takes and handles all pending messages of a subscription; None if rclpy takes one at
        a time. A callback may have it as ``take_all`` (received_messages.py).
        """
        taking: Callable[[Subscription], object] | None = getattr(subscription.callback, 'take_all', None)
        return taking

    def _take_subscription(self, subscription: Subscription) -> Callable[[], Coroutine[Any, Any, None]] | None:
        take_all = self.taking_all(subscription)
        if take_all is None:
            taken: Callable[[], Coroutine[Any, Any, None]] | None = super()._take_subscription(subscription)
            return taken
        take_all(subscription)
        return None  # nothing is left to call


def wait_set(count: NumberOfEntities, context: Any) -> Any:
    """Return a wait set with room for this many entities."""
    return rclpy_implementation.WaitSet(
        count.num_subscriptions,
        count.num_guard_conditions,
        count.num_timers,
        count.num_clients,
        count.num_services,
        count.num_events,
        context.handle,
    )


# ------------------------------------------------------------------------------------------------------- parameters


def given_parameters(node: Node) -> Mapping[str, Parameter]:
    """Return the parameters of a node from arguments and files, declared or not; empty without PARAMETERS."""
    return node._parameter_overrides if is_usable(PARAMETERS) else {}


# -------------------------------------------------------------------------------------------------------- lifecycle


def release_lifecycle(node: Node) -> None:
    """Remove the lifecycle services of a node from the graph, after the node is destroyed.

    rclpy's state machine, a compiled object, keeps these services, and so the participant and its threads, until Python
    collects the node. This function finds it by its type, under any name.
    """
    for name, part in tuple(vars(node).items()):
        if isinstance(part, _STATE_MACHINE):
            delattr(node, name)

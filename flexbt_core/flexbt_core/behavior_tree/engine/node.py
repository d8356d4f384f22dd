# SPDX-License-Identifier: BSD-3-Clause
"""The base of all nodes: identity, status, ports, wake-ups and errors; how a parent ticks and halts a node.

A parent ticks a child through a callable that it fetches once, when the tree is built (:func:`tick_function`). For most
nodes this is :meth:`TreeNode.execute` itself, which *stores the status*; any conditions and callbacks of a node are
wrapped around it. The rules for every ``execute``:

* it stores the status that it returns, but never SKIPPED (so a RUNNING node stays RUNNING);
* it keeps or resets the statuses of children as ``parents`` describes.
"""

from __future__ import annotations

import functools
import math
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Final, NamedTuple

from flexbt_core.behavior_tree.model.blackboard import EMPTY, MISSING, Blackboard, Entry
from flexbt_core.behavior_tree.model.definition import ParsedScript
from flexbt_core.behavior_tree.model.errors import (
    BlackboardError,
    ConversionError,
    NodeExecutionError,
    PortError,
    ScriptError,
)
from flexbt_core.behavior_tree.model.outcomes import Example, Outcomes
from flexbt_core.behavior_tree.model.ports import NO_DEFAULT, Port, PortValue, cast
from flexbt_core.behavior_tree.model.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, NodeKind, NodeStatus
from flexbt_core.clock.clock import Clock
from flexbt_core.values.text import short_repr

from .context import Tick, TreeContext

StatusObserver = Callable[['TreeNode', NodeStatus, NodeStatus], None]
"""A listener to status changes, called at once on the ticking thread with node, status before, and status after."""

NO_PORTS: Mapping[str, Port] = {}
NOTHING_READ: dict[str, Any] = {}
"""Cached entries of a node that has not read a port yet: shared, and never written."""


class NodeConfig(NamedTuple):
    """The constructor arguments of a node. Pass them to ``super().__init__`` unchanged."""

    id: str
    name: str
    uid: int
    scope: str
    context: TreeContext
    blackboard: Blackboard
    values: Mapping[str, PortValue]


class TreeNode(ABC):
    """A node of a running tree. Derive from the bases in ``leaf``, or from Decorator or Control.

    ``ports`` declares the ports of the class. A class with state of a run creates it in ``__init__``, which passes the
    NodeConfig to ``super().__init__``.
    """

    __slots__ = (
        '_entries',
        '_scope',
        '_values',
        'blackboard',
        'conditions',
        'context',
        'decided_by',
        'id',
        'name',
        'stored_status',
        'uid',
    )

    ports: ClassVar[Mapping[str, Port]] = NO_PORTS
    kind: ClassVar[NodeKind]
    xml_name: ClassVar[str]
    """XML name of nodes of exactly this class, if it differs from the name of the class."""
    nav2_branch: ClassVar[str] = ''
    """The branch of Nav2 that exactly this class is for (see ``NodeRegistry``); '' if it is for all.

    Two classes with one ID are for different branches. A class with a unique ID is for nodes that only its branch has.
    """
    example: ClassVar[Example | None] = None
    """A tree that shows the behavior of nodes of exactly this class; derived classes do not inherit it."""
    outcomes: ClassVar[Outcomes | None] = None
    """Possible results of nodes of exactly this class, and the children that they may tick. None: unknown."""

    running_at_completion: ClassVar[bool | None] = False
    """True if a node is RUNNING when a tick stores its result. False: it has its status from before the tick. None: it
    depends."""

    conditions: Conditions | None
    """Pre- and post-conditions; None if the node has none."""
    decided_by: object
    """Pre-condition or callback that decided the last result instead of the tick; its ``str`` describes it. None: the
    tick itself."""

    def __init__(self, config: NodeConfig) -> None:
        self.stored_status: NodeStatus = IDLE
        self.conditions = None
        self.decided_by = None
        self.id = config.id
        self.name = config.name
        self.uid = config.uid
        self.context = config.context
        self.blackboard = config.blackboard
        self._scope = config.scope
        self._values = config.values
        self._entries: dict[str, tuple[Entry, type[Any]]] = NOTHING_READ

    def __repr__(self) -> str:
        return f'<{self.id} [{self.path}] {self.status.name}>'

    @property
    def status(self) -> NodeStatus:
        """Stored status of the last tick. Setting a result first runs the post-conditions."""
        return self.stored_status

    @status.setter
    def status(self, status: NodeStatus) -> None:
        conditions = self.conditions
        if conditions is not None and conditions.pending and (status is SUCCESS or status is FAILURE):
            conditions.complete(status)
        self.store_status(status)

    def store_status(self, status: NodeStatus) -> None:
        """Store a status, and notify the observers if it changed. No post-conditions run."""
        before = self.stored_status
        if status is not before:
            self.stored_status = status
            for observer in self.context.observers:
                observer(self, before, status)

    @property
    def path(self) -> str:
        """Path within the tree: sub-tree instances, then the name; ``ID::uid`` for a node without a name."""
        return node_path(self._scope, self.id, self.name, self.uid)

    @property
    def attached(self) -> tuple[TreeNode, ...]:
        """The children, in their order."""
        return ()

    @property
    def clock(self) -> Clock:
        return self.context.clock

    @property
    def services(self) -> Any:
        """Services that the host of the tree provides to its leaves."""
        return self.context.services

    @abstractmethod
    def execute(self) -> NodeStatus:
        """Tick the node and store its status. Only the base classes implement it."""

    def halt(self) -> None:
        """Stop the work of the node, and set it to IDLE. Must be harmless on a node without work."""
        self.status = IDLE

    def halt_node(self) -> None:
        """Halt the node from outside: :meth:`halt`, then the script that follows it, as haltNode() in
        BehaviorTree.CPP. Raises NodeExecutionError."""
        try:
            self.halt()
        except NodeExecutionError:
            raise
        except BaseException as error:
            raise self.fault(error) from error
        if self.conditions is not None:
            self.conditions.halted()

    def failure_cause(self) -> TreeNode | None:
        """Return the child whose failure made this node fail in the last tick; None if it failed by itself."""
        return None

    def failure_reason(self) -> str:
        """Return why this node failed in the last tick: its own reason, or how the failure of a child led to it."""
        return f'{self.id} returned FAILURE'

    # -- wake-ups ----------------------------------------------------------------------------------------------------

    def wake(self) -> None:
        """Request a tick of the tree as soon as possible. From any thread."""
        self.context.wake()

    def wake_at(self, when: float) -> None:
        """Request a tick at the time ``when`` of the clock, instead of any earlier request. Only within a tick.

        Raises NodeExecutionError if ``when`` is NaN, since that would hide the requests of other nodes.
        """
        context = self.context
        if when < context.earliest:
            context.earliest = when
        elif math.isnan(when):
            raise self.fault('a node cannot be woken at the time nan; give seconds of its clock')
        context.deadlines[self] = when

    def cancel_wake(self) -> None:
        """Withdraw the request of :meth:`wake_at`."""
        if self.context.deadlines:
            self.context.deadlines.pop(self, None)

    # -- ports -------------------------------------------------------------------------------------------------------

    def get_input(self, port: str) -> Any:
        """Return the value of an input port, converted to its type. Raises PortError if missing or unfit."""
        known = self._entries.get(port)
        if known is not None:
            entry, ready = known
            content = entry.value
            if content.__class__ is ready and entry.present:
                return content
        return self._read_input(port)

    def _read_input(self, port: str) -> Any:
        """Read a port for :meth:`get_input`; cache its entry, and the class whose values need no conversion."""
        value = self._values.get(port)
        if value is None:
            return self._absent_input(port)
        declared = self._readable(port).type
        if value.key is None:
            if value.literal is not NO_DEFAULT:
                self._remember(port, Entry.constant(value.literal), value.literal.__class__)
                return value.literal
            if declared is None or declared.from_text is None:
                return value.text
            try:
                return declared.parse(value.text)
            except ConversionError as error:
                raise self._port_error(port, str(error)) from error
        entry = self.blackboard.entry(value.key)
        if entry is None:
            raise self._port_error(port, 'the blackboard has no such entry', is_absent=True)
        content = entry.value
        if content is EMPTY:
            raise self._port_error(port, 'the entry was never written', is_absent=True)
        if declared is None:
            return content
        # Integers have bounds; an entry of the same type was checked against them when it was written.
        if declared.category != 'integer' or entry.type is declared:
            self._remember(port, entry, declared.python_type)
            if content.__class__ is declared.python_type:
                return content
        try:
            return cast(content, declared)
        except ConversionError as error:
            raise self._port_error(port, str(error)) from error

    def _remember(self, port: str, entry: Entry, ready: type[Any]) -> None:
        if self._entries is NOTHING_READ:
            self._entries = {}
        self._entries[port] = entry, ready

    def ready_entry(self, port: str) -> Entry:
        """Return the entry in which the last :meth:`get_input` of the port found a value that needs no conversion.

        While the value is of the Python class of the port's type, ``get_input`` returns it, so a node that reads a port
        in each tick checks the entry first. Return MISSING if the value needed conversion.
        """
        known = self._entries.get(port)
        return MISSING if known is None else known[0]

    def get_input_or(self, port: str, default: Any) -> Any:
        """Return the value of an input port; ``default`` if the XML does not set it, or its entry is missing or was
        never written.

        An existing value that does not fit still raises PortError.
        """
        value = self._values.get(port)
        if value is None:
            declared = self._readable(port)
            return default if declared.default is NO_DEFAULT else declared.default
        if value.key is not None:
            entry = self.blackboard.entry(value.key)
            if entry is None or entry.value is EMPTY:
                return default
        return self.get_input(port)

    def set_output(self, port: str, value: Any) -> None:
        """Write an output port. If the XML does not set the port, do nothing.

        Raises PortError if the value does not fit the port or the entry, or if the port holds a literal.
        """
        declared = self._declared(port)
        if not declared.writable:
            raise self._port_error(port, 'it is not declared as an output')
        given = self._values.get(port)
        if given is None:
            return
        if given.key is None:
            raise self._port_error(port, f"an output has to point to the blackboard, as in {{key}}, not '{given.text}'")
        kind = declared.type
        try:
            if kind is not None and (value.__class__ is not kind.python_type or kind.category == 'integer'):
                value = cast(value, kind)
            self.blackboard.set(given.key, value, kind)
        except (BlackboardError, ConversionError) as error:
            raise self._port_error(port, str(error)) from error

    @property
    def port_values(self) -> Mapping[str, PortValue]:
        """Values of the ports from the XML or from defaults, by name; ports without either are missing."""
        return self._values

    def port_key(self, port: str) -> str | None:
        """Return the blackboard key that a port points to; None if it holds a literal or is not set."""
        self._declared(port)
        value = self._values.get(port)
        return None if value is None else value.key

    def port_text(self, port: str) -> str | None:
        """Return the text of the XML for a port; None if it is not set and has no default."""
        value = self._values.get(port)
        return None if value is None else value.text

    def _declared(self, port: str) -> Port:
        declared = self.ports.get(port)
        if declared is None:
            raise self._port_error(port, f'{type(self).__name__} declares no such port')
        return declared

    def _readable(self, port: str) -> Port:
        declared = self._declared(port)
        if not declared.readable:
            raise self._port_error(port, 'it is not declared as an input')
        return declared

    def _absent_input(self, port: str) -> Any:
        declared = self._readable(port)
        if declared.default is not NO_DEFAULT:
            return declared.default
        raise self._port_error(port, 'it is not given in the XML, and has no default')

    def _port_error(self, port: str, reason: str, *, is_absent: bool = False) -> PortError:
        value = self._values.get(port)
        key = None if value is None else value.key
        return PortError(self.path, self.id, port, key, reason, self.uid, is_absent=is_absent)

    # -- errors ------------------------------------------------------------------------------------------------------

    def fault(self, cause: BaseException | str) -> NodeExecutionError:
        """Return an error of this node with ``cause``, any exception of its code. A PortError is an error of the node
        with the port, which may be below this one.

        Raises ``cause`` if it is a KeyboardInterrupt on the main thread: it comes from the user then, not from the
        node.
        """
        if isinstance(cause, KeyboardInterrupt) and threading.current_thread() is threading.main_thread():
            raise cause
        if isinstance(cause, PortError):
            return NodeExecutionError(cause.node_path, cause.node_id, cause, cause.uid)
        return NodeExecutionError(self.path, self.id, cause, self.uid)

    def stop_by(self, callback: Callable[[], None]) -> None:
        """Call a callback that stops work; store its error, which the tree raises after it has halted all nodes."""
        try:
            callback()
        except NodeExecutionError as error:
            self.context.halt_errors.append(error)
        except BaseException as error:
            fault = self.fault(error)
            fault.__cause__ = error
            self.context.halt_errors.append(fault)

    def checked(self, status: object) -> NodeStatus:
        """Return ``status`` if a tick may return it; otherwise raise NodeExecutionError."""
        if status is IDLE:
            raise self.fault('a tick must not return IDLE')
        if not isinstance(status, NodeStatus):
            raise self.fault(f'a tick has to return a NodeStatus, not {short_repr(status)}')
        if status is RUNNING and self.kind is NodeKind.CONDITION:
            raise self.fault('a condition must not return RUNNING; use StatefulAction for a test that takes time')
        return status


WATCHED_STATUS: Final = vars(TreeNode)['status']
"""The property above. Only nodes with observers or post-conditions use it (see ``observers.watch``)."""
# Elsewhere ``status`` is the slot itself: a call of the property takes several times as long as a simple tick.
TreeNode.status = vars(TreeNode)['stored_status']  # type: ignore[method-assign]


def node_path(scope: str, id: str, name: str, uid: int) -> str:
    """Return the path of a node in the sub-tree instance ``scope``; see :attr:`TreeNode.path`."""
    own = f'{name}::{uid}' if name == id else name
    return f'{scope}/{own}' if scope else own


# Ticking and halting nodes from outside, as executeTick() and haltNode() in BehaviorTree.CPP.


def tick_function(node: TreeNode) -> Tick:
    """Return the callable by which a parent, or the tree, ticks ``node``.

    From the inside to the outside, as in BehaviorTree.CPP: the tick itself, the pre-tick callback, the post-conditions,
    the pre-conditions, the post-tick callback. For a node that has none of them, this is its ``execute``.
    """
    callbacks = node.context.callbacks
    conditions = node.conditions
    tick: Tick = node.execute
    if callbacks is not None:
        tick = callbacks.before(node, tick)
    if conditions is not None:
        tick = conditions.around(tick)
    if callbacks is not None:
        tick = callbacks.after(node, tick)
    return tick


def halt_child(child: TreeNode) -> None:
    """Halt the child if it is RUNNING, and set it to IDLE in any case."""
    status = child.stored_status
    if status is not IDLE:
        if status is RUNNING:
            child.halt_node()
        child.status = IDLE


# Pre- and post-conditions: scripts in attributes that any node may have.
#
# Before a node starts, ``_failureIf``, ``_successIf``, ``_skipIf``, ``_while`` are evaluated in this order: the first
# that is true (``_while``: false) decides the result, and the node is not ticked. While the node is RUNNING, only
# ``_while`` is evaluated; if it is false, the node is halted and SKIPPED. ``_onSuccess`` or ``_onFailure``, and then
# ``_post``, run when the node completes, before its status is stored, even if a pre-condition decided the result.
# ``_onHalted`` runs after every halt, in any status.

# For each pre-condition, the truth with which it decides, and the result.
_DECISIONS: Final[Mapping[str, tuple[bool, NodeStatus]]] = {
    '_failureIf': (True, FAILURE),
    '_successIf': (True, SUCCESS),
    '_skipIf': (True, SKIPPED),
    '_while': (False, SKIPPED),
}
# For each post-condition, the results for which it runs, in running order.
_COMPLETIONS: Final[Mapping[str, tuple[NodeStatus, ...]]] = {
    '_onSuccess': (SUCCESS,),
    '_onFailure': (FAILURE,),
    '_post': (SUCCESS, FAILURE),
}


class NodeScript:
    """A script of a node, with its attribute."""

    __slots__ = ('attribute', 'bound', 'node', 'text')

    def __init__(self, node: TreeNode, attribute: str, script: ParsedScript) -> None:
        self.node = node
        self.attribute = attribute
        self.text = script.text
        self.bound = script.bind(node.blackboard, condition=attribute in _DECISIONS)

    def __str__(self) -> str:
        return f'[{self.text}] of {self.attribute} holds'

    def run(self) -> bool | None:
        """Run the script. Raises NodeExecutionError."""
        try:
            return self.bound.run()
        except ScriptError as error:
            raise self.fault(error) from error

    def fault(self, error: ScriptError) -> NodeExecutionError:
        """Return the error of the node for a failed script."""
        reason = f'{self.attribute}: {error.reason}'
        return self.node.fault(ScriptError(error.script, error.offset, reason, is_absent=error.is_absent))


class _PreCondition(NodeScript):
    """A script evaluated before a tick of the node. Its decision replaces the tick."""

    __slots__ = ('_decides', '_decisive', '_ongoing', '_tick', 'result')

    def __init__(
        self, node: TreeNode, attribute: str, script: ParsedScript, decides: Callable[[_PreCondition], NodeStatus]
    ) -> None:
        super().__init__(node, attribute, script)
        self._decides = decides
        self._decisive, self.result = _DECISIONS[attribute]
        self._ongoing = attribute == '_while'

    def before(self, tick: Tick) -> Tick:
        """Return ``tick`` with the pre-condition before it."""
        self._tick = tick
        return self._ask_and_tick

    def _ask_and_tick(self) -> NodeStatus:
        node = self.node
        node.decided_by = None
        status = node.stored_status
        if status is IDLE or status is SKIPPED or (status is RUNNING and self._ongoing):
            # Fetched from the slot first, here and below: a direct call is slower in Python.
            run = self.bound.run
            try:
                holds = run()
            except ScriptError as error:
                raise self.fault(error) from error
            if holds is self._decisive:
                return self._decides(self)
        tick = self._tick
        return tick()


class _PostCondition(NodeScript):
    """A script that runs when the node completes."""

    __slots__ = ('_tick', 'statuses')

    def __init__(self, node: TreeNode, attribute: str, script: ParsedScript) -> None:
        super().__init__(node, attribute, script)
        self.statuses = _COMPLETIONS[attribute]

    def after(self, tick: Tick) -> Tick:
        """Return ``tick`` with the script after it, for nodes whose result no observer sees before that."""
        self._tick = tick
        return self._tick_and_run

    def _tick_and_run(self) -> NodeStatus:
        node = self.node
        before = node.stored_status
        tick = self._tick
        status = tick()
        if status in self.statuses:
            run = self.bound.run
            try:
                run()
            except ScriptError as error:
                node.status = RUNNING if node.running_at_completion else before
                raise self.fault(error) from error
        return status


class Conditions:
    """The scripts of one node."""

    __slots__ = ('_halted', '_inner', '_node', '_post', '_pre', 'pending')

    def __init__(self, node: TreeNode, scripts: Mapping[str, ParsedScript]) -> None:
        self._node = node
        self._pre = [_PreCondition(node, one, scripts[one], self._decide) for one in _DECISIONS if one in scripts]
        self._post = [_PostCondition(node, one, scripts[one]) for one in _COMPLETIONS if one in scripts]
        self._halted = NodeScript(node, '_onHalted', scripts['_onHalted']) if '_onHalted' in scripts else None
        self.pending = False
        """True if the post-conditions have yet to run in this tick."""

    @property
    def run_at_store(self) -> bool:
        """True if the post-conditions run when the node stores its result; if unobserved, they run after the tick."""
        node = self._node
        return bool(self._post) and bool(node.context.observers or node.running_at_completion is None)

    def around(self, tick: Tick) -> Tick:
        """Return ``tick`` with the conditions around it."""
        if self.run_at_store:
            self._inner = tick
            tick = self._tick_and_complete
        else:
            for post in self._post:
                tick = post.after(tick)
        for pre in reversed(self._pre):
            tick = pre.before(tick)
        return tick

    def _decide(self, script: _PreCondition) -> NodeStatus:
        """Complete the node with the result of this pre-condition, or halt it if it was RUNNING."""
        node, result = self._node, script.result
        if result is not SKIPPED:
            node.decided_by = script
            self.complete(result)
            node.status = result
        elif node.stored_status is RUNNING:
            node.halt_node()
        return result

    def _tick_and_complete(self) -> NodeStatus:
        self.pending = True
        status = self._inner()
        if self.pending:
            if status is SUCCESS or status is FAILURE:
                # Only if the node already had the result, and did not store it again.
                self.complete(status)
            self.pending = False
        return status

    def complete(self, status: NodeStatus) -> None:
        """Run the scripts for completion with this status, before the status is stored. If one raises, the node does
        not complete."""
        self.pending = False
        for script in self._post:
            if status in script.statuses:
                script.run()

    def halted(self) -> None:
        """Run the script ``_onHalted``."""
        if self._halted is not None:
            self._halted.run()


# Classes derived from the classes of nodes: each is made once, and lives as long as its base class.

_KEPT: Final = '_derived_classes'


def kept_by_class(make: Callable[..., type[Any]]) -> Callable[..., type[Any]]:
    """Cache a function that derives from the class in its first argument, as functools.cache does, but on that class:
    the derived classes end with it, if a proof or a reload made it for a limited time."""

    @functools.wraps(make)
    def made(plain: type[Any], *rest: Any) -> type[Any]:
        known = plain.__dict__.get(_KEPT)
        if known is None:
            known = {}
            setattr(plain, _KEPT, known)
        found: type[Any] | None = known.get((make, rest))
        return found or known.setdefault((make, rest), make(plain, *rest))

    return made

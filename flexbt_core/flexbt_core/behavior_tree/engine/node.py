# SPDX-License-Identifier: BSD-3-Clause
"""The base of all nodes: identity, status, ports, wake-ups and errors; how a parent ticks and halts a node.

A parent ticks a child through a callable that it fetched once, when the tree was built (``ticking.tick_function``).
For most nodes that is :meth:`TreeNode.execute` itself, which *stores the status*; only what a node has of conditions
and callbacks is wrapped around it. The rules that every ``execute`` keeps:

* it stores the status that it returns, but never SKIPPED (so a node that was RUNNING stays so);
* of the statuses of children it keeps what ``control`` and ``decorator`` say.
"""

from __future__ import annotations

import functools
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
"""A listener to changes of a status: node, status before, and status after. Called on the ticking thread, at once."""

NO_PORTS: Mapping[str, Port] = {}
NOTHING_READ: dict[str, Any] = {}
"""Entries of a node that has not read a port yet: shared, and never written."""


class NodeConfig(NamedTuple):
    """The arguments that a node is made with. Pass them to ``super().__init__`` unchanged."""

    id: str
    name: str
    uid: int
    scope: str
    context: TreeContext
    blackboard: Blackboard
    values: Mapping[str, PortValue]


class TreeNode(ABC):
    """A node of a running tree. Derive from the bases in ``leaf``, or from Decorator or Control.

    ``ports`` declares the ports of the class. A class that keeps state of a run creates it in ``__init__``, which takes
    the NodeConfig and passes it on.
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
    """XML name of nodes of exactly this class, if that is not the name of the class."""
    nav2_branch: ClassVar[str] = ''
    """The branch of Nav2 that exactly this class is for (see ``NodeRegistry``); '' if it is for all.

    Of two classes with one ID each is for another branch; where there is but one, that branch alone has such nodes.
    """
    example: ClassVar[Example | None] = None
    """A tree that shows what nodes of exactly this class do: a derived class has its own, or none."""
    outcomes: ClassVar[Outcomes | None] = None
    """Possible results of nodes of exactly this class, and the children that they may tick. None: not known."""

    running_at_completion: ClassVar[bool | None] = False
    """True if a node is RUNNING when a tick stores its result. False: its status is the one before the tick. None: it
    depends."""

    conditions: Conditions | None
    """The pre- and post-conditions, if it has any."""
    decided_by: object
    """Object that decided the last result in place of the tick, a pre-condition or a callback; its text describes it.
    None: the tick itself."""

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
        """Stored status of the last tick. Setting a result runs the post-conditions first."""
        return self.stored_status

    @status.setter
    def status(self, status: NodeStatus) -> None:
        conditions = self.conditions
        if conditions is not None and conditions.pending and (status is SUCCESS or status is FAILURE):
            conditions.complete(status)
        self.store_status(status)

    def store_status(self, status: NodeStatus) -> None:
        """Store a status, and tell the observers if it is another one than before. No post-conditions run."""
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
        """One tick, status stored. Only the bases implement it."""

    def halt(self) -> None:
        """Stop what the node is doing, and sets it to IDLE. Must be harmless on a node that does nothing."""
        self.status = IDLE

    def halt_node(self) -> None:
        """Halt the node from outside: :meth:`halt`, then the script that follows it, as haltNode() in
        BehaviorTree.CPP."""
        self.halt()
        if self.conditions is not None:
            self.conditions.halted()

    def failure_cause(self) -> TreeNode | None:
        """Return the child because of which this node failed just now; None when it failed by itself."""
        return None

    def failure_reason(self) -> str:
        """Why this node failed just now: when a child is to blame, what made the failure of that its own."""
        return f'{self.id} returned FAILURE'

    # -- wake-ups ----------------------------------------------------------------------------------------------------

    def wake(self) -> None:
        """Ask for a tick of the tree as soon as possible. From any thread."""
        self.context.wake()

    def wake_at(self, when: float) -> None:
        """Ask for a tick at the time ``when`` of the clock; replaces an earlier one. Only within a tick."""
        context = self.context
        context.deadlines[self] = when
        if when < context.earliest:
            context.earliest = when

    def cancel_wake(self) -> None:
        """Take back :meth:`wake_at`."""
        if self.context.deadlines:
            self.context.deadlines.pop(self, None)

    # -- ports -------------------------------------------------------------------------------------------------------

    def get_input(self, port: str) -> Any:
        """Return the value of an input port, converted to its type. Raises PortError when there is none that fits."""
        known = self._entries.get(port)
        if known is not None:
            entry, ready = known
            content = entry.value
            if content.__class__ is ready and entry.present:
                return content
        return self._read_input(port)

    def _read_input(self, port: str) -> Any:
        """As :meth:`get_input`; remembers for it where the value is, and of which class it needs no conversion."""
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
        # Integers have bounds; those of an entry of the same type were kept when it was written.
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
        """Return where the last :meth:`get_input` of the port has found a value that it need not convert.

        As long as the value there is of the Python class of the port's type, ``get_input`` returns it; so a node that
        reads a port in each tick looks there first. MISSING if it had to be converted.
        """
        known = self._entries.get(port)
        return MISSING if known is None else known[0]

    def get_input_or(self, port: str, default: Any) -> Any:
        """Return the value of an input port; ``default`` when it is not given, or its entry is missing or was never
        written.

        An existing value that does not fit is still an error.
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
        """Write an output port. A port that the XML does not give is not written, which is not an error.

        Raises PortError when the value does not fit the port or the entry, or when the port holds a literal.
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
        """Return the blackboard key that a port points to; None when it holds a literal or is not given."""
        self._declared(port)
        value = self._values.get(port)
        return None if value is None else value.key

    def port_text(self, port: str) -> str | None:
        """Return the text of the XML for a port; None when it is not given and has no default."""
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
        """Return the error that names this node as the place of ``cause``, any exception of its code.

        Raises KeyboardInterrupt when that is the cause, and on the main thread: it is the user's then, and not the
        node's.
        """
        if isinstance(cause, KeyboardInterrupt) and threading.current_thread() is threading.main_thread():
            raise cause
        return NodeExecutionError(self.path, self.id, cause, self.uid)

    def stop_by(self, callback: Callable[[], None]) -> None:
        """Call what stops the work of a node. Others have to be halted even if it raises; the tree raises it then."""
        try:
            callback()
        except NodeExecutionError as error:
            self.context.halt_errors.append(error)
        except BaseException as error:
            fault = self.fault(error)
            fault.__cause__ = error
            self.context.halt_errors.append(fault)

    def checked(self, status: object) -> NodeStatus:
        """``status``, when it is what a tick may give; otherwise raises NodeExecutionError."""
        if status is IDLE:
            raise self.fault('a tick must not return IDLE')
        if not isinstance(status, NodeStatus):
            raise self.fault(f'a tick has to return a NodeStatus, not {short_repr(status)}')
        if status is RUNNING and self.kind is NodeKind.CONDITION:
            raise self.fault('a condition must not return RUNNING; use StatefulAction for a test that takes time')
        return status


WATCHED_STATUS: Final = vars(TreeNode)['status']
"""The property above. A node has it only where its setter has something to do (see ``observers.watch``)."""
# Everywhere else ``status`` is the slot itself: to call the property takes several times as long as a simple tick.
TreeNode.status = vars(TreeNode)['stored_status']  # type: ignore[method-assign]


def node_path(scope: str, id: str, name: str, uid: int) -> str:
    """Return the path of a node in the sub-tree instance ``scope``; see :attr:`TreeNode.path`."""
    own = f'{name}::{uid}' if name == id else name
    return f'{scope}/{own}' if scope else own


# How nodes are ticked and halted from outside: what executeTick() and haltNode() are in BehaviorTree.CPP.


def tick_function(node: TreeNode) -> Tick:
    """Return the callable by which a parent, or the tree, ticks ``node``.

    From the inside to the outside, as in BehaviorTree.CPP: the tick itself, the pre-tick callback, the post-conditions,
    the pre-conditions, the post-tick callback. A node that has none of them is ticked by its ``execute``.
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
    """Halt the child when it is RUNNING, and sets it to IDLE in any case."""
    status = child.stored_status
    if status is not IDLE:
        if status is RUNNING:
            child.halt_node()
        child.status = IDLE


# Pre- and post-conditions: scripts in attributes that any node may have.
#
# ``_failureIf``, ``_successIf``, ``_skipIf`` and ``_while`` are evaluated in this order before a node begins: the first
# that is true (``_while``: false) decides the result, and the node is not ticked. While the node is RUNNING only
# ``_while`` is evaluated; when it is false, the node is halted and SKIPPED. ``_onSuccess`` or ``_onFailure``, and then
# ``_post``, run when the node completes, before its status is stored; also when a pre-condition has decided.
# ``_onHalted`` runs whenever the node was halted, in any status.

# What a pre-condition has to be for it to decide, and the result then.
_DECISIONS: Final[Mapping[str, tuple[bool, NodeStatus]]] = {
    '_failureIf': (True, FAILURE),
    '_successIf': (True, SUCCESS),
    '_skipIf': (True, SKIPPED),
    '_while': (False, SKIPPED),
}
# With what the node completes when a post-condition runs, in the order in which they run.
_COMPLETIONS: Final[Mapping[str, tuple[NodeStatus, ...]]] = {
    '_onSuccess': (SUCCESS,),
    '_onFailure': (FAILURE,),
    '_post': (SUCCESS, FAILURE),
}


class NodeScript:
    """A script of a node, and the attribute that it is in."""

    __slots__ = ('_node', 'attribute', 'bound', 'text')

    def __init__(self, node: TreeNode, attribute: str, script: ParsedScript) -> None:
        self._node = node
        self.attribute = attribute
        self.text = script.text
        self.bound = script.bind(node.blackboard, condition=attribute in _DECISIONS)

    def __str__(self) -> str:
        return f'[{self.text}] of {self.attribute} holds'

    def run(self) -> bool | None:
        """Run it. Raises NodeExecutionError."""
        try:
            return self.bound.run()
        except ScriptError as error:
            raise self.fault(error) from error

    def fault(self, error: ScriptError) -> NodeExecutionError:
        """Return the error of the node whose script has failed."""
        reason = f'{self.attribute}: {error.reason}'
        return self._node.fault(ScriptError(error.script, error.offset, reason, is_absent=error.is_absent))


class _PreCondition(NodeScript):
    """A script that is evaluated before a tick of the node: its decision replaces the tick."""

    __slots__ = ('_decides', '_decisive', '_ongoing', '_tick', 'result')

    def __init__(
        self, node: TreeNode, attribute: str, script: ParsedScript, decides: Callable[[_PreCondition], NodeStatus]
    ) -> None:
        super().__init__(node, attribute, script)
        self._decides = decides
        self._decisive, self.result = _DECISIONS[attribute]
        self._ongoing = attribute == '_while'

    def before(self, tick: Tick) -> Tick:
        """Return ``tick`` with the question before it."""
        self._tick = tick
        return self._ask_and_tick

    def _ask_and_tick(self) -> NodeStatus:
        node = self._node
        node.decided_by = None
        status = node.stored_status
        if status is IDLE or status is SKIPPED or (status is RUNNING and self._ongoing):
            # What is in a slot is fetched first here and below: Python is slower to call it at once.
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
        """Return ``tick`` with the script after it, for nodes whose result is not observed before that."""
        self._tick = tick
        return self._tick_and_run

    def _tick_and_run(self) -> NodeStatus:
        node = self._node
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
        """True if the post-conditions are still to be run in this tick."""

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
        """Complete the node with the result that this pre-condition gives, or halt it when it was RUNNING."""
        node, result = self._node, script.result
        if result is not SKIPPED:
            node.decided_by = script if result is FAILURE else None
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
                # Only when the result stood already, and was not stored again.
                self.complete(status)
            self.pending = False
        return status

    def complete(self, status: NodeStatus) -> None:
        """Run the scripts for the node's completing with this status, before it is stored: when one raises, the node
        has not completed."""
        self.pending = False
        for script in self._post:
            if status in script.statuses:
                script.run()

    def halted(self) -> None:
        """Run the script for the node's having been halted."""
        if self._halted is not None:
            self._halted.run()


# Classes that are made of the classes of nodes: each once, for as long as the class exists of which it is made.

_KEPT: Final = '_derived_classes'


def kept_by_class(make: Callable[..., type[Any]]) -> Callable[..., type[Any]]:
    """As functools.cache, for a function that derives from the class that is its first argument: what it makes goes
    with that class, where a proof or a reload has made one for a time only."""

    @functools.wraps(make)
    def made(plain: type[Any], *rest: Any) -> type[Any]:
        known = plain.__dict__.get(_KEPT)
        if known is None:
            known = {}
            setattr(plain, _KEPT, known)
        found: type[Any] | None = known.get((make, rest))
        return found or known.setdefault((make, rest), make(plain, *rest))

    return made

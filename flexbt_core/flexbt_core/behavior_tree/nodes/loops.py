# SPDX-License-Identifier: BSD-3-Clause
"""LoopInt, LoopBool, LoopDouble and LoopString: the child runs once for each element of a queue."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Any, ClassVar, Final

from flexbt_core.behavior_tree.engine.node import NodeConfig, TreeNode
from flexbt_core.behavior_tree.engine.parents import DecoratorNode
from flexbt_core.behavior_tree.model.blackboard import MISSING, Entry
from flexbt_core.behavior_tree.model.errors import ConversionError
from flexbt_core.behavior_tree.model.outcomes import Example
from flexbt_core.behavior_tree.model.ports import (
    BOOL,
    DOUBLE,
    INT,
    NODE_STATUS,
    STRING,
    PortType,
    between_semicolons,
    inout_port,
    input_port,
    is_fixed,
    output_port,
)
from flexbt_core.behavior_tree.model.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, NodeStatus


def _queue_of(element: PortType) -> PortType:
    name = f'queue of {element.name}'
    return PortType(name, tuple, from_text=lambda text: tuple(between_semicolons(text, element)), immutable=True)


_END: Final = object()
"""Placeholder that marks the end of the queue."""


class Loop(DecoratorNode):
    """For each element of ``queue``, writes it to ``value`` and ticks the child until it completes.

    FAILURE as soon as the child fails. After any other result, also SKIPPED, the node is RUNNING and continues with the
    next element at the next tick. If the queue is empty at the beginning of a tick, the node returns ``if_empty``.

    Each run of the node restarts a queue that is written in the XML (elements separated by ``;``). From a
    ``collections.deque`` on the blackboard the node removes the elements, so other nodes may append to it meanwhile. It
    reads a list, a tuple or a text on the blackboard once in a run, and does not change it.

    For elements of another type: ``class LoopPose(Loop, element=POSE_STAMPED)``.
    """

    __slots__ = ('_child_failed', '_child_running', '_constant', '_python_type', '_queue', '_rest', '_target')

    running_at_completion = None
    element: ClassVar[PortType]
    queue: ClassVar[PortType]
    """Type of a queue written as text."""

    def __init_subclass__(cls, element: PortType | None = None) -> None:
        if element is not None:
            cls.__doc__ = cls.__doc__ or Loop.__doc__
            cls.element = element
            cls.queue = _queue_of(element)
            cls.ports = {
                'queue': inout_port(literal=cls.queue, description='elements separated by ;, or {key}'),
                'if_empty': input_port(NODE_STATUS, default='SUCCESS', description='result when no element is left'),
                'value': output_port(element, description='the element that the child is to use'),
            }

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        given = config.values['queue']
        self._constant: tuple[Any, ...] | None = given.literal if given.key is None else None
        # A constant queue starts with the run; a node that a pre-condition completed has not started one.
        self._rest: Iterator[Any] = iter(())
        self._queue: deque[Any] | None = None
        # Output entry for the elements of a constant queue, set once its type matches theirs. While it holds a value
        # of their class, it still exists, and needs no conversion.
        self._target = MISSING
        self._python_type = self.element.python_type
        self._child_running = False
        self._child_failed = False

    def execute(self) -> NodeStatus:
        constant = self._constant
        if self.stored_status is IDLE:
            self._child_running = False
            if constant is None:
                self._queue = None
            else:
                self._rest = iter(constant)
        if not self._child_running:
            if constant is None:
                element = self._next_shared()
                if element is _END:
                    return self._empty()
            else:
                # Inlined next(): a call would take much longer.
                for element in self._rest:  # noqa: B007 - it is used below
                    break
                else:
                    return self._empty()
            target = self._target
            if target.value.__class__ is self._python_type:
                # Inlined target.write.
                target.value = element
                target.sequence += 1
            else:
                self._write(element)
        if self.stored_status is IDLE:
            self.status = RUNNING
        status = self._tick()
        if status is SUCCESS:
            self._child_running = False
            self.child.status = IDLE
        elif status is FAILURE:
            self._child_running = False
            self.child.status = IDLE
            self._child_failed = True
            self.status = FAILURE
            return FAILURE
        else:
            self._child_running = status is RUNNING
        self.status = RUNNING
        return RUNNING

    def _write(self, element: Any) -> None:
        self.set_output('value', element)
        if self._constant is not None:
            key = self.port_key('value')
            entry = Entry.constant(element) if key is None else self.blackboard.entry(key)
            if entry is not None and (key is None or (is_fixed(entry.type) and entry.type.same(self.element))):
                self._target = entry

    def _next_shared(self) -> Any:
        """Return the next element of a queue on the blackboard; _END if it is empty."""
        try:
            return self._shared().popleft()
        except IndexError:
            # Empty, or another tree that shares the queue has just removed the last element.
            return _END

    def _shared(self) -> deque[Any]:
        """Return the deque on the blackboard, or the rest of the copy that this run made."""
        content = self.get_input_or('queue', None)
        if isinstance(content, deque):
            self._queue = content
        elif self._queue is None:
            self._queue = deque(self._copied(content))
        return self._queue

    def _copied(self, content: Any) -> list[Any] | tuple[Any, ...]:
        if isinstance(content, list | tuple):
            return content
        if content is None:
            reason = 'the blackboard has no such entry, or it was never written'
            raise self._port_error('queue', reason, is_absent=True)
        if not isinstance(content, str):
            kind = type(content).__name__
            raise self._port_error('queue', f'a queue is a deque, a list, a tuple or a text, not a {kind}')
        try:
            return self.queue.parse(content)
        except ConversionError as error:
            raise self._port_error('queue', str(error)) from error

    def _empty(self) -> NodeStatus:
        self._child_failed = False
        status: NodeStatus = self.get_input('if_empty')
        if status is not SKIPPED:
            self.status = self.checked(status)
        return status

    def failure_cause(self) -> TreeNode | None:
        return self.child if self._child_failed else None

    def failure_reason(self) -> str:
        if self._child_failed:
            return super().failure_reason()
        return f'{self.id}: the queue is empty (if_empty="{self.port_text("if_empty")}")'


class LoopInt(Loop, element=INT):
    __slots__ = ()

    example = Example(
        '<LoopInt queue="1;2;3" value="{item}"><Script code="sum += item"/></LoopInt>',
        ticks=(RUNNING, RUNNING, RUNNING, SUCCESS),
        before={'sum': 0},
        after={'sum': 6},
    )


class LoopBool(Loop, element=BOOL):
    __slots__ = ()

    example = Example(
        '<LoopBool queue="true;false" value="{item}"><AlwaysSuccess/></LoopBool>',
        ticks=(RUNNING, RUNNING, SUCCESS),
    )


class LoopDouble(Loop, element=DOUBLE):
    __slots__ = ()

    example = Example(
        '<LoopDouble queue="0.5;1.5" value="{item}"><AlwaysSuccess/></LoopDouble>',
        ticks=(RUNNING, RUNNING, SUCCESS),
        after={'item': 1.5},
    )


class LoopString(Loop, element=STRING):
    __slots__ = ()

    example = Example(
        '<LoopString queue="dock;kitchen" if_empty="FAILURE" value="{place}"><AlwaysSuccess/></LoopString>',
        ticks=(RUNNING, RUNNING, FAILURE),
        after={'place': 'kitchen'},
    )


NODES: Final = (
    LoopInt,
    LoopBool,
    LoopDouble,
    LoopString,
)

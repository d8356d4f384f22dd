# SPDX-License-Identifier: BSD-3-Clause
"""Node classes in which a store of the status is not a call, also where it is logged.

In the plain classes ``status`` is a property, which runs post-conditions and tells observers. A node for which it has
nothing to do gets a class, derived from its own, in which ``status`` is the slot itself. In a tree that only writes a
status log its methods are those of ``inlining``. Nothing else differs.
"""

from __future__ import annotations

import ast
import functools
import itertools
import sys
import types
from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib.abc import InspectLoader
from typing import Any, Final, TypeVar

from flexbt_core.behavior_tree.engine.conditions import Conditions
from flexbt_core.behavior_tree.engine.node import TreeNode, kept_by_class
from flexbt_core.behavior_tree.engine.observers import PLACES, SHIFT, LogReader, StatusLog
from flexbt_core.behavior_tree.model.status import FAILURE, RUNNING, SUCCESS, NodeKind, NodeStatus

Observers = Sequence[Callable[..., None]]

_STATUS_SLOT: Final = vars(TreeNode)['_stored_status']


def plain_class(node_class: type[Any]) -> type[Any]:
    """Return the class of which this one may be a faster form."""
    plain: type[Any] = vars(node_class).get('plain_class', node_class)
    return plain


def stores_directly(node: TreeNode) -> bool:
    """Return whether a store of the node's status is not a call."""
    node_class: Any = type(node)
    return node_class.status is _STATUS_SLOT


def class_for(plain: Any, observers: Observers, conditions: Conditions | None) -> type[Any]:
    """Return the fastest class for a node of a tree with these observers."""
    halting = conditions is not None and conditions.halting
    if conditions is not None and conditions.completing and (observers or plain.running_at_completion is None):
        return plain
    if not observers:
        return direct_class(plain, halting)
    return logging_class(plain, halting) if _log_of(observers) is not None else plain


def fit(node: TreeNode) -> None:
    """Give a node the class that suits what is around it."""
    context: Any = node.context
    conditions: Any = node.conditions
    context.log = _log_of(context.observers)
    if context.log is not None:
        node.marks = marks_of(node)
    node_class = class_for(plain_class(type(node)), context.observers, conditions)
    if node_class is not type(node):
        node.__class__ = node_class


def _log_of(observers: Observers) -> Any:
    """Return the log to which everything is written, if nobody else observes the tree."""
    return observers[0].log if len(observers) == 1 and isinstance(observers[0], StatusLog) else None


@kept_by_class
def direct_class(plain: type[Any], halting: bool) -> type[Any]:
    """``plain`` with the slot itself as status. A node of it that is ``halting`` has a script that runs then."""
    return _derived(plain, halting, {'status': _STATUS_SLOT})


@kept_by_class
def logging_class(plain: type[Any], halting: bool) -> type[Any]:
    """``plain`` with methods that write to the log of the tree."""
    return _derived(plain, halting, inlined_methods(plain))


def _derived(plain: type[Any], halting: bool, members: dict[str, Any]) -> type[Any]:
    def fill(namespace: dict[str, Any]) -> None:
        namespace.update(
            members,
            __slots__=(),
            __module__=plain.__module__,
            __qualname__=plain.__qualname__,
            __doc__=plain.__doc__,
            plain_class=plain,
        )
        if not halting and 'halt_node' not in plain.__dict__:
            namespace['halt_node'] = members.get('halt', plain.halt)

    return types.new_class(plain.__name__, (plain,), exec_body=fill)


# Marks of the status log that say several changes at once, and some that say what is so already.

# The places of marks in the tuple of a node. At the number of a status: the node has it now.
CHILDREN_IDLE: Final = 5
"""All children of the node are IDLE now."""

EARLIER_CHILDREN_IDLE: Final = 6
"""The children of the node before its first RUNNING one are IDLE now."""

FIRST_CHILDREN_IDLE: Final = 8
"""To be added to the number of a status: all children of the node are IDLE now, and then it has the status."""

_RUNNING: Final = NodeStatus.RUNNING.value

T = TypeVar('T')


def marks_of(node: TreeNode) -> tuple[int, ...]:
    """Return the marks of a node, in their places; of a leaf only those that say nothing of children."""
    leaf = node.kind in (NodeKind.ACTION, NodeKind.CONDITION)
    first = node.uid << SHIFT
    return tuple(range(first, first + len(NodeStatus) + (0 if leaf else FIRST_CHILDREN_IDLE)))


class CompactLogReader(LogReader[T]):
    """A reader that knows such marks."""

    def __init__(self, nodes: Sequence[TreeNode], make: Callable[[int, int, int], T]) -> None:
        super().__init__(nodes, make)
        self._children = {node.uid: [child.uid for child in node.attached] for node in nodes if node.attached}

    def read(self, marks: Iterable[int]) -> list[T]:
        statuses = self.statuses
        made = self._made
        transitions: list[T] = []
        for mark in marks:
            uid, place = mark >> SHIFT, mark & PLACES
            if place >= CHILDREN_IDLE:
                for child in self._children[uid]:
                    before = statuses[child]
                    if before == _RUNNING and place == EARLIER_CHILDREN_IDLE:
                        break
                    if before:
                        statuses[child] = 0
                        change = child << SHIFT + SHIFT | before
                        transitions.append(made.get(change) or self._transition(child, before, 0))
                place -= FIRST_CHILDREN_IDLE
                if place < 0:
                    continue
            before = statuses[uid]
            if before != place:
                statuses[uid] = place
                change = (uid << SHIFT | place) << SHIFT | before
                transitions.append(made.get(change) or self._transition(uid, before, place))
        return transitions


# Methods of the engine in which what the change of a status costs, when it is logged, is written out in place.
#
# The status of an observed node is a property, whose calls take several times as long as the tick of a simple node. So
# for observed nodes the methods of the engine are compiled anew, from their own source, with these stores written out::
#
#     self.status = SUCCESS             self._stored_status = SUCCESS
#                                       self.context.log.append(self.marks[2])
#
#     self.status = status              if self._stored_status is not status:
#                                           self._stored_status = status
#                                           self.context.log.append(self.marks[status])
#
#     self.child.status = IDLE          self.child._stored_status = IDLE
#     self.status = SUCCESS             self._stored_status = SUCCESS
#                                       self.context.log.append(self.marks[FIRST_CHILDREN_IDLE + 2])
#
#     for child in self.children:       for child in self.children:
#         if child.status is RUNNING:       if child._stored_status is RUNNING:
#             child.halt_node()                 self.context.log.append(self.marks[EARLIER_CHILDREN_IDLE])
#         child.status = IDLE                   child.halt_node()
#                                           child._stored_status = IDLE
#                                       self.context.log.append(self.marks[CHILDREN_IDLE])
#
# ``_stored_status`` is the slot below the property. Every other store goes through the property, as all do in a method
# whose source is not to be had, or is not that of its code any more: this saves time, and changes nothing else.

_PACKAGE: Final = 'flexbt_core.behavior_tree.'

# Those that are new nearly always when they are stored. RUNNING is often stored again, and must not cost then.
_NEW: Final = {status.name: status.value for status in (NodeStatus.IDLE, NodeStatus.SUCCESS, NodeStatus.FAILURE)}


def inlined_methods(node_class: type[Any]) -> dict[str, types.FunctionType]:
    """Return the methods of ``node_class`` that are of the engine and use statuses, compiled anew."""
    methods: dict[str, types.FunctionType] = {}
    for base in reversed(node_class.__mro__):
        for name, member in vars(base).items():
            methods.pop(name, None)
            if isinstance(member, types.FunctionType) and name != '__init__':
                method = _inlined(member)
                if method is not None:
                    methods[name] = method
    return methods


def _inlined(function: types.FunctionType) -> types.FunctionType | None:
    """Return the function compiled anew, when it is of the engine and uses statuses, or calls a function that does."""
    return _inlined_of_engine(function) if (function.__module__ or '').startswith(_PACKAGE) else None


@functools.cache
def _inlined_of_engine(function: types.FunctionType) -> types.FunctionType | None:
    known = function.__code__
    helpers = {
        name: helper
        for name in known.co_names
        if isinstance(value := function.__globals__.get(name), types.FunctionType)
        and 'status' in value.__code__.co_names
        and (helper := _inlined(value)) is not None
    }
    if not helpers and 'status' not in known.co_names:
        return None
    code = _compiled(function.__module__).get(known)
    if code is None:
        return None
    names = {**function.__globals__, **helpers, 'SUCCESS': SUCCESS, 'FAILURE': FAILURE}
    made = types.FunctionType(code, names, function.__name__, function.__defaults__, function.__closure__)
    made.__kwdefaults__ = function.__kwdefaults__
    return made


@functools.cache
def _compiled(module: str) -> dict[types.CodeType, types.CodeType]:
    """Return what becomes of the code of a module. Empty without its source; other keys when that was replaced
    since."""
    loader = sys.modules[module].__loader__
    if not isinstance(loader, InspectLoader):
        return {}
    try:
        source, plain = loader.get_source(module), loader.get_code(module)
    except (ImportError, OSError):
        return {}
    if source is None or plain is None:
        return {}
    made = compile(_Inliner(source).visit(ast.parse(source)), plain.co_filename, 'exec', dont_inherit=True)
    return dict(zip(_inner_code(plain), _inner_code(made), strict=True))


def _inner_code(code: types.CodeType) -> Iterator[types.CodeType]:
    for inner in code.co_consts:
        if isinstance(inner, types.CodeType):
            yield inner
            yield from _inner_code(inner)


_SLOT: Final = '_stored_status'
_JOINED: Final = 'status_after_that_of_child'
_FIRST_PLACES: Final = {'status': 0, _JOINED: FIRST_CHILDREN_IDLE}


class _Inliner(ast.NodeTransformer):
    def __init__(self, source: str) -> None:
        self._lines = source.split('\n')

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        """Most functions use no status: looking for the word is quicker than visiting them."""
        lines = self._lines[node.lineno - 1 : node.end_lineno]
        return self.generic_visit(node) if any('status' in line for line in lines) else node

    def generic_visit(self, node: ast.AST) -> ast.AST:
        for block in (getattr(node, 'body', None), getattr(node, 'orelse', None)):
            if isinstance(block, list):
                _join_stores(block)
        return super().generic_visit(node)

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        self.generic_visit(node)
        if node.attr == 'status' and isinstance(node.ctx, ast.Load):
            node.attr = _SLOT
        return node

    def visit_Assign(self, node: ast.Assign) -> ast.AST | list[ast.stmt]:
        match node.targets:
            case [ast.Attribute(ast.Name() | ast.Attribute(ast.Name()) as owner, name)] if name in _FIRST_PLACES:
                self.generic_visit(node)
                return _statements(node, *_store(ast.unparse(owner), node.value, _FIRST_PLACES[name]))
        return self.generic_visit(node)

    def visit_For(self, node: ast.For) -> ast.AST | list[ast.stmt]:
        match node:
            case ast.For(
                target=ast.Name(child),
                iter=ast.Attribute(ast.Name('self'), 'children'),
                body=[
                    ast.If(
                        body=[ast.Expr(ast.Call(ast.Attribute(ast.Name(halted), 'halt_node')))], orelse=[]
                    ) as halting,
                    ast.Assign([ast.Attribute(ast.Name(reset), 'status') as target], ast.Name('IDLE')),
                ],
                orelse=[],
            ) if child == halted == reset:
                self.generic_visit(halting)
                halting.body[:0] = _statements(halting, _append('self', EARLIER_CHILDREN_IDLE))
                target.attr = _SLOT
                return [node, *_statements(node, _append('self', CHILDREN_IDLE))]
        return self.generic_visit(node)


def _join_stores(block: list[ast.stmt]) -> None:
    """A decorator that sets its child to IDLE, and stores its own status then, logs both at once."""
    for first, second in itertools.pairwise(block):
        match first, second:
            case (
                ast.Assign([ast.Attribute(ast.Attribute(ast.Name('self'), 'child'), 'status') as of_child], idle),
                ast.Assign([ast.Attribute(ast.Name('self'), 'status') as own], ast.Name()),
            ) if ast.unparse(idle) == 'IDLE':
                of_child.attr = _SLOT
                own.attr = _JOINED


def _store(owner: str, value: ast.expr, first: int) -> list[str]:
    """Return the lines that store a status and log it; ``first`` is added to the place of the mark."""
    status = ast.unparse(value)
    if status in _NEW:
        return [f'{owner}.{_SLOT} = {status}', _append(owner, first + _NEW[status])]
    lines = []
    if not isinstance(value, ast.Name):
        lines.append(f'_status = {status}')
        status = '_status'
    # As an index a number is far quicker than a NodeStatus.
    other = f'{first + FAILURE} if {status} is FAILURE else {first} + {status}'
    place = str(RUNNING.value) if status == 'RUNNING' else f'{first + SUCCESS} if {status} is SUCCESS else {other}'
    store, append = f'{owner}.{_SLOT} = {status}', _append(owner, place)
    if first:
        return [store, append]
    return [*lines, f'if {owner}.{_SLOT} is not {status}:', f'    {store}', f'    {append}']


def _append(owner: str, place: int | str) -> str:
    return f'{owner}.context.log.append({owner}.marks[{place}])'


def _statements(node: ast.stmt, *lines: str) -> list[ast.stmt]:
    """These statements, in the place of ``node``."""
    body = ast.parse('\n'.join(lines)).body
    for part in (part for statement in body for part in ast.walk(statement)):
        ast.copy_location(part, node)
    return body

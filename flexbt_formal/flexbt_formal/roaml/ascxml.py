# SPDX-License-Identifier: BSD-3-Clause
"""A reader of ASCXML: SCXML with elements for ROS and for behavior trees.

Reading takes two steps, since the parameters of an event are known only after all its senders have been read:
:meth:`Ascxml.declare` for all files, then :meth:`Ascxml.automata`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from flexbt_core.values.text import did_you_mean

from .automaton import Action, Assign, Automaton, AutomatonState, If, Send, Target, Transition, Write
from .data_types import DataType, DataTypeError, DataTypes
from .dialect import (
    ACTIONS,
    BT_CALLBACKS,
    BT_CHILD_CALLBACKS,
    BT_CHILD_TRIGGERS,
    CALLBACKS,
    FIELD,
    FIRST_NODE,
    INTERFACES,
    PLAIN_ROOTS,
    STATUSES,
    TIMER,
    TRANSITIONS,
    TRIGGERS,
    Events,
    bt_event,
    ros_name,
)
from .expressions import (
    LOTS,
    Call,
    Evaluated,
    Expression,
    ExpressionError,
    Literal,
    Reference,
    compiled,
    constant,
    is_random,
    parse_expression,
)
from .source_text import SourceElement

_NANOSECONDS: Final = 1_000_000_000
_INPUT: Final = ' input'
"""Prefix of the key of a port in a name that no expression can have."""
_RESERVED: Final = ('_event', '_msg', '_req', '_res', '_action', '_goal', '_feedback', '_wrapped_result', '_bt')
_ROOT_CHILDREN: Final = (
    'datamodel',
    'state',
    'ros_time_rate',
    'ros_action_thread',
    'bt_declare_port_in',
    'bt_declare_port_out',
    *INTERFACES,
)


class Timer(NamedTuple):
    """A timer: its period in ns; ``event`` None is the tick of the tree."""

    name: str
    period: int
    event: int | None


class Communication(NamedTuple):
    """The use of a service or an action; ``kind`` is the element that declares it."""

    kind: str
    name: str
    automaton: str
    place: str


@dataclass(frozen=True)
class Instance:
    """A plugin as a node of the tree: its number (from 1), the values of its ports, the numbers of its children."""

    uid: int
    name: str
    ports: Mapping[str, str]
    children: tuple[int, ...] = ()


class _Scope(NamedTuple):
    """Names that an expression can use."""

    variables: Mapping[str, int]
    types: Mapping[str, DataType]
    states: tuple[str, ...]
    event: int | None = None
    roots: Mapping[tuple[str, ...], str] = PLAIN_ROOTS
    thread: int | None = None


class Ascxml:
    """One file, for one automaton; for a plugin, as one node of the tree."""

    def __init__(self, root: SourceElement, types: DataTypes, events: Events, instance: Instance | None = None) -> None:
        """Raise ModelError."""
        if root.tag not in ('ascxml', 'scxml'):
            root.fail('a file of an automaton begins with <ascxml>')
        self._root = root
        self._types = types
        self._events = events
        self._instance = instance
        self.is_random = False
        self._draws = False
        root.only(_ROOT_CHILDREN)
        self.name = root.need('name')
        if instance is not None:
            self.name = f'BT_plugin_{FIRST_NODE - 1 + instance.uid}_{instance.name}'
        self._ports = {one.need('key'): one for one in root.all('bt_declare_port_in', 'bt_declare_port_out')}
        self._interfaces: dict[tuple[str, str], str] = {}
        self.communications: list[Communication] = []
        for one in root.all(*INTERFACES):
            self._declare_interface(one)
        self.timers = [
            Timer(name, period_of(one.number('rate_hz')), events.number(f'{TIMER}{self.name}.{name}'))
            for one in root.all('ros_time_rate')
            if (name := one.need('name'))
        ]

    def _declare_interface(self, node: SourceElement) -> None:
        attribute = INTERFACES[node.tag]
        value = node.get(attribute)
        child = node.find(attribute)
        if value is None and child is not None:
            value = self._constant_text(child)
        if value is None or not ros_name(value) or ' ' in value.strip():
            node.fail(f'the name of the interface is missing, or no name; write {attribute}="/..."', attribute)
        name = node.get('name') or value
        if (node.tag, name) in self._interfaces:
            node.fail(f'{name!r} is declared twice', 'name')
        self._interfaces[node.tag, name] = ros_name(value)
        self.communications.append(Communication(node.tag, ros_name(value), self.name, node.place))

    def _constant_text(self, node: SourceElement) -> str:
        """Return the text of a child of a declaration; the child may refer to a constant port."""
        port = node.find('bt_get_input')
        if port is None:
            return node.text
        value = self._port(port)
        if not isinstance(value, Literal):
            port.fail('the port points to the blackboard; the name of an interface has to be the same always')
        return str(value.value)

    def _port(self, node: SourceElement) -> Expression:
        """Return the expression for <bt_get_input>: a literal, or an input that is read on use."""
        key = node.need('key')
        declared = self._ports.get(key)
        if self._instance is None or declared is None:
            node.fail(
                f'there is no port {key!r}; declare it by <bt_declare_port_in>{did_you_mean(key, self._ports)}', 'key'
            )
        if key == 'CHILDREN_COUNT':
            return Literal(len(self._instance.children))
        text = self._instance.ports.get(key)
        if text is None:
            node.fail(f'the tree gives no value for the port {key!r} of {self.name}; add {key}="..." there', 'key')
        if is_pointer(text):
            return Reference((_INPUT, key))
        try:
            return Literal(_type_of(declared, self._types).from_text(text))
        except DataTypeError as error:
            node.fail(f'the port {key!r} of {self.name}: {error}', 'key')

    # -- first step --------------------------------------------------------------------------------------------------

    def declare(self) -> None:
        """Declare the events that the file sends, with their parameters. Raises ModelError."""

        def walk(node: SourceElement) -> None:
            for child in node.children:
                for event, values in self._sent(child, None):
                    self._events.send(event, (name for name, _ in values))
                if child.tag not in INTERFACES:
                    walk(child)

        walk(self._root)

    def _sent(self, node: SourceElement, thread: int | None) -> Iterator[tuple[str, list[tuple[str, Expression]]]]:
        """Yield the events that an element may send, with their parameters; nothing if the element sends none."""
        trigger = TRIGGERS.get(node.tag)
        if node.tag == 'send':
            node.only(('param',))
            if node.get('delay') is not None:
                node.fail('a sending with a delay is not supported; use <ros_time_rate>', 'delay')
            yield node.need('event'), [(one.need('name'), self._expression(one)) for one in node.all('param')]
        elif trigger is not None:
            node.only(('field',))
            event = self._interface_event(node, trigger.interface, trigger.event)
            values = [(name, self._expression(node, name)) for name in trigger.extra]
            values += [
                (FIELD + one.need('name').replace('.', '__'), self._expression(one)) for one in node.all('field')
            ]
            if trigger.code is not None:
                values.append(('code', Literal(trigger.code)))
            if node.tag == 'ros_action_thread_free':
                values.append(('thread_id', Literal(thread or 0)))
            yield event, values
        elif node.tag in ('bt_return_status', 'bt_return_halted', *BT_CHILD_TRIGGERS):
            instance = self._need_instance(node)
            if node.tag == 'bt_return_status':
                status = node.need('status')
                expression = Literal(STATUSES[status]) if status in STATUSES else self._parsed(status, node, 'status')
                yield bt_event(instance.uid, 'response'), [('status', expression)]
            elif node.tag == 'bt_return_halted':
                yield bt_event(instance.uid, 'halt_response'), []
            else:
                for child in self._children(node):
                    yield bt_event(child, BT_CHILD_TRIGGERS[node.tag]), []

    def _need_instance(self, node: SourceElement) -> Instance:
        if self._instance is None:
            node.fail('this element is for plugins of a tree; this file is a node: list it below <behavior_tree>')
        return self._instance

    def _children(self, node: SourceElement) -> Sequence[int]:
        """Return the numbers of the nodes that ``id`` may refer to: one for a number, all children for a variable."""
        children = self._need_instance(node).children
        text = node.need('id').strip()
        if not text.isdigit():
            return children
        if int(text[:9]) >= len(children):
            node.fail(f'there is no child {text}: {self.name} has {len(children)} in the tree', 'id')
        return (children[int(text)],)

    def _interface_event(self, node: SourceElement, kind: str, event: str) -> str:
        name = node.need('name')
        found = self._interfaces.get((kind, name))
        if found is None:
            known = [known for other, known in self._interfaces if other == kind]
            node.fail(f'there is no <{kind} name="{name}">; declare it{did_you_mean(name, known)}', 'name')
        return event.format(found, self.name)

    # -- expressions -------------------------------------------------------------------------------------------------

    def _expression(self, node: SourceElement, attribute: str = 'expr') -> Expression:
        """Return the expression in an attribute, or in a child of that name. Raises ModelError."""
        text = node.get(attribute)
        if text is not None:
            return self._parsed(text, node, attribute)
        child = node.find(attribute)
        if child is None:
            node.fail(f'the attribute [{attribute}] is missing; write {attribute}="..."')
        port = child.find('bt_get_input')
        return self._port(port) if port is not None else self._parsed(child.text, child, '')

    def _parsed(self, text: str, node: SourceElement, attribute: str) -> Expression:
        try:
            found = parse_expression(text)
        except ExpressionError as error:
            node.fail(str(error), attribute)
        self.is_random = self.is_random or is_random(found)
        self._draws = self._draws or is_random(found, LOTS)
        return found

    def _compiled(self, expression: Expression, node: SourceElement, scope: _Scope, attribute: str = '') -> Evaluated:
        def resolve(parts: tuple[str, ...]) -> str:
            return self._resolved(parts, scope)

        try:
            return compiled(expression, resolve)
        except ExpressionError as error:
            node.fail(str(error), attribute)

    def _resolved(self, parts: tuple[str, ...], scope: _Scope) -> str:
        first = parts[0]
        if first == _INPUT:
            return f'b[0][{parts[1]!r}]'
        number = scope.variables.get(first)
        if number is not None:
            return _members(f'd[{number}]', parts[1:])
        if len(parts) == 1 and first in STATUSES:
            return repr(STATUSES[first])
        for root, prefix in (*scope.roots.items(), *PLAIN_ROOTS.items()):
            if parts[: len(root)] == root and scope.event is not None:
                return self._parameter(scope.event, prefix, parts[len(root) :], '.'.join(parts))
        known = [*scope.variables, *('.'.join(root) for root in scope.roots if scope.event is not None)]
        raise ExpressionError(f'{".".join(parts)} is not known here{did_you_mean(first, known)}')

    def _parameter(self, event: int, prefix: str, path: tuple[str, ...], written: str) -> str:
        """Return the code for a parameter of an event, a member of it, or the record of all parameters below a name."""
        names = self._events.parameters[event]
        if event not in self._events.sent:
            return '0'  # without a sender, the event never arrives
        whole = prefix + '__'.join(path) if path else prefix
        for taken in range(len(path), -1, -1):
            name = prefix + '__'.join(path[:taken]) if prefix != whole or taken else prefix
            if name in names:
                return _members(f'e[{names.index(name)}]', path[taken:])
        inner = [name for name in names if path and name.startswith(f'{whole}__')]
        if inner:
            members = ''.join(f'({name[len(whole) + 2 :]!r}, e[{names.index(name)}]), ' for name in inner)
            return f'Record(({members}))'
        carried = ', '.join(name.removeprefix(FIELD) for name in names) or 'nothing'
        raise ExpressionError(f'{written} is not there: {self._events.names[event]} carries {carried}')

    # -- second step -------------------------------------------------------------------------------------------------

    def automata(self) -> list[Automaton]:
        """Return the automaton of the file, and the automata of its action threads. Raises ModelError."""
        found = [self._automaton(self._root, self.name, None)]
        for node in self._root.all('ros_action_thread'):
            node.only(('datamodel', 'state'))
            action = self._interface_event(node, 'ros_action_server', '{0}')
            for thread in range(int(node.number('n_threads', most=100))):
                found.append(self._automaton(node, f'{action}_thread_{thread}', thread))
        return found

    def _automaton(self, root: SourceElement, name: str, thread: int | None) -> Automaton:
        data: list[tuple[str, Any]] = []
        types: dict[str, DataType] = {}
        for model in root.all('datamodel'):
            model.only(('data',))
            for one in model.children:
                key = one.need('id')
                if key in types or key in STATUSES or key in _RESERVED or not key.isidentifier():
                    one.fail(f'{key!r} is declared twice, or cannot be a name of data', 'id')
                types[key] = _type_of(one, self._types)
                data.append((key, self._initial(one, types[key])))
        variables = {key: number for number, (key, _) in enumerate(data)}
        names = tuple(one.need('id') for one in root.all('state'))
        for one in root.all('state'):
            if names.count(one.need('id')) > 1:
                one.fail('a state of this name is declared twice', 'id')
        scope = _Scope(variables, types, names, thread=thread)
        states = [self._state(one, scope) for one in root.all('state')]
        initial = _state_name(root, 'initial', scope)
        uid = self._instance.uid if self._instance is not None else 0
        return Automaton(name, data, states, initial, uid, draws=self._draws)

    def _initial(self, node: SourceElement, kind: DataType) -> Any:
        expression = self._expression(node)
        if isinstance(expression, Reference) and expression.parts[0] == _INPUT:
            node.fail('the port points to the blackboard: read it in a transition, when it is there')
        try:
            return kind.checked(constant(expression))
        except (DataTypeError, ExpressionError) as error:
            node.fail(f'{node.need("id")}: {error}', 'expr')

    def _state(self, node: SourceElement, scope: _Scope) -> AutomatonState:
        node.only(('onentry', 'onexit', *TRANSITIONS))
        state = AutomatonState(node.need('id'))
        for tag, body in (('onentry', state.entry), ('onexit', state.exit)):
            inner = node.find(tag)
            if inner is not None:
                body += self._body(inner.children, scope)
        for child in node.all(*TRANSITIONS):
            state.transitions += self._transitions(child, scope)
        free = [one for one in state.transitions if one.event is None and one.condition is None]
        if free and any(one.event is not None for one in state.transitions):
            node.fail(
                f'the state {state.name!r} has a transition without event and condition, so others are never taken; '
                'give it a condition'
            )
        return state

    def _transitions(self, node: SourceElement, scope: _Scope) -> Iterator[Transition]:
        if node.tag == 'ros_action_handle_goal_response':
            for what in ('accept', 'reject'):
                name = f'action_{{0}}_goal_{what}_client_{{1}}'
                answer = self._events.number(self._interface_event(node, 'ros_action_client', name))
                yield Transition(answer, None, [Target(1.0, _state_name(node, what, scope), [])], node.place)
            return
        for event, roots, condition in self._triggers(node, scope):
            number = None if event is None else self._events.number(event)
            inner = scope._replace(event=number, roots=roots)
            text = node.get('cond')
            if text is not None:
                own = self._parsed(text, node, 'cond')
                condition = own if condition is None else Call('&&', (condition, own))
            function = None if condition is None else self._compiled(condition, node, inner, 'cond')
            yield Transition(number, function, self._targets(node, inner), node.place)

    def _triggers(
        self, node: SourceElement, scope: _Scope
    ) -> Iterator[tuple[str | None, Mapping[tuple[str, ...], str], Expression | None]]:
        """Yield the events of a transition, the names of their parameters in its body, and an additional condition."""
        callback = CALLBACKS.get(node.tag)
        if callback is not None:
            condition: Expression | None = None
            if callback.code is not None:
                condition = Call('==', (Reference(('_event', 'data', 'code')), Literal(callback.code)))
            if node.tag == 'ros_action_handle_thread_start':
                condition = Call('==', (Reference(('_event', 'data', 'thread_id')), Literal(scope.thread or 0)))
            yield self._interface_event(node, callback.interface, callback.event), callback.roots, condition
        elif node.tag == 'ros_rate_callback':
            name = node.need('name')
            if all(name != timer.name for timer in self.timers):
                node.fail(f'there is no <ros_time_rate name="{name}">; declare it', 'name')
            yield f'{TIMER}{self.name}.{name}', {}, None
        elif node.tag in BT_CALLBACKS:
            yield bt_event(self._need_instance(node).uid, BT_CALLBACKS[node.tag]), {}, None
        elif node.tag in BT_CHILD_CALLBACKS:
            text = node.need('id').strip()
            children = self._need_instance(node).children
            for child in self._children(node):
                event = bt_event(child, BT_CHILD_CALLBACKS[node.tag])
                condition = None
                if not text.isdigit():
                    condition = Call('==', (self._parsed(text, node, 'id'), Literal(children.index(child))))
                yield event, {('_bt', 'status'): 'status'}, condition
        else:
            events = (node.get('event') or '').split()
            for event in events or [None]:  # type: ignore[list-item]
                yield event, PLAIN_ROOTS, None

    def _targets(self, node: SourceElement, scope: _Scope) -> list[Target]:
        targets = list(node.all('target'))
        if not targets:
            return [Target(1.0, _state_name(node, 'target', scope), self._body(node.children, scope))]
        node.only(('target',))
        if node.get('target') is not None:
            node.fail('a transition has one target as an attribute, or several as children, not both', 'target')
        found: list[Target] = []
        for one in targets:
            left = 1.0 - sum(target.probability for target in found)
            text = one.get('prob')
            if text is None and one is not targets[-1]:
                one.fail('the probability is missing; only that of the last target may be')
            try:
                probability = left if text is None else float(text)
            except ValueError:
                one.fail(f'{text!r} is not a probability', 'prob')
            if not 0.0 < probability <= left + 1e-9:
                one.fail(f'the probability {probability:.6g} is not above 0, or more than the {left:.6g} left', 'prob')
            found.append(Target(probability, _state_name(one, 'id', scope), self._body(one.children, scope)))
        whole = sum(target.probability for target in found)
        if abs(whole - 1.0) > 1e-9:
            node.fail(f'the probabilities of the targets are {whole:.6g} together, not 1')
        return found

    def _body(self, nodes: Sequence[SourceElement], scope: _Scope) -> list[Action]:
        return [action for node in nodes for action in self._actions(node, scope)]

    def _actions(self, node: SourceElement, scope: _Scope) -> Iterator[Action]:
        if node.tag not in ACTIONS:
            node.fail(f'this element is not an action{did_you_mean(node.tag, ACTIONS)}')
        if node.tag == 'assign':
            yield self._assign(node, scope)
        elif node.tag == 'if':
            yield self._if(node, scope)
        elif node.tag == 'bt_set_output':
            yield self._write(node, scope)
        elif node.tag in BT_CHILD_TRIGGERS and not node.need('id').strip().isdigit():
            # A variable selects the child.
            chosen = self._parsed(node.need('id'), node, 'id')
            branches: list[tuple[Evaluated, list[Action]]] = []
            for place, (event, values) in enumerate(self._sent(node, scope.thread)):
                condition = self._compiled(Call('==', (chosen, Literal(place))), node, scope, 'id')
                branches.append((condition, [self._send(node, event, values, scope)]))
            yield If(branches, [], node.place)
        else:
            for event, values in self._sent(node, scope.thread):
                yield self._send(node, event, values, scope)

    def _send(self, node: SourceElement, event: str, values: Sequence[tuple[str, Expression]], scope: _Scope) -> Send:
        number = self._events.number(event)
        given = {name: self._compiled(expression, node, scope) for name, expression in values}
        return Send(number, tuple(given.get(name) for name in self._events.parameters[number]), node.place)

    def _assign(self, node: SourceElement, scope: _Scope) -> Assign:
        location = self._parsed(node.need('location'), node, 'location')
        path: list[str | Evaluated] = []
        while isinstance(location, Call) and location.name in ('index', 'member'):
            inner, step = location.operands
            if location.name == 'member':
                path.append(step.value)
            else:
                path.append(self._compiled(step, node, scope, 'location'))
            location = inner
        if not isinstance(location, Reference) or location.parts[0] not in scope.variables:
            known = tuple(scope.variables)
            node.fail(
                f'the location is not data of {self.name}{did_you_mean(node.need("location"), known)}', 'location'
            )
        name, *members = location.parts
        steps = (*members, *reversed(path))
        value = self._compiled(self._expression(node), node, scope, 'expr')
        return Assign(scope.variables[name], scope.types[name], steps, value, node.place)

    def _if(self, node: SourceElement, scope: _Scope) -> If:
        """Return the branches: empty <elseif> and <else> elements separate the actions."""
        otherwise: list[Action] | None = None
        body: list[Action] = []
        branches = [(self._condition(node, scope), body)]
        for child in node.children:
            if child.tag in ('elseif', 'else'):
                if otherwise is not None:
                    child.fail('nothing but actions can follow <else>')
                body = self._body(child.children, scope)
                if child.tag == 'elseif':
                    branches.append((self._condition(child, scope), body))
                else:
                    otherwise = body
            else:
                body += self._actions(child, scope)
        return If(branches, otherwise or [], node.place)

    def _condition(self, node: SourceElement, scope: _Scope) -> Evaluated:
        return self._compiled(self._parsed(node.need('cond'), node, 'cond'), node, scope, 'cond')

    def _write(self, node: SourceElement, scope: _Scope) -> Write:
        instance = self._need_instance(node)
        key = node.need('key')
        declared = self._ports.get(key)
        if declared is None or declared.tag != 'bt_declare_port_out':
            known = [name for name, one in self._ports.items() if one.tag == 'bt_declare_port_out']
            node.fail(
                f'there is no output port {key!r}; declare it by <bt_declare_port_out>{did_you_mean(key, known)}', 'key'
            )
        if not is_pointer(instance.ports.get(key, '')):
            node.fail(
                f'the tree gives the output port {key!r} of {self.name} no entry; write {key}="{{key}}" there', 'key'
            )
        return Write(instance.uid, key, self._compiled(self._expression(node), node, scope, 'expr'), node.place)


def period_of(rate: float) -> int:
    """Return the period of a rate (Hz) in ns, rounded down as AS2FM does: to a whole number of the largest unit that is
    exact, or fits more than 100 times."""
    for unit in (1.0, 1e-3, 1e-6, 1e-9):
        count = 1.0 / rate / unit
        if count == int(count) or count > 101:
            return int(count) * round(unit * _NANOSECONDS)
    return max(round(_NANOSECONDS / rate), 1)


def ports_of(root: SourceElement, types: DataTypes) -> Mapping[str, tuple[bool, DataType]]:
    """Return the ports of a plugin by name: whether each is an output, and its type. Raises ModelError."""
    return {
        one.need('key'): (one.tag == 'bt_declare_port_out', _type_of(one, types))
        for one in root.all('bt_declare_port_in', 'bt_declare_port_out')
        if one.need('key') != 'CHILDREN_COUNT'
    }


def _type_of(node: SourceElement, types: DataTypes) -> DataType:
    text = node.get('type')
    if text is None and node.tag == 'data':
        # Plain SCXML has no types; AS2FM writes them into a comment.
        match = re.search(rf'TYPE\s+{re.escape(node.need("id"))}:(\S+)', node.source.text)
        text = match and match.group(1)
    try:
        return types.find(text if text is not None else node.need('type'))
    except DataTypeError as error:
        node.fail(str(error), 'type')


def is_pointer(text: str) -> bool:
    """Return whether the value of a port is a blackboard pointer."""
    stripped = text.strip()
    return len(stripped) > 2 and stripped[0] == '{' and stripped[-1] == '}'


def _state_name(node: SourceElement, attribute: str, scope: _Scope) -> str:
    name = node.need(attribute)
    if name not in scope.states:
        node.fail(f'there is no state {name!r}{did_you_mean(name, scope.states)}', attribute)
    return name


def _members(value: str, names: Sequence[str]) -> str:
    for name in names:
        value = f'member({value}, {name!r})'
    return value

# SPDX-License-Identifier: BSD-3-Clause
"""The automata between clients and servers of services and actions: they pass on one request at a time, and return the
answer to the client that sent it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from flexbt_core.behavior_tree.model.errors import LoadError

from .ascxml import Communication
from .automaton import Action, Automaton, AutomatonState, Send, Target, Transition
from .dialect import Events
from .expressions import Call, Evaluated, Expression, Literal, Reference, compiled
from .source_text import ModelError


class Handler:
    """The handler of one service or action."""

    def __init__(self, kind: str, name: str, uses: Sequence[Communication], events: Events) -> None:
        """``kind`` is service or action. Raises ModelError unless exactly one server exists."""
        self._kind = kind
        self._name = name
        self._events = events
        servers = [one for one in uses if one.kind.endswith('server')]
        self._clients = list(dict.fromkeys(one.automaton for one in uses if one.kind.endswith('client')))
        if len(servers) != 1:
            at = (servers or list(uses))[-1]
            file, _, line = at.place.rpartition(':')
            what = 'has several servers; only one can answer' if servers else 'has clients, but no server answers'
            raise ModelError([LoadError(file, int(line), 1, f'<{at.kind}>', f'the {kind} {name!r} {what}')])

    def declare(self) -> None:
        """Declare the events that the handler sends: they have the parameters of the events that it relays."""
        if self._kind == 'service':
            for client in self._clients:
                self._pass(f'srv_{self._name}_req_client_{client}', f'srv_{self._name}_request')
                self._pass(f'srv_{self._name}_response', f'srv_{self._name}_response_client_{client}')
            return
        for client in self._clients:
            self._pass(
                f'action_{self._name}_goal_req_client_{client}', f'action_{self._name}_goal_handle', ('goal_id',)
            )
            for what, to in _BACK:
                self._pass(f'action_{self._name}_{what}', f'action_{self._name}_{to}_client_{client}')

    def _pass(self, first: str, then: str, more: Iterable[str] = ()) -> None:
        number = self._events.find(first)
        if number is not None and number in self._events.sent:
            self._events.send(then, [*more, *self._events.parameters[number]])

    def automaton(self) -> Automaton:
        name = self._name
        waiting = AutomatonState('waiting')
        states = [waiting]
        if self._kind == 'service':
            for client in self._clients:
                busy = AutomatonState(f'processing_client_{client}')
                states.append(busy)
                request, response = f'srv_{name}_req_client_{client}', f'srv_{name}_response'
                waiting.transitions.append(self._on(request, f'srv_{name}_request', busy.name))
                busy.transitions.append(self._on(response, f'srv_{name}_response_client_{client}', 'waiting'))
            return Automaton(f'srv_handler_{name}', (), states, 'waiting')
        requested = AutomatonState('goal_requested')
        states.append(requested)
        for goal, client in enumerate(self._clients):
            ask = f'action_{name}_goal_req_client_{client}'
            waiting.transitions.append(self._on(ask, f'action_{name}_goal_handle', requested.name, goal))
            for what, to in _BACK:
                event = f'action_{name}_{what}'
                state = requested if what.startswith('goal') else waiting
                back = self._on(event, f'action_{name}_{to}_client_{client}', 'waiting')
                back.condition = self._is_goal(event, goal)
                state.transitions.append(back)
        return Automaton(f'action_handler_{name}', (), states, 'waiting')

    def _on(self, event: str, then: str, state: str, goal: int | None = None) -> Transition:
        """Return a transition that sends the parameters of one event as another event."""
        number, after = self._events.number(event), self._events.number(then)
        known = self._events.parameters[number]
        values: list[Evaluated | None] = []
        for name in self._events.parameters[after]:
            given: Expression | None = None
            if name == 'goal_id' and goal is not None:
                given = Literal(goal)
            elif name in known:
                given = Reference((name,))
            values.append(None if given is None else compiled(given, lambda parts: f'e[{known.index(parts[0])}]'))
        body: list[Action] = [Send(after, tuple(values), self._name)]
        return Transition(number, None, [Target(1.0, state, body)], self._name)

    def _is_goal(self, event: str, goal: int) -> Evaluated:
        known = self._events.parameters[self._events.number(event)]
        if 'goal_id' not in known:
            return compiled(Literal(False), lambda parts: '')
        return compiled(
            Call('==', (Reference(('goal_id',)), Literal(goal))), lambda parts: f'e[{known.index(parts[0])}]'
        )


_BACK = (
    ('goal_accepted', 'goal_accept'),
    ('goal_rejected', 'goal_reject'),
    ('feedback', 'feedback_handle'),
    ('result', 'result_handle'),
)
"""Events of a server, with the event that the client receives for each."""


def handlers(communications: Sequence[Communication], events: Events) -> list[Handler]:
    """Return the handlers of all services and actions. Raises ModelError."""
    found = []
    for kind in ('service', 'action'):
        of_kind = [one for one in communications if f'_{kind}_' in one.kind]
        for name in dict.fromkeys(one.name for one in of_kind):
            uses = [one for one in of_kind if one.name == name]
            if any(one.kind.endswith('client') for one in uses):
                found.append(Handler(kind, name, uses, events))
    return found

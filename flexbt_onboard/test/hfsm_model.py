# SPDX-License-Identifier: BSD-3-Clause
"""A small model of a run, written from the rules and not from the engine: what has to come of each operation.

It knows one active path and what its innermost node wants. The engine has an object for each machine instead, knows
nothing of the whole, and steps; so they do not make the same mistakes.
"""

from __future__ import annotations

from typing import Final

from hfsm_random import Node, Visit

LIVELOCK: Final = 60
REST_TIME: Final = 3.0

Wish = tuple[str, str, str]
"""Kind, path and outcome of what waits for the operator."""


class Model:
    """Each operation gives whether it is accepted, and leaves the model in its next stable state."""

    def __init__(self, root: Node, level: int) -> None:
        self.events: list[str] = []
        self.transitions: list[tuple[str, str, str]] = []
        self.outcome: str | None = None
        self.decision: Wish | None = None
        self.decisions = 0
        self._root = root
        self._levels = {node.path: level for node in root.all()}
        self._visits = dict.fromkeys((node.path for node in root.all()), 0)
        self._now = 0.0
        self._path: list[Node] = []  # what is active, outermost first, without the root
        self._wish: str | None = None  # of the innermost
        self._asks = False
        self._why = 'OUTCOME'
        self._approved = False
        self._is_left = False  # the innermost is a state, and its on_exit was called
        self._is_at_rest = True
        self._leaving: Node | None = None  # what was left and is waited for
        self._until = 0.0
        self._end: str | None = None
        self._enter(root.children[0])
        self._go_on()

    @property
    def active(self) -> Node | None:
        """The active state."""
        return self._path[-1] if self._path and not self._path[-1].children else None

    # -- operations --------------------------------------------------------------------------------------------------

    def news(self, node: Node, outcome: str) -> None:
        """A state gets news by which it wants to be left."""
        if node is self.active and self._visit.kind in ('wait', 'go') and self._wish is None and not self._stands:
            self._wish = outcome
        self._go_on()

    def rest(self, node: Node) -> None:
        """A state comes to rest."""
        if node is self.active:
            self._is_at_rest = True
        self._go_on()

    def pass_time(self, seconds: float) -> None:
        end = self._now + seconds
        while self.outcome is None and self._leaving is not None and self._until <= end:
            self._now = self._until
            self._go_on()
        self._now = end

    def set_autonomy(self, level: int, path: str) -> bool:
        if self._stands:
            return False
        for other in self._levels:
            if path == '/' or other == path or other.startswith(path + '/'):
                self._levels[other] = level
        self._go_on()
        return True

    def confirm(self, number: int) -> bool:
        if self._stands or self.decision is None or number != self.decisions or not self.decision[2]:
            return False
        self._wish, self._approved = self.decision[2], True
        self._go_on()
        return True

    def force(self, path: str, outcome: str, number: int | None) -> bool:
        node = next((node for node in self._path if node.path == path), None)
        if self._stands or node is None or outcome not in node.outcomes:
            return False
        if self._leaving is not None and f'{path}/'.startswith(f'{self._leaving.path}/'):
            return False
        if number is not None and (self.decision is None or number != self.decisions or self.decision[1] != path):
            return False
        if node is not self._path[-1]:
            self._leave_state('PARENT_LEFT')
            self._leave(node, 'FORCED', outcome)
            self._go_on(1)
        else:
            self._why, self._wish, self._approved = 'FORCED', outcome, True
            self._go_on()
        return True

    def stop(self) -> None:
        if not self._stands:
            self._finish('preempted', 'PREEMPTED')
            self._go_on()

    # -- what follows ------------------------------------------------------------------------------------------------

    @property
    def _stands(self) -> bool:
        """Whether the run ends or has ended, so that nothing is accepted any more."""
        return self.outcome is not None or self._end is not None

    @property
    def _visit(self) -> Visit:
        node = self._path[-1]
        return node.visits[(self._visits[node.path] - 1) % len(node.visits)]

    def _go_on(self, count: int = 0) -> None:
        """All that follows at once, after ``count`` transitions already."""
        while self.outcome is None:
            waits = self._leaving is not None and not self._is_at_rest and self._now < self._until
            if waits:
                return
            if self._end is not None:
                self.outcome, self.decision = self._end, None
            elif self._leaving is not None:
                self._pass_on(self._leaving)
            elif self._wish is not None and self._may(self._wish):
                count += 1
                self._take(count)
            elif self._wish is None and not self._asks:
                return
            else:
                kind = 'choice' if self._asks and self._wish is None else 'transition'
                suggestion = self._wish or self._visit.outcome
                if suggestion is not None and self._may(suggestion):
                    self._wish = suggestion
                    continue
                decision = (kind, self._path[-1].path, suggestion or '')
                if self.decision is None:
                    self.decisions += 1
                self.decision = decision
                return

    def _may(self, outcome: str) -> bool:
        node = self._path[-1]
        return self._approved or node.required[outcome] < self._levels[node.path]

    def _take(self, count: int) -> None:
        """The innermost is left by what it wants."""
        node, wish = self._path[-1], self._wish
        assert wish is not None
        self.decision, self._approved, self._asks = None, False, False
        if not node.children and not self._is_left and self._leave_state(self._why) and self._why == 'OUTCOME':
            self._fail()
        if count > LIVELOCK:
            self._finish('error', 'FAULT')
        elif self._wish == wish:
            self._leave(node, self._why, wish)

    def _leave(self, node: Node, why: str, outcome: str) -> None:
        self._leaving, self._why, self._wish = node, why, outcome
        self._until = self._now + REST_TIME
        self.decision = None

    def _pass_on(self, node: Node) -> None:
        assert self._wish is not None
        self.transitions.append((node.path, self._wish, self._why))
        way = node.ways[self._wish]
        while self._path.pop() is not node:
            pass
        self._leaving, self._is_at_rest = None, True
        if isinstance(way, Node):
            self._enter(way)
        elif self._path:
            self._wish, self._why, self._approved, self._is_left = way, 'OUTCOME', False, False
        else:
            self._end = way

    def _enter(self, node: Node) -> None:
        self._path.append(node)
        while node.children:
            node = node.children[0]
            self._path.append(node)
        self._visits[node.path] += 1
        self._wish, self._why, self._asks, self._approved, self._is_left = None, 'OUTCOME', False, False, False
        visit = self._visit
        self._is_at_rest = visit.leaving != 'slow'
        self.events.append(f'on_enter {node.path}')
        if visit.kind in ('on_enter', 'execute'):
            self._fail()
        elif visit.kind == 'go':
            self._wish = visit.outcome
        else:
            self._asks = visit.kind == 'ask'

    def _fail(self) -> None:
        self._wish, self._why = ('failed' if 'failed' in self._path[-1].outcomes else None), 'FAULT'
        if self._wish is None:
            self._finish('error', 'FAULT')

    def _leave_state(self, why: str) -> bool:
        """Call on_exit of the active state unless that was done; whether it raised."""
        if self.active is None or self._is_left:
            return False
        self._is_left = True
        self.events.append(f'on_exit {self.active.path} {why}')
        return self._visit.leaving == 'raise'

    def _finish(self, outcome: str, why: str) -> None:
        self._end = outcome
        self._leave_state(why)
        if self._path:
            self._leaving = self._path[0]
        self._until = self._now + REST_TIME
        self.decision = None

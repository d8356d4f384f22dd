# SPDX-License-Identifier: BSD-3-Clause
"""A machine in a run: which of its states is active, and the transitions between them.

A transition has three steps: the outcome is wanted (and perhaps waits for the operator), the state is left (and perhaps
has to come to rest), the next one is entered. A machine that ends wants an outcome of its own, and its parent takes the
same three steps with it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from .autonomy import is_autonomous
from .decision import Decision, DecisionKind
from .definition import MachineDefinition, Transition
from .event_state import ExitReason
from .leaf import LeafRun
from .userdata import Scope

if TYPE_CHECKING:
    from .run import MachineRun


class ContainerRun:
    """One machine for the length of a run."""

    def __init__(self, engine: MachineRun, definition: MachineDefinition) -> None:
        self._engine = engine
        self.definition = definition
        self.path = definition.path
        self.outcome: str | None = None
        self.exit_reason = ExitReason.OUTCOME
        self.question: tuple[str, str | None] | None = None  # a machine asks nothing
        self.scope = Scope({})
        self.child: LeafRun | ContainerRun | None = None
        self.decision: Decision | None = None
        self._children = {
            label: LeafRun(engine, child) if not isinstance(child, MachineDefinition) else ContainerRun(engine, child)
            for label, child in definition.children.items()
        }
        self._approved = False
        self._leaving_until: float | None = None

    def leaves(self) -> Iterator[LeafRun]:
        """All states, depth first."""
        for child in self._children.values():
            if isinstance(child, LeafRun):
                yield child
            else:
                yield from child.leaves()

    def active(self) -> Iterator[LeafRun | ContainerRun]:
        """What is active here, outermost first, this machine not included."""
        if self.child is not None:
            yield self.child
            if isinstance(self.child, ContainerRun):
                yield from self.child.active()

    # -- entering and leaving ----------------------------------------------------------------------------------------

    def enter(self, parent: Scope) -> None:
        """The machine becomes active, with its initial state."""
        definition = self.definition
        remap = definition.remap
        self.scope = Scope(
            definition.defaults,
            parent,
            {key: remap.get(key, key) for key in definition.input_keys},
            {key: remap.get(key, key) for key in definition.output_keys},
        )
        self.begin()

    def begin(self) -> None:
        """Enter the initial state."""
        self.outcome = None
        self.decision = None
        self._leaving_until = None
        self.exit_reason = ExitReason.OUTCOME
        self._enter_child(self._children[self.definition.initial])

    def leave(self, reason: ExitReason) -> None:
        """Leave everything that is active in here."""
        self._withdraw_decision()
        if self.child is not None:
            inner = reason if reason in (ExitReason.PREEMPTED, ExitReason.FAULT) else ExitReason.PARENT_LEFT
            self.child.leave(inner)

    def unsettled(self) -> str | None:
        """What is not at rest yet in here."""
        return self.child.unsettled() if self.child is not None else None

    def next_wake(self) -> float | None:
        """When something in here is due next."""
        if self._leaving_until is not None:  # a deadline of wall time; the run is rung for it
            return None
        return self.child.next_wake() if self.child is not None and self.outcome is None else None

    # -- transitions -------------------------------------------------------------------------------------------------

    def advance(self) -> bool:
        """Take one step if there is one to take; whether there was."""
        child = self.child
        if child is None or self.outcome is not None:
            return False
        if self._leaving_until is not None:
            return self._finish_leaving(child)
        if child.outcome is None and child.advance():
            return True
        if child.question is not None and child.outcome is None:
            return self._consider_question(child)
        if child.outcome is None:
            return False
        if not self._may_pass(child):
            return False
        self._begin_leaving(child)
        return True

    def approve(self) -> None:
        """The operator has confirmed what the child wants."""
        child = self.child
        assert child is not None  # there was a decision about it
        if child.outcome is None and child.question is not None:
            child.outcome = child.question[1]
        self._approved = True
        self._withdraw_decision()

    def force(self, outcome: str) -> None:
        """The operator wants the child to be left by ``outcome``, whatever it is doing."""
        child = self.child
        assert child is not None  # checked by the caller
        child.outcome = outcome
        child.exit_reason = ExitReason.FORCED
        self._approved = True
        self._withdraw_decision()

    @property
    def is_leaving(self) -> bool:
        """Whether the child is being left already."""
        return self._leaving_until is not None

    def _transition(self, child: LeafRun | ContainerRun) -> Transition:
        assert child.outcome is not None  # the caller has looked
        return child.definition.transitions[child.outcome]

    def _may_pass(self, child: LeafRun | ContainerRun) -> bool:
        if self._approved:
            return True
        required = self._transition(child).autonomy
        if is_autonomous(required, self._engine.autonomy_of(child.path)):
            self._withdraw_decision()
            return True
        self._decide(DecisionKind.TRANSITION, child, child.outcome or '', required, '')
        return False

    def _consider_question(self, child: LeafRun | ContainerRun) -> bool:
        assert child.question is not None  # the caller has looked
        prompt, suggestion = child.question
        required = -1
        if suggestion is not None:
            required = child.definition.transitions[suggestion].autonomy
            if is_autonomous(required, self._engine.autonomy_of(child.path)):
                child.outcome = suggestion
                return True
        self._decide(DecisionKind.CHOICE, child, suggestion or '', required, prompt)
        return False

    def _decide(
        self, kind: DecisionKind, child: LeafRun | ContainerRun, outcome: str, required: int, prompt: str
    ) -> None:
        if self.decision is None:
            self.decision = self._engine.new_decision(
                kind, child.path, outcome, child.definition.outcomes, required, prompt
            )

    def _withdraw_decision(self) -> None:
        if self.decision is not None:
            self.decision = None
            self._engine.changed()

    def _begin_leaving(self, child: LeafRun | ContainerRun) -> None:
        self._withdraw_decision()
        self._approved = False
        self._engine.count_transition(child.path)
        child.leave(child.exit_reason)
        self._leaving_until = self._engine.rest_deadline()
        self._engine.changed()

    def _finish_leaving(self, child: LeafRun | ContainerRun) -> bool:
        assert self._leaving_until is not None  # the caller has looked
        unsettled = child.unsettled()
        if unsettled is not None:
            if self._engine.steady.now() < self._leaving_until:
                return False
            self._engine.fault(
                child.path, f'was not at rest {self._engine.exit_timeout:g} s after it was left: {unsettled}'
            )
        self._leaving_until = None
        transition = self._transition(child)
        outcome = child.outcome
        reason = child.exit_reason
        self.child = None
        child.outcome = None
        if transition.state is not None:
            target = self._children[transition.state]
            self._engine.observer.transition(child.path, outcome or '', target.path, reason)
            self._enter_child(target)
        else:
            self.outcome = transition.outcome
            self._engine.observer.transition(child.path, outcome or '', f'={transition.outcome}', reason)
        self._engine.changed()
        return True

    def _enter_child(self, child: LeafRun | ContainerRun) -> None:
        self.child = child
        self._approved = False
        child.enter(self.scope)
        self._engine.changed()

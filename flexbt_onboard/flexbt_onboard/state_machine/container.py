# SPDX-License-Identifier: BSD-3-Clause
"""A machine in a run: which of its states is active, and the transitions between them.

A transition has three steps: the outcome is wanted (and perhaps waits for the operator), the state is left (and perhaps
has to come to rest), the next one is entered. A machine that ends wants an outcome of its own, and its parent takes the
same three steps with it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from .autonomy import UNDECLARED, is_autonomous
from .decision import Decision, DecisionKind
from .definition import MachineDefinition
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
        self.child: LeafRun | ContainerRun | None = None
        self.decision: Decision | None = None
        self.is_active = False
        self.is_leaving = False
        """Whether the child was left, and comes to rest."""
        self._children = {
            label: LeafRun(engine, child) if not isinstance(child, MachineDefinition) else ContainerRun(engine, child)
            for label, child in definition.children.items()
        }
        remap = definition.remap
        self._inputs = {key: remap.get(key, key) for key in definition.input_keys}
        self._outputs = {key: remap.get(key, key) for key in definition.output_keys}
        self._scope = Scope({})
        self._approved = False
        self._rest = engine.new_rest_wait()

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
        self.begin(Scope(self.definition.defaults, parent, self._inputs, self._outputs))

    def begin(self, scope: Scope) -> None:
        """Enter the initial state, with ``scope`` as the data of the machine."""
        self._scope = scope
        self.outcome = None
        self.exit_reason = ExitReason.OUTCOME
        self.is_active = True
        self._enter_child(self._children[self.definition.initial])

    def leave(self, reason: ExitReason) -> None:
        """Leave everything that is active in here."""
        self.is_active = False
        self.is_leaving = False
        self._rest.cancel()  # whoever leaves the machine waits for what is in it
        self._withdraw_decision()
        if self.child is not None:
            self.child.leave(reason if reason.is_of_the_run else ExitReason.PARENT_LEFT)

    def unsettled(self) -> str | None:
        """What is not at rest yet in here."""
        return self.child.unsettled() if self.child is not None else None

    def next_wake(self) -> float | None:
        """When something in here is due next. What comes to rest rings by itself."""
        if self.child is None or self.is_leaving or self.outcome is not None:
            return None
        return self.child.next_wake()

    # -- transitions -------------------------------------------------------------------------------------------------

    def advance(self) -> bool:
        """Take one step if there is one to take; whether there was."""
        child = self.child
        if child is None or self.outcome is not None:
            return False
        if self.is_leaving:
            return self._pass_on(child)
        if child.outcome is None and child.advance():
            return True
        return self._consider(child)

    def approve(self) -> None:
        """The operator has confirmed what the child wants."""
        assert self.decision is not None  # checked by the caller
        self._settle_on(self.decision.outcome)

    def force(self, outcome: str) -> None:
        """The operator wants the child to be left by ``outcome``, whatever it is doing."""
        assert self.child is not None  # checked by the caller
        self.child.exit_reason = ExitReason.FORCED
        self._settle_on(outcome)

    def _settle_on(self, outcome: str) -> None:
        assert self.child is not None  # checked by the caller
        self.child.outcome = outcome
        self._approved = True
        self._withdraw_decision()

    def _consider(self, child: LeafRun | ContainerRun) -> bool:
        """Leave the child when it wants to be left and may; otherwise ask the operator."""
        kind, wanted, prompt = DecisionKind.TRANSITION, child.outcome, ''
        if wanted is None:
            if child.question is None:
                return False
            kind = DecisionKind.CHOICE
            prompt, wanted = child.question
        required = UNDECLARED if wanted is None else child.definition.transitions[wanted].autonomy
        if wanted is not None and (self._approved or is_autonomous(required, self._engine.autonomy_of(child.path))):
            self._leave_child(child, wanted)
            return True
        if self.decision is None:
            self.decision = self._engine.new_decision(
                kind, child.path, wanted or '', child.definition.outcomes, required, prompt
            )
            self._engine.changed()
        return False

    def _withdraw_decision(self) -> None:
        if self.decision is not None:
            self.decision = None
            self._engine.changed()

    def _leave_child(self, child: LeafRun | ContainerRun, outcome: str) -> None:
        self._engine.count_transition(child.path)
        self._withdraw_decision()
        self._approved = False
        child.outcome = outcome
        child.leave(child.exit_reason)
        # A state that raised in on_exit wants another outcome by now, which has to be considered in its turn.
        self.is_leaving = child.outcome == outcome

    def _pass_on(self, child: LeafRun | ContainerRun) -> bool:
        """Go on to what follows when the child has come to rest, or its time for that is over."""
        unsettled = child.unsettled()
        if not self._rest.is_over(unsettled):
            return False
        if unsettled is not None:
            self._engine.fault(child.path, f'was not at rest {self._rest.timeout:g} s after it was left: {unsettled}')
        assert child.outcome is not None  # it was left by it
        outcome, child.outcome = child.outcome, None
        transition = child.definition.transitions[outcome]
        self.is_leaving = False
        self.child = None
        if transition.state is None:
            self.outcome = transition.outcome
            self._engine.observer.transition(child.path, outcome, f'={transition.outcome}', child.exit_reason)
        else:
            target = self._children[transition.state]
            self._engine.observer.transition(child.path, outcome, target.path, child.exit_reason)
            self._enter_child(target)
        return True

    def _enter_child(self, child: LeafRun | ContainerRun) -> None:
        self.child = child
        child.enter(self._scope)

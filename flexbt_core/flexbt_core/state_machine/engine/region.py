# SPDX-License-Identifier: BSD-3-Clause
"""Regions and containers in a run: the active child, transitions between children, userdata, and how a container
ends.

A machine is a container with one region, through which all of its children go. A concurrency container has a region
for each of its children, so that any number of them is active at once.

A transition has three steps: the outcome is wanted (and perhaps waits for the operator, or for a lock), the child is
left (and perhaps has to halt), what follows is entered. A container that ends wants an outcome of its own, and the
region that it is in takes the same three steps with it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeAlias

from flexbt_core.state_machine.model.autonomy import UNDECLARED, Decision, DecisionKind
from flexbt_core.state_machine.model.definition import MachineDefinition, StateKind, are_apart
from flexbt_core.state_machine.model.event_state import ExitReason
from flexbt_core.state_machine.model.userdata import Scope

from .engine import Engine
from .events import (
    ContainerEnded,
    DecisionAsked,
    DecisionClosed,
    Faulted,
    OutcomeTaken,
    StateLeft,
    TransitionBlocked,
    TransitionUnblocked,
)
from .leaf import FAILED, LeafRun

RegionChild: TypeAlias = 'LeafRun | ContainerRun'
"""A child that can be active in a region."""


class Region:
    """One region for the length of a run. ``path`` is that of its only child, or of the machine that it is all of.

    ``child`` is what is active here, ``coming`` what is entered as soon as nothing keeps it from that.
    """

    def __init__(self, engine: Engine, container: ContainerRun, path: str) -> None:
        self.container = container
        self.path = path
        self.child: RegionChild | None = None
        self.coming: RegionChild | None = None
        self.is_resumed = False
        """True if the child to be entered continues an interrupted run."""
        self.decision: Decision | None = None
        self.blocked: TransitionBlocked | None = None
        self.is_leaving = False
        """True if the child was left and is halting, by the outcome that it wants or to be entered again."""
        self.is_approved = False
        """True if the operator has approved the outcome that the child wants."""
        self._engine = engine
        self._halt_wait = engine.new_halt_wait()

    def enter(self, child: RegionChild) -> None:
        """Enter a child."""
        self.child = child
        child.enter(self.container.scope)

    def await_entry(self, child: RegionChild, *, is_resumed: bool = False) -> None:
        """Have a child entered in a separate step, after work with priority, a pause and a stop."""
        self.child, self.coming, self.is_resumed = None, child, is_resumed

    def leave(self, reason: ExitReason) -> None:
        """Leave the child; the caller waits until it has halted."""
        self.is_leaving = self.is_approved = False
        self.coming = None
        self._halt_wait.cancel()
        self._wait_for(None, None)
        if self.child is not None:
            self.child.leave(reason)

    def halting(self) -> str | None:
        """Return what has not halted yet in here."""
        return self.child.halting() if self.child is not None else None

    def next_wake(self) -> float | None:
        """Return when something in here is due next. What halts wakes the run by itself."""
        if self.child is None or self.is_leaving or self.is_approved:
            return None
        return self.child.next_wake()

    def advance(self) -> bool:
        """Take one step if there is one to take; whether there was."""
        child = self.child
        if child is None:
            return self._enter_what_is_coming()
        if self.is_leaving:
            return self._pass_on(child)
        if child.outcome is None:
            if child.advance():
                return True
        elif child.runs_while_blocked and not self.is_approved:
            # What it wants already comes first: a state that takes long may be due again all the time.
            if self._consider(child):
                return True
            child.advance()
            return self._consider(child) or child.exit_reason is ExitReason.FAULT
        return self._consider(child)

    # -- what the operator wants -------------------------------------------------------------------------------------

    def approve(self) -> None:
        """Let the child do what it wants: the operator has confirmed it."""
        assert self.decision is not None  # checked by the caller
        self._approve(self.decision.outcome)

    def force(self, outcome: str) -> None:
        """Leave the child by ``outcome`` in any state: the operator wants it."""
        assert self.child is not None  # checked by the caller
        self.child.exit_reason = ExitReason.FORCED
        self._approve(outcome)

    def repeat(self) -> None:
        """Leave the child and enter it again: the operator wants it."""
        assert self.child is not None  # checked by the caller
        self.child.exit_reason = ExitReason.REPEATED
        self._leave_child(self.child, None)

    def _approve(self, outcome: str) -> None:
        assert self.child is not None  # checked by the caller
        self.child.outcome = outcome
        self.is_approved = True
        self._wait_for(None, None)

    # -- transitions -------------------------------------------------------------------------------------------------

    def _enter_what_is_coming(self) -> bool:
        child = self.coming
        if child is None:
            return False
        self.child, self.coming = child, None
        child.enter(self.container.scope, is_resumed=self.is_resumed)
        return True

    def _consider(self, child: RegionChild) -> bool:
        """Leave the child when it wants to be left and may; otherwise ask the operator."""
        kind, wanted, prompt = DecisionKind.TRANSITION, child.outcome, ''
        if wanted is None:
            if child.choice is None:
                self._wait_for(None, None)
                return False
            kind = DecisionKind.CHOICE
            prompt, wanted = child.choice
        engine, required = self._engine, UNDECLARED
        if wanted is not None:
            locked = engine.locked_inside(self._left_by(child, wanted)) if engine.controls.locked else ()
            if locked:
                self._wait_for(None, TransitionBlocked(child.path, wanted, tuple(locked)))
                return False
            required = child.definition.transitions[wanted].autonomy
            if self.is_approved or engine.controls.may_pass(child.path, required):
                self._leave_child(child, wanted)
                return True
        self._ask(kind, child, wanted or '', required, prompt)
        return False

    def _ask(self, kind: DecisionKind, child: RegionChild, outcome: str, required: int, prompt: str) -> None:
        """Put something to the operator, unless that was done."""
        asked = self.decision
        if asked is None or (asked.kind, asked.outcome) != (kind, outcome):
            decision = self._engine.new_decision(kind, child.path, outcome, child.definition.outcomes, required, prompt)
            self._wait_for(decision, None)

    def _wait_for(self, decision: Decision | None, blocked: TransitionBlocked | None) -> None:
        """Let the child wait until the operator decides or unlocks something; for neither, nothing prevents it."""
        asked, was_blocked = self.decision, self.blocked
        if decision is asked and blocked == was_blocked:
            return
        self.decision, self.blocked = decision, blocked
        if decision is not asked:
            if asked is not None:
                self._engine.tell(DecisionClosed(asked))
            if decision is not None:
                self._engine.tell(DecisionAsked(decision))
        if blocked != was_blocked:
            if blocked is not None:
                self._engine.tell(blocked)
            elif was_blocked is not None:
                self._engine.tell(TransitionUnblocked(was_blocked.path))

    def _left_by(self, child: RegionChild, outcome: str) -> str:
        """Path of the outermost thing that is left when the child is left by an outcome."""
        path, container = child.path, self.container
        after = container.outcome_after(child, outcome)
        while after is not None:
            path = container.path
            if container.region is None:
                break
            outer = container.region.container
            container, after = outer, outer.outcome_after(container, after)
        return path

    def _leave_child(self, child: RegionChild, outcome: str | None) -> None:
        """Leave it by an outcome, or by none to enter it again."""
        self._engine.count_transition(child.path)
        self._wait_for(None, None)
        self.is_approved = False
        child.outcome = outcome
        if outcome is not None and self._engine.readings[OutcomeTaken]:
            self._engine.tell(OutcomeTaken(child.path, outcome, child.definition.transitions[outcome].autonomy))
        child.leave(child.exit_reason)
        # A state that raised in on_exit wants another outcome by now, which has to be considered in its turn.
        self.is_leaving = child.outcome == outcome

    def _pass_on(self, child: RegionChild) -> bool:
        """Go on to what follows when the child has halted, or its time for that is over."""
        halting = child.halting()
        if not self._halt_wait.is_over(halting):
            return False
        engine, container, outcome = self._engine, self.container, child.outcome
        if halting is not None:
            text = f'had not halted {self._halt_wait.timeout:g} s after it was left: {halting}'
            engine.tell(Faulted(child.path, text))
        following: RegionChild | None = child
        ends = None
        if outcome is not None:
            label = child.definition.transitions[outcome].state
            following = container.children[label] if label is not None else None
            ends = container.outcome_after(child, outcome) if following is None else None
        shown = following.path if following is not None else f'={ends}' if ends is not None else ''
        engine.tell(StateLeft(child.path, outcome or '', shown, child.exit_reason))
        self.is_leaving = False
        self.child = None
        if engine.pausing.priority is not None:
            engine.pausing.release(child.path)
        if following is not None:
            self.enter(following)
        else:
            assert outcome is not None  # otherwise the child follows itself
            container.child_has_ended(child, outcome, ends)
        return True


# A machine or container in a run: its regions, its userdata, and how it ends.


class ContainerRun:
    """One machine or container for the length of a run. ``region`` is the one that it is in, None for the root."""

    def __init__(self, engine: Engine, definition: MachineDefinition, region: Region | None = None) -> None:
        self._engine = engine
        self.definition = definition
        self.path = definition.path
        self.region = region
        self.outcome: str | None = None
        self.exit_reason = ExitReason.OUTCOME
        self.choice: tuple[str, str | None] | None = None  # a machine asks nothing
        self.runs_while_blocked = False  # and is frozen when it wants an outcome
        self.is_active = False
        self.ending: str | None = None
        """Outcome by which it ends as soon as everything in it has halted."""
        self.ended: dict[str, str] = {}
        """Outcomes of the children of a concurrency container that have ended."""
        self.scope = Scope({})
        is_concurrent = definition.kind is StateKind.CONCURRENCY
        paths = [child.path for child in definition.children.values()] if is_concurrent else [self.path]
        self.regions = tuple(Region(engine, self, path) for path in paths)
        self.children: dict[str, LeafRun | ContainerRun] = {}
        for number, (label, child) in enumerate(definition.children.items()):
            if isinstance(child, MachineDefinition):
                self.children[label] = ContainerRun(engine, child, self.regions[number if is_concurrent else 0])
            else:
                self.children[label] = LeafRun(engine, child)
        self._only_region = self.regions[0] if len(self.regions) == 1 else None
        self.advance: Callable[[], bool] = self._advance_regions
        """Take one step if possible, and return whether it was. Only while no outcome is wanted."""
        if not is_concurrent:  # it is where its region is, and so is what has priority
            self.advance = self.regions[0].advance
        remap = definition.remap
        self._inputs = {key: remap.get(key, key) for key in definition.input_keys}
        self._outputs = {key: remap.get(key, key) for key in definition.output_keys}
        self._halt_wait = engine.new_halt_wait()

    @property
    def is_ending(self) -> bool:
        """True if it has been left, or will be as soon as everything in it has halted."""
        return not self.is_active or self.ending is not None

    def leaves(self) -> Iterator[LeafRun]:
        """Yield all states, depth first."""
        for child in self.children.values():
            if isinstance(child, LeafRun):
                yield child
            else:
                yield from child.leaves()

    def active(self) -> Iterator[RegionChild]:
        """Yield what is active here, outermost first, this machine not included."""
        for region in self.active_regions():
            if region.child is not None:
                yield region.child

    def active_regions(self) -> Iterator[Region]:
        """Yield the regions of this machine and of everything in it that is active."""
        for region in self.regions:
            yield region
            if isinstance(region.child, ContainerRun):
                yield from region.child.active_regions()

    # -- entering and leaving ----------------------------------------------------------------------------------------

    def enter(self, parent: Scope, *, is_resumed: bool = False) -> None:
        """Enter the machine. It has no callbacks, so being resumed makes no difference."""
        self.begin(self.new_scope(parent))

    def new_scope(self, parent: Scope) -> Scope:
        """Return the data for a visit of the machine."""
        return Scope(self.definition.defaults, parent, self._inputs, self._outputs)

    def begin(self, scope: Scope) -> None:
        """Begin at the beginning, with ``scope`` as the data of the machine.

        A machine enters its initial state. The children of a concurrency container are entered one after the other, in
        steps of their own; and a priority container waits for the others to be paused.
        """
        self.activate(scope)
        kind = self.definition.kind
        if kind is StateKind.MACHINE:
            self.regions[0].enter(self.children[self.definition.initial])
        elif kind is StateKind.PRIORITY:
            self.regions[0].await_entry(self.children[self.definition.initial])
        else:
            for region, child in zip(self.regions, self.children.values(), strict=True):
                region.await_entry(child)

    def activate(self, scope: Scope) -> None:
        """Become active, with nothing entered yet."""
        self.scope = scope
        self.outcome = self.ending = None
        self.exit_reason = ExitReason.OUTCOME
        self.is_active = True
        self.ended.clear()
        self.take_priority()

    def take_priority(self) -> None:
        """Have priority, if it is the kind that does."""
        if self.definition.kind is StateKind.PRIORITY:
            self._engine.pausing.give_priority(self.path)

    def leave(self, reason: ExitReason) -> None:
        """Leave everything that is active in here."""
        self.is_active = False
        self.ending = None
        self._halt_wait.cancel()  # the one that leaves the machine waits for what is in it
        self._leave_regions(reason if reason.is_of_the_run else ExitReason.PARENT_LEFT)

    def _leave_regions(self, reason: ExitReason) -> None:
        for region in self.regions:
            region.leave(reason)

    def clear(self) -> None:
        """Nothing is active in here any more."""
        for region in self.regions:
            region.child = None

    def halting(self) -> str | None:
        """Return what has not halted yet in here."""
        if self._only_region is not None:
            return self._only_region.halting()
        return next(filter(None, (region.halting() for region in self.regions)), None)

    def next_wake(self) -> float | None:
        """Return when something in here is due next. What halts wakes the run by itself."""
        if self.outcome is not None or self.ending is not None:
            return None
        if self._only_region is not None:
            return self._only_region.next_wake()
        return min((due for region in self.regions if (due := region.next_wake()) is not None), default=None)

    def _advance_regions(self) -> bool:
        if self.ending is not None:
            return self._await_halt(self.ending)
        priority = self._engine.pausing.priority
        going = [one for one in self.regions if priority is None or not are_apart(one.path, priority)]
        # What ends at once does not keep the others from being entered.
        return any(one.coming is not None and one.advance() for one in going) or any(one.advance() for one in going)

    # -- how it goes on and ends -------------------------------------------------------------------------------------

    def outcome_after(self, child: RegionChild, outcome: str) -> str | None:
        """Outcome by which this container ends when a child is left by an outcome; None when it goes on."""
        if self.definition.kind is StateKind.CONCURRENCY:
            return self.definition.outcome_of({**self.ended, child.definition.label: outcome})
        return child.definition.transitions[outcome].outcome

    def child_has_ended(self, child: RegionChild, outcome: str, ends: str | None) -> None:
        """Note that a child was left with nothing to follow it; this ends the container by ``ends``, if it is an
        outcome."""
        if self.definition.kind is not StateKind.CONCURRENCY:
            self.outcome = ends
            return
        self.ended[child.definition.label] = outcome
        if ends is None and len(self.ended) == len(self.regions):
            ends = self._fail()
        if ends is not None:
            self.ending = ends
            self._leave_regions(ExitReason.PARENT_LEFT)

    def _await_halt(self, ending: str) -> bool:
        """Want the outcome as soon as everything in here has halted, or the time for that is over."""
        halting = self.halting()
        if not self._halt_wait.is_over(halting):
            return False
        if halting is not None:
            text = f'not everything in it had halted {self._halt_wait.timeout:g} s after it ended: {halting}'
            self._engine.tell(Faulted(self.path, text))
        self.outcome, self.ending = ending, None
        for region in self.regions:
            if region.child is not None:
                self._engine.pausing.release(region.child.path)
        self.clear()
        self._engine.tell(ContainerEnded(self.path, ending))
        return True

    def _fail(self) -> str | None:
        """Return all children have ended and no condition holds: that is what the check of the machine could not
        exclude."""
        ended = ', '.join(f'{label} by {outcome!r}' for label, outcome in self.ended.items())
        text = f'all of its children have ended ({ended}), and no condition holds; add one for that'
        self._engine.tell(Faulted(self.path, text))
        if FAILED in self.definition.outcomes:
            self.exit_reason = ExitReason.FAULT
            return FAILED
        self._engine.fail(f'{self.path}: {text}')
        return None

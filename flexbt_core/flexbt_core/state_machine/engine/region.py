# SPDX-License-Identifier: BSD-3-Clause
"""Regions and containers in a run: the active child, transitions between children, userdata, and the end of a
container.

A machine is a container with one region for all of its children, one of which is active. A concurrency container has
a region for each child, so that any number of them is active at once.

A transition has three steps: the child wants an outcome (and may wait for the operator or a lock), the child is left
(and may need time to halt), the next child is entered. A container that ends wants an outcome too, and the region
around it takes the same three steps.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from typing import TypeAlias

from flexbt_core.state_machine.model.autonomy import UNDECLARED, Decision, DecisionKind
from flexbt_core.state_machine.model.definition import MachineDefinition, StateKind, are_apart, is_inside
from flexbt_core.state_machine.model.event_state import ExitReason
from flexbt_core.state_machine.model.userdata import Scope

from .engine import Engine
from .events import (
    ContainerEnded,
    DecisionAsked,
    DecisionClosed,
    Faulted,
    MachineEntered,
    OutcomeTaken,
    StateLeft,
    TransitionBlocked,
    TransitionUnblocked,
)
from .leaf import FAILED, LeafRun

RegionChild: TypeAlias = 'LeafRun | ContainerRun'
"""A child that can be active in a region."""


class Region:
    """One region during a run. ``path`` is that of its only child, or of the machine if this is its only region.

    ``child`` is the active child; ``coming`` is the child to enter as soon as nothing prevents it.
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
        """True if the child was left, by its outcome or to be repeated, and is halting."""
        self.is_approved = False
        """True if the operator has approved the outcome that the child wants."""
        self._engine = engine
        self._halt_wait = engine.new_halt_wait()

    def enter(self, child: RegionChild) -> None:
        """Enter a child."""
        self.child = child
        child.enter(self.container.scope)

    def await_entry(self, child: RegionChild, *, is_resumed: bool = False) -> None:
        """Enter a child in a later step; priority work, a pause and a stop come first."""
        self.child, self.coming, self.is_resumed = None, child, is_resumed

    def leave(self, reason: ExitReason) -> None:
        """Leave the child; the caller waits until it has halted."""
        self.is_leaving = self.is_approved = False
        self.coming = None
        self._halt_wait.cancel()
        self.wait_no_longer()
        if self.child is not None:
            self.child.leave(reason)

    def wait_no_longer(self) -> None:
        """End the wait for a decision or a lock, and report it."""
        self._wait_for(None, None)

    def halting(self) -> str | None:
        """Return what has not halted yet in this region."""
        return self.child.halting() if self.child is not None else None

    def next_wake(self) -> float | None:
        """Return the time of the next execution in this region. A halting state wakes the run itself."""
        if self.child is None or self.is_leaving or self.is_approved:
            return None
        return self.child.next_wake()

    def advance(self) -> bool:
        """Take one step if possible. Return whether a step was taken."""
        child = self.child
        if child is None:
            return self._enter_what_is_coming()
        if self.is_leaving:
            return self._pass_on(child)
        if child.outcome is None:
            if child.advance():
                return True
        elif child.runs_while_blocked and not self.is_approved:
            # Consider its outcome before executing it: a slow state may always be due again.
            if self._consider(child):
                return True
            child.advance()
            return self._consider(child) or child.exit_reason is ExitReason.FAULT
        return self._consider(child)

    # -- commands of the operator ------------------------------------------------------------------------------------

    def approve(self) -> None:
        """Let the child be left by the outcome that it wants: the operator has confirmed it."""
        assert self.decision is not None  # checked by the caller
        self._approve(self.decision.outcome)

    def force(self, outcome: str) -> None:
        """Leave the child by ``outcome``, whatever it is doing: the operator has forced it."""
        assert self.child is not None  # checked by the caller
        self.child.exit_reason = ExitReason.FORCED
        self._approve(outcome)

    def repeat(self) -> None:
        """Leave the child and enter it again: the operator has requested it."""
        assert self.child is not None  # checked by the caller
        self.child.exit_reason = ExitReason.REPEATED
        self._leave_child(self.child, None)

    def _approve(self, outcome: str) -> None:
        assert self.child is not None  # checked by the caller
        self.child.outcome = outcome
        self.is_approved = True
        self.wait_no_longer()

    # -- transitions -------------------------------------------------------------------------------------------------

    def _enter_what_is_coming(self) -> bool:
        child = self.coming
        if child is None:
            return False
        self.child, self.coming = child, None
        child.enter(self.container.scope, is_resumed=self.is_resumed)
        return True

    def _consider(self, child: RegionChild) -> bool:
        """Leave the child if it wants an outcome and may take it; otherwise wait for a lock or ask the operator."""
        kind, wanted, prompt = DecisionKind.TRANSITION, child.outcome, ''
        if wanted is None:
            if child.choice is None:
                self.wait_no_longer()
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
        """Ask the operator, unless the same question is pending."""
        asked = self.decision
        if asked is None or (asked.kind, asked.outcome) != (kind, outcome):
            decision = self._engine.new_decision(kind, child.path, outcome, child.definition.outcomes, required, prompt)
            self._wait_for(decision, None)

    def _wait_for(self, decision: Decision | None, blocked: TransitionBlocked | None) -> None:
        """Make the child wait for a decision or for a lock; with None for both it waits no longer."""
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
        """Return the path of the outermost node that is left when the child is left by an outcome."""
        path, container = child.path, self.container
        after = container.outcome_after(child, outcome, with_halting=True)
        while after is not None:
            path = container.path
            outer = container.around
            if outer is None:
                break
            container, after = outer, outer.outcome_after(container, after, with_halting=True)
        return path

    def _leave_child(self, child: RegionChild, outcome: str | None) -> None:
        """Leave the child by an outcome, or by None to enter it again."""
        self._engine.count_transition(child.path)
        self.wait_no_longer()
        self.is_approved = False
        child.outcome = outcome
        if outcome is not None and self._engine.readings[OutcomeTaken]:
            self._engine.tell(OutcomeTaken(child.path, outcome, child.definition.transitions[outcome].autonomy))
        child.leave(child.exit_reason)
        # A state that raised in on_exit wants another outcome now, which the next step considers.
        self.is_leaving = child.outcome == outcome

    def _pass_on(self, child: RegionChild) -> bool:
        """Enter the next child or end the container, once the child has halted or its time to halt is over."""
        if (self._engine.controls.locked or self.blocked is not None) and self._end_is_blocked(child):
            return False
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
            ends = container.outcome_after(child, outcome)
        shown = following.path if following is not None else f'={ends}' if ends is not None else ''
        engine.tell(StateLeft(child.path, outcome or '', shown, child.exit_reason))
        self.is_leaving = False
        self.child = None
        if engine.pausing.priority is not None:
            engine.pausing.release(child.path)
        if following is not None:
            self.enter(following)
        else:
            assert outcome is not None  # without an outcome the child follows itself
            container.child_has_ended(child, outcome, ends)
        return True

    def _end_is_blocked(self, child: RegionChild) -> bool:
        """Return whether the end of the container, which follows from a child that was left, waits for a lock. The lock
        may have been set meanwhile; a lock of the child itself comes too late."""
        outcome, blocked = child.outcome, None
        if outcome is not None and self.container.outcome_after(child, outcome) is not None:
            inside = self._engine.locked_inside(self._left_by(child, outcome))
            locked = tuple(path for path in inside if not is_inside(path, child.path))
            blocked = TransitionBlocked(child.path, outcome, locked) if locked else None
        self._wait_for(None, blocked)
        return blocked is not None


# A machine or container in a run: its regions, its userdata, and how it ends.


class ContainerRun:
    """One machine or container during a run. ``around`` is that which it is in, None for the root."""

    def __init__(self, engine: Engine, definition: MachineDefinition, around: ContainerRun | None = None) -> None:
        self._engine = engine
        self.definition = definition
        self.path = definition.path
        self.around = around
        self.outcome: str | None = None
        self.exit_reason = ExitReason.OUTCOME
        self.choice: tuple[str, str | None] | None = None  # a machine asks nothing
        self.runs_while_blocked = False  # a machine is frozen when it wants an outcome
        self.is_active = False
        self.ending: str | None = None
        """Outcome by which it ends once all its descendants have halted."""
        self.ended: dict[str, str] = {}
        """Outcomes of the children of a concurrency container that have ended."""
        self.scope = Scope({})
        is_concurrent = definition.kind is StateKind.CONCURRENCY
        paths = [child.path for child in definition.children.values()] if is_concurrent else [self.path]
        self.regions = tuple(Region(engine, self, path) for path in paths)
        self.children: dict[str, LeafRun | ContainerRun] = {}
        for label, child in definition.children.items():
            if isinstance(child, MachineDefinition):
                self.children[label] = ContainerRun(engine, child, self)
            else:
                self.children[label] = LeafRun(engine, child)
        self._only_region = self.regions[0] if len(self.regions) == 1 else None
        self.advance: Callable[[], bool] = self._advance_regions
        """Take one step if possible, and return whether one was taken. Call it only while it wants no outcome."""
        if not is_concurrent:  # its only region has its path, so priority needs no check
            self.advance = self.regions[0].advance
        remap = definition.remap
        self._inputs = {key: remap.get(key, key) for key in definition.input_keys}
        self._outputs = {key: remap.get(key, key) for key in definition.output_keys}
        self._halt_wait = engine.new_halt_wait()

    @property
    def is_ending(self) -> bool:
        """True if it has been left, or will be once all its descendants have halted."""
        return not self.is_active or self.ending is not None

    def leaves(self) -> Iterator[LeafRun]:
        """Yield all states, depth first."""
        for child in self.children.values():
            if isinstance(child, LeafRun):
                yield child
            else:
                yield from child.leaves()

    def active(self) -> Iterator[RegionChild]:
        """Yield the active nodes in this machine, outermost first, without the machine itself."""
        for region in self.active_regions():
            if region.child is not None:
                yield region.child

    def active_regions(self) -> Iterator[Region]:
        """Yield the regions of this machine and of its active descendants."""
        for region in self.regions:
            yield region
            if isinstance(region.child, ContainerRun):
                yield from region.child.active_regions()

    # -- entering and leaving ----------------------------------------------------------------------------------------

    def enter(self, parent: Scope, *, is_resumed: bool = False) -> None:
        """Enter the machine. It has no callbacks, so ``is_resumed`` makes no difference."""
        self.begin(self.new_scope(parent))

    def new_scope(self, parent: Scope, restored: Collection[str] = ()) -> Scope:
        """Return the userdata for one visit of the machine. Keys in ``restored`` get values of an earlier visit, so
        their defaults are not written, neither here nor as outputs to the parent."""
        defaults = {key: value for key, value in self.definition.defaults.items() if key not in restored}
        return Scope(defaults, parent, self._inputs, self._outputs)

    def begin(self, scope: Scope) -> None:
        """Begin a visit from the start, with ``scope`` as the userdata of the machine.

        A machine enters its initial state. A concurrency container enters its children one after the other, one per
        step. A priority container first waits until the other states are paused.
        """
        self.activate(scope)
        kind = self.definition.kind
        if kind is StateKind.CONCURRENCY:
            for region, child in zip(self.regions, self.children.values(), strict=True):
                region.await_entry(child)
        else:
            self.regions[0].await_entry(self.children[self.definition.initial])
        if self.around is not None and self._engine.readings[MachineEntered]:
            self._engine.tell(MachineEntered(self.path))
        if kind is StateKind.MACHINE:
            self.regions[0].advance()

    def activate(self, scope: Scope) -> None:
        """Become active, without entering a child."""
        self.scope = scope
        self.outcome = self.ending = None
        self.exit_reason = ExitReason.OUTCOME
        self.is_active = True
        self.ended.clear()
        self.take_priority()

    def take_priority(self) -> None:
        """Pause the other states if this is a priority container."""
        if self.definition.kind is StateKind.PRIORITY:
            self._engine.pausing.give_priority(self.path)

    def leave(self, reason: ExitReason) -> None:
        """Leave all active descendants."""
        self.is_active = False
        self.ending = None
        self._halt_wait.cancel()  # the caller waits until the descendants have halted
        self._leave_regions(reason if reason.is_of_the_run else ExitReason.PARENT_LEFT)

    def _leave_regions(self, reason: ExitReason) -> None:
        for region in self.regions:
            region.leave(reason)

    def clear(self) -> None:
        """Mark all children as inactive."""
        for region in self.regions:
            region.child = None

    def halting(self) -> str | None:
        """Return what has not halted yet in this machine."""
        if self._only_region is not None:
            return self._only_region.halting()
        return next((text for region in self.regions if (text := region.halting()) is not None), None)

    def next_wake(self) -> float | None:
        """Return the time of the next execution in this machine. A halting state wakes the run itself."""
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
        # Enter all children first, even if one of them ends at once.
        return any(one.coming is not None and one.advance() for one in going) or any(one.advance() for one in going)

    # -- transitions and the end -------------------------------------------------------------------------------------

    def outcome_after(self, child: RegionChild, outcome: str, *, with_halting: bool = False) -> str | None:
        """Return the outcome by which this container ends when a child is left by an outcome; None if it continues.
        ``with_halting``: the other children that were left and are halting have ended, too."""
        if self.definition.kind is StateKind.CONCURRENCY:
            others = [region.child for region in self.regions if with_halting and region.is_leaving]
            left = {one.definition.label: one.outcome for one in others if one is not None and one.outcome is not None}
            return self.definition.outcome_of({**self.ended, **left, child.definition.label: outcome})
        return child.definition.transitions[outcome].outcome

    def child_has_ended(self, child: RegionChild, outcome: str, ends: str | None) -> None:
        """Record that a child was left and has no successor. If ``ends`` is an outcome, the container ends by
        it."""
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
        """Take the outcome ``ending`` once all descendants have halted or their time to halt is over."""
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
        """Report that all children have ended and no condition holds, which the check of the machine could not exclude.
        Return the outcome ``failed`` if the container has it; else end the run."""
        ended = ', '.join(f'{label} by {outcome!r}' for label, outcome in self.ended.items())
        text = f'all of its children have ended ({ended}), and no condition holds; add one for that'
        self._engine.tell(Faulted(self.path, text))
        if FAILED in self.definition.outcomes:
            self.exit_reason = ExitReason.FAULT
            return FAILED
        self._engine.fail(f'{self.path}: {text}')
        return None

# SPDX-License-Identifier: BSD-3-Clause
"""A machine or container in a run: its regions, its userdata, and how it ends."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from flexbt_core.state_machine.model import ExitReason, MachineDefinition, Scope, StateKind, are_apart

from .engine import Engine
from .leaf import FAILED, LeafRun
from .region import Node, Region


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
        """Take one step if there is one to take; whether there was. Only while no outcome is wanted."""
        if not is_concurrent:  # it is where its region is, and so is what has priority
            self.advance = self.regions[0].advance
        remap = definition.remap
        self._inputs = {key: remap.get(key, key) for key in definition.input_keys}
        self._outputs = {key: remap.get(key, key) for key in definition.output_keys}
        self._halt_wait = engine.new_halt_wait()

    @property
    def is_ending(self) -> bool:
        """Whether it has been left, or is to be as soon as everything in it has halted."""
        return not self.is_active or self.ending is not None

    def leaves(self) -> Iterator[LeafRun]:
        """All states, depth first."""
        for child in self.children.values():
            if isinstance(child, LeafRun):
                yield child
            else:
                yield from child.leaves()

    def active(self) -> Iterator[Node]:
        """What is active here, outermost first, this machine not included."""
        for region in self.active_regions():
            if region.child is not None:
                yield region.child

    def active_regions(self) -> Iterator[Region]:
        """The regions of this machine and of everything in it that is active."""
        for region in self.regions:
            yield region
            if isinstance(region.child, ContainerRun):
                yield from region.child.active_regions()

    # -- entering and leaving ----------------------------------------------------------------------------------------

    def enter(self, parent: Scope, *, is_resumed: bool = False) -> None:
        """The machine becomes active. It has no callbacks, so that it is the same whether it is resumed."""
        self.begin(self.new_scope(parent))

    def new_scope(self, parent: Scope) -> Scope:
        """Data for a visit of the machine."""
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
        self._halt_wait.cancel()  # whoever leaves the machine waits for what is in it
        self._leave_regions(reason if reason.is_of_the_run else ExitReason.PARENT_LEFT)

    def _leave_regions(self, reason: ExitReason) -> None:
        for region in self.regions:
            region.leave(reason)

    def clear(self) -> None:
        """Nothing is active in here any more."""
        for region in self.regions:
            region.child = None

    def halting(self) -> str | None:
        """What has not halted yet in here."""
        if self._only_region is not None:
            return self._only_region.halting()
        return next(filter(None, (region.halting() for region in self.regions)), None)

    def next_wake(self) -> float | None:
        """When something in here is due next. What halts wakes the run by itself."""
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

    def outcome_after(self, child: Node, outcome: str) -> str | None:
        """Outcome by which this container ends when a child is left by an outcome; None when it goes on."""
        if self.definition.kind is StateKind.CONCURRENCY:
            return self.definition.outcome_of({**self.ended, child.definition.label: outcome})
        return child.definition.transitions[outcome].outcome

    def child_has_ended(self, child: Node, outcome: str, ends: str | None) -> None:
        """A child was left with nothing to follow it; by that the container ends by ``ends``, if that is an outcome."""
        if self.definition.kind is not StateKind.CONCURRENCY:
            self.outcome = ends
            self._engine.changed()
            return
        self.ended[child.definition.label] = outcome
        if ends is None and len(self.ended) == len(self.regions):
            ends = self._fail()
        if ends is not None:
            self.ending = ends
            self._leave_regions(ExitReason.PARENT_LEFT)
        self._engine.changed()

    def _await_halt(self, ending: str) -> bool:
        """Want the outcome as soon as everything in here has halted, or the time for that is over."""
        halting = self.halting()
        if not self._halt_wait.is_over(halting):
            return False
        if halting is not None:
            text = f'not everything in it had halted {self._halt_wait.timeout:g} s after it ended: {halting}'
            self._engine.fault(self.path, text)
        self.outcome, self.ending = ending, None
        for region in self.regions:
            if region.child is not None:
                self._engine.pausing.release(region.child.path)
        self.clear()
        self._engine.changed()
        return True

    def _fail(self) -> str | None:
        """All children have ended and no condition holds: that is what the check of the machine could not exclude."""
        ended = ', '.join(f'{label} by {outcome!r}' for label, outcome in self.ended.items())
        text = f'all of its children have ended ({ended}), and no condition holds; add one for that'
        self._engine.fault(self.path, text)
        if FAILED in self.definition.outcomes:
            self.exit_reason = ExitReason.FAULT
            return FAILED
        self._engine.fail(f'{self.path}: {text}')
        return None

# SPDX-License-Identifier: BSD-3-Clause
"""Random machines under random operations: the engine does what a model does, and keeps its promises at each moment.

Monitors (see :class:`Bench`) watch each run, and have nothing to tell.

By hand, with more and larger machines: HFSM_EXAMPLES=1700 HFSM_STATES=200 python -m pytest -k hfsm_random
"""

from __future__ import annotations

import json
import os
from random import Random

import hypothesis.strategies as st
from hfsm_reference_model import LIVELOCK, Model
from hypothesis import HealthCheck, settings
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from flexbt_core.state_machine.engine.events import (
    BreakpointSet,
    DecisionAsked,
    DecisionClosed,
    LockSet,
    RunEvent,
    RunReader,
    StatePaused,
    TransitionBlocked,
    TransitionUnblocked,
)
from flexbt_core.state_machine.engine.resume import RunPosition, position_of
from flexbt_core.state_machine.engine.run import MachineRun
from flexbt_core.state_machine.model.autonomy import Decision
from flexbt_testing.state_machines.bench import Bench
from flexbt_testing.state_machines.random_machines import Puppet, RandomNode, build, random_machine

KINDS = {'TRANSITION': 'transition', 'CHOICE': 'choice'}
CALLBACKS = ('on_enter', 'on_exit', 'on_pause', 'on_resume')
NUMBERS = st.integers(0, 200)


class Follower(RunReader):
    """A view of a run that knows only its events, as an operator has it."""

    def __init__(self, run: MachineRun) -> None:
        self.view = view_of(run)
        run.add_reader(self)

    def read(self, event: RunEvent) -> None:
        paused, decisions, blocked, locked, breakpoints = self.view
        match event:
            case StatePaused(path, is_paused):
                assert is_paused is (path not in paused)
                paused ^= {path}
            case DecisionAsked(decision):
                assert decision.path not in decisions
                decisions[decision.path] = decision
            case DecisionClosed(decision):
                assert decisions.pop(decision.path) == decision
            case TransitionBlocked(path):
                blocked[path] = event
            case TransitionUnblocked(path):
                del blocked[path]
            case LockSet(path, is_set):
                assert is_set is (path not in locked)
                locked ^= {path}
            case BreakpointSet(path, is_set):
                assert is_set is (path not in breakpoints)
                breakpoints ^= {path}


View = tuple[set[str], dict[str, Decision], dict[str, TransitionBlocked], set[str], set[str]]


def view_of(run: MachineRun) -> View:
    """Return what a run shows: paused states, decisions, blocked transitions, locks, breakpoints."""
    return (
        {leaf.path for leaf in run.active_states() if leaf.is_paused},
        {one.path: one for one in run.decisions},
        {region.blocked.path: region.blocked for region in run.regions() if region.blocked is not None},
        set(run.locked),
        set(run.breakpoints),
    )


def running(run: RandomRun) -> bool:
    """Return whether the run goes on."""
    return run.model.outcome is None


class RandomRun(RuleBasedStateMachine):
    """The operations are those of the world (events, rest, time) and of the operator; after the end it begins again."""

    @initialize(seed=st.integers(0, 2**32), level=st.integers(0, 3))
    def build(self, seed: int, level: int) -> None:
        self.root = random_machine(Random(seed))
        self.nodes = list(self.root.all())
        self._begin(level)

    def _begin(self, level: int, at: RunPosition | None = None) -> None:
        machine, puppets = build(self.root)
        self.puppets = puppets
        self.bench = Bench(machine, autonomy=level, max_transitions=LIVELOCK, at=at)
        self.follower = Follower(self.bench.run)
        if at is None:
            self.model = Model(self.root, level)

    @precondition(lambda self: not running(self))
    @rule(level=st.integers(0, 3))
    def begin_again(self, level: int) -> None:
        self.teardown()
        self._begin(level)

    # -- the world ---------------------------------------------------------------------------------------------------

    @precondition(running)
    @rule(number=NUMBERS, here=st.integers(0, 4), choice=st.sampled_from([0, 0, 1, 1, 2, 2, None]))
    def event(self, number: int, here: int, choice: int | None) -> None:
        puppet = self._puppet(number, here)
        outcome = None if choice is None else puppet.node.outcomes[choice % len(puppet.node.outcomes)]
        puppet.outcome = outcome
        puppet.wake()
        self.bench.settle()
        self.model.event(puppet.node, outcome)

    @precondition(lambda self: running(self) and self.model.active)
    @rule(number=NUMBERS)
    def rest(self, number: int) -> None:
        puppet = self._puppet(number, 1)
        puppet.rest()
        self.bench.settle()
        self.model.rest(puppet.node)

    @precondition(running)
    @rule(seconds=st.sampled_from([1.0, 2.0, 3.0]))
    def pass_time(self, seconds: float) -> None:
        self.bench.pass_time(seconds)
        self.model.pass_time(seconds)

    # -- the operator ------------------------------------------------------------------------------------------------

    @precondition(running)
    @rule(level=st.sampled_from([0, 1, 2, 3, 3]), number=NUMBERS)
    def autonomy(self, level: int, number: int) -> None:
        path = self.nodes[number % len(self.nodes)].path if number % 3 else '/'
        refusal = self.bench.set_autonomy(level, path)
        assert (refusal is None) is self.model.set_autonomy(level, path), refusal

    @precondition(lambda self: self.model.pending)
    @rule(number=NUMBERS)
    def confirm(self, number: int) -> None:
        pending = self.model.pending
        self._confirm(pending[number % len(pending)][0])

    @precondition(lambda self: self.model.decisions > 0)
    @rule(back=st.integers(0, 3))
    def confirm_late(self, back: int) -> None:
        self._confirm(self.model.decisions - back)

    def _confirm(self, number: int) -> None:
        refusal = self.bench.confirm(str(number))
        assert (refusal is None) is self.model.confirm(number), refusal

    @rule(
        number=NUMBERS,
        here=st.integers(0, 3),
        outcome=st.sampled_from([0, 0, 1, 1, 2, 'x']),
        back=st.sampled_from([None, None, None, 0, 1]),
    )
    def force(self, number: int, here: int, outcome: int | str, back: int | None) -> None:
        node = self._node(number, here)
        wanted = outcome if isinstance(outcome, str) else node.outcomes[outcome % len(node.outcomes)]
        decision = None if back is None else self.model.decisions - back
        number_text = '' if decision is None else str(decision)
        refusal = self.bench.force(node.path, wanted, number_text)
        accepted = self.model.force(node.path, wanted, decision) if node.parent is not None else False
        assert (refusal is None) is accepted, refusal

    @rule(number=NUMBERS, here=st.integers(0, 3))
    def repeat(self, number: int, here: int) -> None:
        path = self._node(number, here).path
        refusal = self.bench.repeat(path)
        assert (refusal is None) is self.model.repeat(path), refusal

    @rule(number=NUMBERS, here=st.integers(0, 3))
    def lock(self, number: int, here: int) -> None:
        path = self._node(number, here).path
        refusal = self.bench.lock(path)
        assert (refusal is None) is self.model.mark(self.model.locked, path), refusal

    @rule(number=NUMBERS, at_random=st.booleans())
    def unlock(self, number: int, at_random: bool) -> None:
        path = self._marked(self.model.locked, number, at_random)
        refusal = self.bench.unlock(path)
        assert (refusal is None) is self.model.unmark(self.model.locked, path), refusal

    @rule(number=NUMBERS, here=st.integers(0, 3))
    def set_breakpoint(self, number: int, here: int) -> None:
        path = self._node(number, here).path
        refusal = self.bench.set_breakpoint(path)
        accepted = path != '/' and self.model.mark(self.model.breakpoints, path)
        assert (refusal is None) is accepted, refusal

    @rule(number=NUMBERS)
    def clear_breakpoint(self, number: int) -> None:
        path = self._marked(self.model.breakpoints, number, False)
        refusal = self.bench.clear_breakpoint(path)
        assert (refusal is None) is self.model.unmark(self.model.breakpoints, path), refusal

    @rule(wants_it=st.integers(0, 3))
    def pause_or_resume(self, wants_it: int) -> None:
        is_paused = self.model.is_paused if wants_it == 0 else not self.model.is_paused
        if is_paused and wants_it == 1:
            return  # it would stand still most of the time
        refusal = self.bench.pause() if is_paused else self.bench.resume()
        assert (refusal is None) is self.model.pause(is_paused), refusal

    @precondition(running)
    @rule(number=st.integers(0, 9))
    def stop(self, number: int) -> None:
        if number == 0:
            self.bench.stop()
            self.model.stop()

    @precondition(running)
    @rule()
    def abort(self) -> None:
        self.bench.run.abort('enough')
        self.bench.settle()
        self.model.abort()

    @precondition(lambda self: not self.model.stands)
    @rule()
    def switch(self) -> None:
        machine, puppets = build(self.root)
        refusal = self.bench.switch(machine)
        assert (refusal is None) is self.model.switch(), refusal
        if refusal is None:
            active = [leaf.state for leaf in self.bench.run.active_states()]
            assert all(puppet.calls('on_stop') == (puppet not in active) for puppet in self.puppets)
            self.puppets += puppets

    @precondition(lambda self: not self.model.stands)
    @rule()
    def go_on_after_a_crash(self) -> None:
        """Check that what was written down is enough for another run, in another process, to go on there."""
        position = RunPosition.from_plain(json.loads(json.dumps(position_of(self.bench.run).to_plain())))
        assert position == position_of(self.bench.run)
        self._begin(0, position)
        self.model.resume()

    # -- what they are about -----------------------------------------------------------------------------------------

    def _puppet(self, number: int, here: int) -> Puppet:
        """One of the run: an active one if there is one and ``here`` is not 0."""
        active = self.bench.run.active_states() if here else []
        chosen = active or list(self.bench.run.root.leaves())
        puppet = chosen[number % len(chosen)].state
        assert isinstance(puppet, Puppet)
        return puppet

    def _node(self, number: int, here: int) -> RandomNode:
        active = [seat.occupant for seat in self.model.seats()] if here else []
        chosen = active or self.nodes
        return chosen[number % len(chosen)]

    def _marked(self, marked: set[str], number: int, at_random: bool) -> str:
        chosen = sorted(marked)
        return self._node(number, 0).path if at_random or not chosen else chosen[number % len(chosen)]

    # -- what has to hold --------------------------------------------------------------------------------------------

    @invariant()
    def agree(self) -> None:
        bench, model = self.bench, self.model
        assert bench.outcome == model.outcome
        assert bench.active == tuple(node.path for node in model.active)
        assert [leaf.path for leaf in bench.run.active_states() if leaf.is_paused] == model.paused
        shown = [(int(one.id), (KINDS[one.kind.name], one.path, one.outcome)) for one in bench.run.decisions]
        assert shown == model.pending
        assert (bench.run.locked, bench.run.breakpoints) == (sorted(model.locked), sorted(model.breakpoints))
        assert bench.run.calling is None
        if model.outcome is None:
            assert bool(bench.run.not_halted) is model.stands
        visits = [event for event in bench.trace if event.startswith(CALLBACKS)]
        assert visits == model.events
        assert [(path, outcome, reason.name) for path, outcome, _, reason in bench.transitions] == model.transitions
        assert all(outcome or target == path for path, outcome, target, _ in bench.transitions)

    @invariant()
    def each_visit_has_one_beginning_and_one_end(self) -> None:
        inside: set[str] = set()
        paused: set[str] = set()
        for event in self.bench.trace:
            callback, _, rest = event.partition(' ')
            path = rest.partition(' ')[0]
            if callback == 'on_enter':
                assert path not in inside, event
                inside.add(path)
            elif callback in ('on_exit', 'execute', 'on_pause', 'on_resume'):
                assert path in inside, event
                assert callback not in ('execute', 'on_pause') or path not in paused, event
                assert callback != 'on_resume' or path in paused, event
            if callback == 'on_pause':
                paused.add(path)
            elif callback in ('on_resume', 'on_exit'):
                paused.discard(path)
                inside -= {path} if callback == 'on_exit' else set()

    @invariant()
    def the_operator_was_shown_what_is(self) -> None:
        before = self.bench.snapshots[-1]
        self.bench.show()
        assert self.bench.snapshots.pop() == before

    @invariant()
    def what_was_told_adds_up_to_what_is(self) -> None:
        assert self.follower.view == view_of(self.bench.run)

    @invariant()
    def another_step_would_change_nothing(self) -> None:
        """Nothing is left that somebody would have to ring for."""
        events, snapshots = len(self.bench.trace), len(self.bench.snapshots)
        self.bench.run.step()
        assert (len(self.bench.trace), len(self.bench.snapshots)) == (events, snapshots)

    def teardown(self) -> None:
        if not hasattr(self, 'bench'):
            return
        self.bench.stop()
        self.bench.pass_time(11.0)
        assert self.bench.outcome is not None
        for puppet in self.puppets:
            assert puppet.calls('on_enter') == puppet.calls('on_exit')
            assert (puppet.calls('on_start'), puppet.calls('on_stop')) == (1, 1)
        assert self.bench.clock.next_timer() is None


TestRandomRuns = RandomRun.TestCase
TestRandomRuns.settings = settings(
    max_examples=int(os.environ.get('HFSM_EXAMPLES', '50')),
    stateful_step_count=60,
    deadline=None,
    suppress_health_check=list(HealthCheck),
)

# SPDX-License-Identifier: BSD-3-Clause
"""Random machines under random operations: the engine does what a model does, and keeps its promises at each moment."""

from __future__ import annotations

from collections.abc import Callable
from random import Random

import hypothesis.strategies as st
from hfsm_bench import Bench
from hfsm_model import LIVELOCK, Model
from hfsm_random import Node, Puppet, build, random_machine
from hypothesis import HealthCheck, settings
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from flexbt_onboard.state_machine import ExitReason, OperatableStateMachine

KINDS = {'TRANSITION': 'transition', 'CHOICE': 'choice'}


class Watched(Bench):
    """Checks each transition: that the operator has approved it, or need not."""

    def __init__(self, root: Node, made: OperatableStateMachine, autonomy: int) -> None:
        self.nodes = {node.path: node for node in root.all()}
        self.approved: set[tuple[str, str]] = set()
        self.granted: dict[str, int] = {}
        super().__init__(made, autonomy=autonomy, max_transitions=LIVELOCK)

    def transition(self, path: str, outcome: str, target: str, reason: ExitReason) -> None:
        super().transition(path, outcome, target, reason)
        if self.nodes[path].required[outcome] >= max(self.run.autonomy_of(path), self.granted.get(path, 0)):
            assert (path, outcome) in self.approved, f'{path} was left by {outcome} without approval'
        self.granted.clear()
        self.approved = {one for one in self.approved if not f'{one[0]}/'.startswith(f'{path}/')}

    def set_autonomy(self, level: int, path: str = '') -> str | None:
        """Keeps what was granted: a state that was left while its level allowed it goes on when that is lowered."""
        for node in self.nodes:
            self.granted[node] = max(self.run.autonomy_of(node), self.granted.get(node, 0))
        return super().set_autonomy(level, path)

    def approving(self, path: str, outcome: str, command: Callable[[], str | None]) -> str | None:
        """Give a command that approves of an outcome, unless it is refused."""
        before = set(self.approved)
        self.approved.add((path, outcome))
        refusal = command()
        if refusal is not None:
            self.approved = before
        return refusal


def running(run: RandomRun) -> bool:
    """Whether the run goes on."""
    return run.model.outcome is None


class RandomRun(RuleBasedStateMachine):
    """The operations are those of the world (news, rest, time) and of the operator; after the end it begins again."""

    @initialize(seed=st.integers(0, 2**32), level=st.integers(0, 3))
    def build(self, seed: int, level: int) -> None:
        self.root = random_machine(Random(seed))
        self.nodes = list(self.root.all())
        self.machine, self.puppets = build(self.root)
        self._begin(level)

    def _begin(self, level: int) -> None:
        for puppet in self.puppets:
            puppet.forget()
        self.bench = Watched(self.root, self.machine, level)
        self.model = Model(self.root, level)

    @precondition(lambda self: not running(self))
    @rule(level=st.integers(0, 3))
    def begin_again(self, level: int) -> None:
        self.teardown()
        self._begin(level)

    @precondition(running)
    @rule(number=st.integers(0, 200), here=st.integers(0, 4), choice=st.integers(0, 2))
    def news(self, number: int, here: int, choice: int) -> None:
        puppet = self.puppets[number % len(self.puppets)]
        if here and self.model.active is not None:
            puppet = self._active()
        outcome = puppet.node.outcomes[choice % len(puppet.node.outcomes)]
        puppet.end(outcome)
        self.bench.settle()
        self.model.news(puppet.node, outcome)

    @precondition(lambda self: running(self) and self.model.active is not None)
    @rule()
    def rest(self) -> None:
        puppet = self._active()
        puppet.rest()
        self.bench.settle()
        self.model.rest(puppet.node)

    @precondition(running)
    @rule(seconds=st.sampled_from([1.0, 2.0, 3.0]))
    def pass_time(self, seconds: float) -> None:
        self.bench.pass_time(seconds)
        self.model.pass_time(seconds)

    @precondition(running)
    @rule(level=st.sampled_from([0, 1, 2, 3, 3]), number=st.integers(0, 200))
    def autonomy(self, level: int, number: int) -> None:
        path = self.nodes[number % len(self.nodes)].path if number % 3 else '/'
        refusal = self.bench.set_autonomy(level, path)
        assert (refusal is None) is self.model.set_autonomy(level, path), refusal

    @precondition(lambda self: self.model.decision is not None)
    @rule()
    def confirm(self) -> None:
        self._confirm(0)

    @precondition(lambda self: self.model.decisions > 0)
    @rule(back=st.integers(0, 2))
    def confirm_late(self, back: int) -> None:
        self._confirm(back)

    def _confirm(self, back: int) -> None:
        number = self.model.decisions - back
        _, path, outcome = self.model.decision or ('', '', '')
        refusal = self.bench.approving(path, outcome, lambda: self.bench.confirm(str(number)))
        assert (refusal is None) is self.model.confirm(number), refusal

    @rule(
        number=st.integers(0, 200),
        here=st.integers(0, 3),
        outcome=st.sampled_from([0, 0, 1, 1, 2, 'x']),
        back=st.sampled_from([None, None, None, 0, 1]),
    )
    def force(self, number: int, here: int, outcome: int | str, back: int | None) -> None:
        node = self.nodes[number % len(self.nodes)]
        active = [node for node in self.nodes if f'{self._active_path()}/'.startswith(f'{node.path}/')]
        if here and active:
            node = active[number % len(active)]
        wanted = outcome if isinstance(outcome, str) else node.outcomes[outcome % len(node.outcomes)]
        decision = None if back is None else self.model.decisions - back
        number_text = '' if decision is None else str(decision)
        refusal = self.bench.approving(node.path, wanted, lambda: self.bench.force(node.path, wanted, number_text))
        assert (refusal is None) is self.model.force(node.path, wanted, decision), refusal

    @precondition(running)
    @rule(number=st.integers(0, 9))
    def stop(self, number: int) -> None:
        if number == 0:
            self.bench.stop()
            self.model.stop()

    def _active(self) -> Puppet:
        return next(one for one in self.puppets if one.node is self.model.active)

    def _active_path(self) -> str:
        decided = self.model.decision[1] if self.model.decision is not None else '/'
        return self.model.active.path if self.model.active is not None else decided

    @invariant()
    def agree(self) -> None:
        bench, model = self.bench, self.model
        assert bench.outcome == model.outcome
        assert bench.active == ((model.active.path,) if model.active is not None and model.outcome is None else ())
        shown = [(KINDS[one.kind.name], one.path, one.outcome) for one in bench.run.decisions]
        assert shown == ([] if model.decision is None else [model.decision])
        if shown:
            assert bench.decision.id == str(model.decisions)
        visits = [event for event in bench.trace if event.startswith(('on_enter', 'on_exit'))]
        assert visits == model.events
        assert [(path, outcome, reason.name) for path, outcome, _, reason in bench.transitions] == model.transitions

    @invariant()
    def each_state_is_left_before_the_next_is_entered(self) -> None:
        events = [event.split()[:2] for event in self.bench.trace if event.startswith(('on_enter', 'on_exit'))]
        for number, (callback, path) in enumerate(events):
            assert callback == ('on_enter', 'on_exit')[number % 2]
            assert number % 2 == 0 or path == events[number - 1][1]

    @invariant()
    def the_operator_was_shown_what_is(self) -> None:
        picture = self.bench.pictures[-1]
        assert (picture.active, list(picture.decisions)) == (self.bench.active, self.bench.run.decisions)

    @invariant()
    def another_step_would_change_nothing(self) -> None:
        """Nothing is left that somebody would have to ring for."""
        events, pictures = len(self.bench.trace), len(self.bench.pictures)
        self.bench.run.step()
        assert (len(self.bench.trace), len(self.bench.pictures)) == (events, pictures)

    def teardown(self) -> None:
        if not hasattr(self, 'bench'):
            return
        self.bench.stop()
        self.bench.pass_time(4.0)
        assert self.bench.outcome is not None
        for puppet in self.puppets:
            assert puppet.calls('on_enter') == puppet.calls('on_exit')
            assert (puppet.calls('on_start'), puppet.calls('on_stop')) == (1, 1)
        assert self.bench.clock.next_alarm() is None


TestRandomRuns = RandomRun.TestCase
TestRandomRuns.settings = settings(
    max_examples=70, stateful_step_count=60, deadline=None, suppress_health_check=list(HealthCheck)
)

# SPDX-License-Identifier: BSD-3-Clause
"""The authority to command: one holder at most, whatever operators do, and nobody keeps it by going away."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_common.lifecycle.presence import PresenceToken
from flexbt_common.middleware.received_messages import UNKNOWN_WRITER, reports_writers
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.clock.clock import ManualClock, Timer
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveLog
from flexbt_onboard.commands import authority
from flexbt_onboard.commands.authority import (
    FEW_NAMES,
    NAMES_OF_PARTICIPANT,
    REQUESTS,
    Authority,
    OperatorNames,
)
from flexbt_onboard.errors import CommandRefusedError
from flexbt_onboard.node.executive_parameters import ExecutiveParameters
from flexbt_testing.nodes.executive_bench import ExecutiveBench, behavior_of
from flexbt_testing.nodes.operator import Operator
from flexbt_testing.waiting import wait_until

CLAIM, RELEASE, HAND_OVER, REFUSE, STOP, AUTONOMY = (
    ExecutiveCommand.CLAIM_AUTHORITY,
    ExecutiveCommand.RELEASE_AUTHORITY,
    ExecutiveCommand.HAND_OVER_AUTHORITY,
    ExecutiveCommand.REFUSE_AUTHORITY,
    ExecutiveCommand.STOP,
    ExecutiveCommand.AUTONOMY,
)


def waiting() -> OperatableStateMachine:
    """One state that waits for ever."""
    machine = OperatableStateMachine(outcomes=['done'])
    with machine:
        OperatableStateMachine.add('Wait', EventState(outcomes=['done'], desired_rate=None), {'done': 'done'})
    return machine


class Graph:
    """What the names of operators ask of link and presence, and what they report."""

    def __init__(self) -> None:
        self.there: set[bytes] = set()
        self.silent: set[bytes] = set()
        self.told: list[str] = []
        self.looks = 0
        this: Any = self
        self.names = OperatorNames(this, this, this)

    def node_of(self, participant: bytes) -> str:
        return f'/{participant.decode()}' if participant in self.there else ''

    def has_gone(self, participant: bytes) -> bool:
        self.looks += 1
        return participant in self.silent

    def operators(self, text: str, is_warning: bool) -> None:
        assert is_warning
        self.told.append(text)


@pytest.fixture
def graph() -> Graph:
    return Graph()


def test_of_consoles_that_are_gone_no_names_are_kept_and_of_the_others_all(graph: Graph) -> None:
    graph.there = {b'first'}
    graph.names.check('ann', b'first')
    kept: list[int] = []
    for number in range(4 * FEW_NAMES):
        passing = str(number).encode()
        graph.there = {b'first', passing}
        graph.names.check(f'operator {number}', passing)
        kept.append(len(graph.names._owners))
    assert max(kept) == FEW_NAMES
    with pytest.raises(CommandRefusedError, match="'ann' commands from another console"):
        graph.names.check('ann', passing)


def test_the_names_of_many_consoles_that_are_there_are_all_kept(graph: Graph) -> None:
    consoles = [str(number).encode() for number in range(3 * FEW_NAMES)]
    graph.there = {*consoles}
    for console in consoles:
        graph.names.check(f'operator {console.decode()}', console)
    assert graph.looks <= 2 * len(consoles), 'the more there are, the more seldom it looks who is gone'
    for console in consoles:
        with pytest.raises(CommandRefusedError):
            graph.names.check(f'operator {console.decode()}', b'other')


def test_a_console_with_many_names_keeps_those_that_it_has_used_last(graph: Graph) -> None:
    graph.there = {b'program', b'other'}
    graph.names.check('of the other', b'other')
    names = [f'operator {number}' for number in range(NAMES_OF_PARTICIPANT + 1)]
    for name in (*names[:-1], names[0], names[-1]):
        graph.names.check(name, b'program')
    for name in (*names, 'of the other'):
        if name == names[1]:
            graph.names.check(name, b'third')
        else:
            with pytest.raises(CommandRefusedError):
                graph.names.check(name, b'third')


def test_the_use_of_the_name_of_somebody_else_is_refused_and_told_once(graph: Graph, monkeypatch: Any) -> None:
    monkeypatch.setattr(authority, '_TOLD', 2)
    graph.there = {b'console', b'forger'}
    for name in ('ann', 'bob'):
        graph.names.check(name, b'console')
        graph.names.check(name, UNKNOWN_WRITER)  # of a middleware that does not tell who sends
    graph.names.check('', b'forger')
    for name, participant in (
        ('ann', b'forger'),
        ('ann', b'ghost'),
        ('ann', b'forger'),
        ('bob', b'forger'),
        ('ann', b'ghost'),
        ('ann', b'forger'),
    ):
        with pytest.raises(CommandRefusedError) as refusal:
            graph.names.check(name, participant)
    assert str(refusal.value) == (
        "operator 'ann' commands from another console, /console; end that one, or choose another name "
        '(--operator, FLEXBT_OPERATOR)'
    )
    assert graph.told == [
        f'{node} commands under the name of operator {name!r}, who is at /console; that is refused'
        for node, name in (('/forger', 'ann'), ('a node that is gone', 'ann'), ('/forger', 'bob'), ('/forger', 'ann'))
    ], 'of two warnings it is known that they were given'
    graph.silent = {b'console'}
    graph.names.check('ann', b'forger')
    graph.there = {b'ghost'}
    graph.names.check('ann', b'ghost')


@pytest.fixture
def make_bench() -> Iterator[Callable[[float], ExecutiveBench]]:
    """Make a bench with a timeout of the authority, and closes it."""
    benches: list[ExecutiveBench] = []

    def make(timeout: float) -> ExecutiveBench:
        parameters = ExecutiveParameters(peers=(), authority_timeout=timeout)
        benches.append(ExecutiveBench(behavior_of(waiting), parameters=parameters))
        return benches[-1]

    yield make
    for bench in benches:
        bench.close()


Make = Callable[[float], ExecutiveBench]


def test_only_the_holder_commands_and_everybody_may_stop(make_bench: Make) -> None:
    bench = make_bench(30.0)
    bench.start(operator_id='ann')
    bench.applied(AUTONOMY, autonomy=2, operator_id='bob')  # nobody has the authority
    bench.applied(CLAIM, operator_id='ann')
    for kind in set(range(1, 20)) - {STOP, CLAIM, RELEASE}:
        reason = bench.refused(kind, operator_id='bob', path='/Wait', outcome='done', decision_id='x')
        assert "'ann' has the authority" in reason or 'not supported' in reason, kind
    assert "'ann' has the authority" in bench.refused(AUTONOMY, autonomy=0, operator_id='')
    bench.applied(AUTONOMY, autonomy=3, operator_id='ann')
    assert (bench.status.autonomy, bench.status.authority) == (3, 'ann')
    bench.applied(STOP, operator_id='bob')
    assert bench.wait_idle() == 'preempted'
    assert 'name' in bench.refused(CLAIM, operator_id='')


class _Operator:
    """A console of an operator, as far as the executive sees that it is there."""

    def __init__(self, operator: str) -> None:
        self.runtime = NodeRuntime('console', args=())
        self.token = PresenceToken(self.runtime, operator)


@pytest.fixture
def consoles() -> Iterator[Callable[[str], _Operator]]:
    """Make consoles of operators, and closes them."""
    made: list[_Operator] = []

    def make(operator: str) -> _Operator:
        made.append(_Operator(operator))
        return made[-1]

    yield make
    for console in made:
        console.runtime.close()


Consoles = Callable[[str], _Operator]


def test_a_holder_who_is_gone_loses_the_authority_to_the_first_who_asked_and_is_there(
    make_bench: Make, consoles: Consoles
) -> None:
    bench = make_bench(1.0)
    eve = consoles('eve')
    console = _Operator('ann')
    second = _Operator('ann')
    try:
        bench.wait_for(lambda _status: bench.executive.presence.present >= {'ann', 'eve'}, 'both are there')
        bench.applied(CLAIM, operator_id='ann')
        bench.applied(CLAIM, operator_id='bob')
        bench.applied(CLAIM, operator_id='eve')
        assert list(bench.status.authority_requests) == ['bob', 'eve']
        second.runtime.close()
        bench.wait_for_next_status()
        until = time.monotonic() + 1.6
        bench.wait_for(lambda status: time.monotonic() > until, 'a time that is longer than the timeout')
        assert bench.status.authority == 'ann'  # who only looks is there all the same
    finally:
        console.runtime.close()
    # Bob has no console and says nothing: his request has expired, or he is passed over.
    bench.wait_for(lambda status: status.authority == 'eve', 'passed on')
    assert 'gone for 1 s' in bench.logged("'eve' has the authority").text
    bench.logged("'bob', who asked for the authority, was gone for 1 s")
    bench.wait_for(lambda status: not status.authority_requests, 'expired')
    eve.runtime.close()
    bench.wait_for(lambda status: not status.authority, 'nobody left')
    bench.applied(AUTONOMY, autonomy=0, operator_id='zoe', run_id='')


def test_claims_of_ghosts_are_bounded_and_give_way_to_those_who_are_there(make_bench: Make, consoles: Consoles) -> None:
    bench = make_bench(3600.0)
    bench.applied(CLAIM, operator_id='ann')
    for number in range(REQUESTS):
        bench.applied(CLAIM, operator_id=f'ghost {number}')
    assert f'{REQUESTS} operators ask' in bench.refused(CLAIM, operator_id='one more')
    consoles('bob')
    bench.wait_for(lambda _status: 'bob' in bench.executive.presence.present, 'there')
    bench.applied(CLAIM, operator_id='bob')
    assert len(bench.status.authority_requests) == REQUESTS
    bench.applied(RELEASE, operator_id='ann', run_id='')
    assert bench.status.authority == 'bob'
    # Nobody is there: it is free, and goes to the one of them who comes.
    bench.applied(RELEASE, operator_id='bob', run_id='')
    assert bench.status.authority == ''
    consoles('ghost 7')
    bench.wait_for(lambda status: status.authority == 'ghost 7', 'who has come')


@pytest.mark.skipif(not reports_writers(), reason='rclpy as it is does not tell writers')
def test_a_name_is_that_of_the_console_which_commands_under_it_as_long_as_it_is_there(make_bench: Make) -> None:
    bench = make_bench(3600.0)
    bench.applied(CLAIM, operator_id='ann')
    bench.start(operator_id='ann')
    with NodeRuntime.open('other_console') as runtime:
        other = Operator(runtime, 'ann')
        other.wait_connected()
        wait_until(lambda: 'other_console' in bench.runtime.node.get_node_names(), 'its name')
        reason = other.refused(AUTONOMY, autonomy=0)
        assert "'ann'" in reason and '/console' in reason and '--operator' in reason
        assert 'that is refused' in bench.logged('/other_console commands under the name').text
        other.applied(CLAIM, operator_id='bob')
        other.applied(STOP)  # which anybody may
        bench.wait_idle()
        PresenceToken(runtime, 'bob')
        bench.wait_for(lambda _status: 'bob' in bench.executive.presence.present, 'there')
    # The console has gone: another one has its name at once.
    with NodeRuntime.open('console_of_bob') as runtime:
        again = Operator(runtime, 'bob')
        again.wait_connected()
        again.applied(RELEASE, run_id='')


def test_commands_alone_keep_the_authority(make_bench: Make) -> None:
    timeout = 3.0  # longer than a busy machine takes from one command to the next
    bench = make_bench(timeout)
    bench.applied(CLAIM, operator_id='script')
    end = time.monotonic() + 1.5 * timeout
    while time.monotonic() < end:
        bench.applied(AUTONOMY, autonomy=1, operator_id='script', run_id='')
        bench.wait_for_next_status()
    assert bench.status.authority == 'script'
    bench.wait_for(lambda status: not status.authority, 'lost after a silence')


class Desk:
    """An authority with its surroundings, on a manual clock."""

    def __init__(self) -> None:
        self.steady = ManualClock()
        self.present: set[str] = set()
        self.lines: list[str] = []
        self.events: list[dict[str, Any]] = []
        self.changes = 0
        this: Any = self
        self.authority = Authority(this, this, SECONDS, this, this)

    def post_at(self, when: float, fn: Callable[[], object]) -> Timer:
        return self.steady.call_at(when, lambda: (fn(), None)[1])

    def post_in(self, seconds: float, fn: Callable[[], object]) -> Timer:
        return self.post_at(self.steady.now() + seconds, fn)

    def add_listener(self, listener: Callable[[], None]) -> None:
        self.listener = listener

    def log(self, severity: int, text: str) -> None:
        assert severity == ExecutiveLog.INFO
        self.lines.append(text)

    def event(self, event: str, **fields: Any) -> None:
        self.events.append({'event': event, **fields})

    def changed(self) -> None:
        self.changes += 1

    def do(self, action: str, *who: str) -> bool:
        """Do what :class:`Rules` does; return False if it is refused."""
        if action == 'come or go':
            self.present ^= {*who}
            self.listener()
            return True
        try:
            getattr(self.authority, action)(*who)
        except CommandRefusedError as error:
            self.reason = str(error)
            return False
        return True


SECONDS = 3.0
OPERATORS = ('ann', 'bob', 'eve', 'joe')


class Rules:
    """The rules of the authority, with one second after the other."""

    def __init__(self, most: int) -> None:
        self.most = most
        self.there: set[str] = set()
        self.holder = ''
        self.gone = 0
        self.asking: dict[str, int] = {}
        """Seconds since the holder, and those who ask, have last been there or said anything."""

    def wait(self) -> None:
        self.gone = 0 if self.holder in self.there else self.gone + 1
        self.asking = {one: 0 if one in self.there else gone + 1 for one, gone in self.asking.items()}
        self.asking = {one: gone for one, gone in self.asking.items() if gone < SECONDS}
        if self.holder and self.gone >= SECONDS:
            self._give(self._next())

    def do(self, action: str, who: str, other: str = '') -> bool:
        if action == 'come or go':
            self.there ^= {who}
            if who in self.asking:
                self.asking[who] = 0
            if not self.holder:
                self._give(self._next())
        elif action == 'claim':
            return bool(who) and self._claim(who)
        elif action == 'check':
            if self.holder not in ('', who):
                return False
        elif action == 'release' and who != self.holder:
            return self.asking.pop(who, None) is not None
        elif not who or who != self.holder:
            return False
        elif action == 'release':
            self._give(self._next())
        else:
            self.gone = 0
            if action == 'refuse':
                return self.asking.pop(other, None) is not None
            self._give(other)
        if who == self.holder:
            self.gone = 0
        return True

    def _claim(self, who: str) -> bool:
        if not self.holder or self.holder == who:
            self._give(who)
        elif who not in self.asking and len(self.asking) == self.most:
            ghosts = [one for one in self.asking if one not in self.there]
            if who not in self.there or not ghosts:
                return False
            del self.asking[ghosts[0]]
        if who != self.holder:
            self.asking[who] = 0
        return True

    def _next(self) -> str:
        return next((one for one in self.asking if one in self.there), '')

    def _give(self, who: str) -> None:
        self.asking.pop(who, None)
        self.holder, self.gone = who, 0


ACTIONS = st.one_of(
    st.tuples(st.just('wait'), st.sampled_from('123')),
    st.tuples(st.just('come or go'), st.sampled_from(OPERATORS)),
    st.tuples(st.just('claim'), st.sampled_from(OPERATORS)),
    st.tuples(st.sampled_from(('claim', 'release', 'check')), st.sampled_from(('', *OPERATORS))),
    st.tuples(st.sampled_from(('hand_over', 'refuse')), st.sampled_from(('', *OPERATORS)), st.sampled_from(OPERATORS)),
)


@settings(max_examples=300)
@given(st.integers(0, 4), st.lists(ACTIONS, min_size=20, max_size=40))
def test_whatever_operators_do_the_authority_is_as_the_rules_say(there: int, actions: list[tuple[str, ...]]) -> None:
    desk, rules = Desk(), Rules(most=2)
    desk.present, rules.there = {*OPERATORS[:there]}, {*OPERATORS[:there]}
    state: tuple[str, list[str]] = ('', [])
    with pytest.MonkeyPatch.context() as few:
        few.setattr(authority, 'REQUESTS', rules.most)
        for action, *who in actions:
            if action == 'wait':
                for _ in range(int(who[0])):
                    desk.steady.advance(1.0)
                    rules.wait()
            else:
                assert desk.do(action, *who) is rules.do(action, *who), (action, who)
            before, state = state, (desk.authority.holder, desk.authority.requests)
            assert state == (rules.holder, [*rules.asking]), (action, who)
            if state != before:
                last = {'event': 'authority', 'holder': state[0], 'requests': state[1], 'text': desk.lines[-1]}
                assert desk.events[-1] == last
            assert len(desk.lines) == len(desk.events) == desk.changes


def test_operators_read_why_the_authority_is_with_whom_and_why_a_command_is_refused() -> None:
    desk = Desk()
    desk.do('come or go', 'joe')
    for action, *who in (
        ('claim', 'ann'),
        ('claim', 'bob'),
        ('claim', 'eve'),
        ('claim', 'joe'),
        ('refuse', 'ann', 'bob'),
        ('release', 'eve'),
        ('hand_over', 'ann', 'eve'),
        ('claim', 'ann'),
        ('release', 'eve'),
        ('hand_over', 'joe', 'joe'),
        ('come or go', 'ann'),
        ('hand_over', 'joe', 'ann'),
        ('claim', 'bob'),
        ('release', 'ann'),
        ('come or go', 'bob'),
        ('claim', 'eve'),
        ('come or go', 'bob'),
    ):
        assert desk.do(action, *who), (action, who)
    desk.steady.advance(SECONDS)
    assert desk.lines == [
        "operator 'ann' has the authority to command: claimed it",
        "operator 'bob' asks 'ann' for the authority to command",
        "operator 'eve' asks 'ann' for the authority to command",
        "operator 'joe' asks 'ann' for the authority to command",
        "operator 'ann' refuses 'bob', who asked for the authority to command",
        "operator 'eve' does not ask for the authority to command any more",
        "operator 'eve' has the authority to command: 'ann' handed it over; no console of 'eve' is there, and it ends "
        'after 3 s',
        "operator 'ann' asks 'eve' for the authority to command",
        "operator 'joe' has the authority to command: 'eve' released it",
        "operator 'ann' has the authority to command: 'joe' handed it over",
        "operator 'bob' asks 'ann' for the authority to command",
        "nobody has the authority to command: 'ann' released it; every operator may",
        "operator 'bob' has the authority to command: asked for it, and is there again",
        "operator 'eve' asks 'bob' for the authority to command",
        "nobody has the authority to command: 'bob' was gone for 3 s; every operator may",
        "operator 'eve', who asked for the authority, was gone for 3 s",
    ]
    assert desk.do('claim', 'ann')
    for action, reason, *who in (
        ('check', "operator 'ann' has the authority to command; claim it, and wait until it is handed over", 'bob'),
        ('claim', 'only an operator with a name can claim the authority; set operator_id', ''),
        ('release', "'eve' does not have the authority to command, and did not ask for it", 'eve'),
        ('refuse', "'eve' does not have the authority to command, so cannot give it away", 'eve', 'bob'),
        ('refuse', "'eve' does not ask for the authority to command", 'ann', 'eve'),
    ):
        assert not desk.do(action, *who)
        assert desk.reason == reason

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
from flexbt_common.middleware.received_messages import reports_writers
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_msgs.msg import ExecutiveCommand
from flexbt_onboard.commands.authority import FEW_NAMES, REQUESTS, OperatorNames
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
    """What the names of operators ask of link and presence."""

    def __init__(self) -> None:
        self.there: set[bytes] = set()

    def node_of(self, participant: bytes) -> str:
        return '/console' if participant in self.there else ''

    def has_gone(self, participant: bytes) -> bool:
        return False


def test_of_consoles_that_are_gone_no_names_are_kept_and_of_the_others_all() -> None:
    graph: Any = Graph()
    operators = OperatorNames(graph, graph, graph)
    graph.there = {b'first'}
    operators.check('ann', b'first')
    kept: list[int] = []
    for number in range(4 * FEW_NAMES):
        passing = str(number).encode()
        graph.there = {b'first', passing}
        operators.check(f'operator {number}', passing)
        kept.append(len(operators._owners))
    assert max(kept) <= FEW_NAMES + 1
    with pytest.raises(CommandRefusedError, match="'ann' commands from another console"):
        graph.operators = lambda *_, **__: None
        operators.check('ann', passing)


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


OPERATORS = ('ann', 'bob', 'eve')
ACTIONS = st.lists(
    st.tuples(
        st.sampled_from((CLAIM, RELEASE, HAND_OVER, REFUSE, AUTONOMY)), st.sampled_from(OPERATORS), st.integers(0, 2)
    ),
    max_size=12,
)


def test_any_sequence_of_claims_is_as_the_rules_say(make_bench: Make, consoles: Consoles) -> None:
    bench = make_bench(3600.0)
    for operator in OPERATORS:
        consoles(operator)
    bench.wait_for(lambda _status: bench.executive.presence.present >= set(OPERATORS), 'all are there')

    @settings(max_examples=25)
    @given(ACTIONS)
    def check(actions: list[tuple[int, str, int]]) -> None:
        holder, asking = '', []
        for kind, who, other in actions:
            fields: dict[str, Any] = {'operator_id': who, 'run_id': '', 'autonomy': 1}
            grantee = OPERATORS[other]
            if kind in (HAND_OVER, REFUSE):
                fields['grantee'] = grantee
            is_allowed = {
                CLAIM: True,
                RELEASE: who == holder or who in asking,
                HAND_OVER: who == holder,
                REFUSE: who == holder and grantee in asking,
                AUTONOMY: holder in ('', who),
            }[kind]
            (bench.applied if is_allowed else bench.refused)(kind, **fields)
            if kind == CLAIM and not holder:
                holder = who
            elif kind == CLAIM and who != holder and who not in asking:
                asking.append(who)
            elif kind == RELEASE and who == holder:
                holder = asking.pop(0) if asking else ''
            elif kind == RELEASE and is_allowed:
                asking.remove(who)
            elif kind == REFUSE and is_allowed:
                asking.remove(grantee)
            elif kind == HAND_OVER and is_allowed:
                holder = grantee
                asking = [one for one in asking if one != grantee]
            assert (bench.status.authority, list(bench.status.authority_requests)) == (holder, asking)
        for who in (*asking, holder):
            if who:
                bench.applied(RELEASE, operator_id=who, run_id='')

    check()

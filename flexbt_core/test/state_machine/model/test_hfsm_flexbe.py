# SPDX-License-Identifier: BSD-3-Clause
"""What FlexBE's own tests of its core demand (flexbe_core 2.3.3), in our terms: test_core.py and test_exceptions.py.

An outcome that waits for the operator, "no outcome and a request" there, is a pending decision here; a state is run
when something has happened, where FlexBE ticks it. Where this engine differs on purpose, the test says so.
"""

from __future__ import annotations

from typing import Any

import pytest

from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.definition import Child
from flexbt_core.state_machine.model.userdata import MachineError, UserData
from flexbt_testing.state_machines.bench import Bench, Do, Scripted, machine


def subject(autonomy: int = Autonomy.Full) -> tuple[Scripted, Bench]:
    """FlexBE's fixture: one state with two outcomes that require levels 1 and 2, in a machine that repeats both."""
    state = Scripted('done', 'failed')
    levels = {'done': Autonomy.Low, 'failed': Autonomy.High}
    made = machine(Child('subject', state, {'done': 'done', 'failed': 'failed'}, levels), outcomes=['done', 'failed'])
    return state, Bench(made, autonomy=autonomy)


def results(bench: Bench) -> tuple[str | None, list[str]]:
    """Return the outcome that was taken, and those that are asked for."""
    return bench.outcome, [decision.outcome for decision in bench.run.decisions]


class TestOperatableState:
    def test_a_level_above_the_required_one_passes_without_a_request(self) -> None:
        state, bench = subject(Autonomy.Full)
        state.end('failed')
        bench.settle()
        assert results(bench) == ('failed', [])

    def test_a_level_that_is_not_above_it_gives_a_request(self) -> None:
        state, bench = subject(Autonomy.High)
        state.end('failed')
        bench.settle()
        assert results(bench) == (None, ['failed'])
        assert bench.decision.path == '/subject'

    def test_what_requires_less_passes_at_the_same_level(self) -> None:
        state, bench = subject(Autonomy.High)
        state.end('done')
        bench.settle()
        assert results(bench) == ('done', [])

    def test_a_raised_level_releases_the_request(self) -> None:
        state, bench = subject(Autonomy.Off)
        state.end('done')
        bench.settle()
        assert results(bench) == (None, ['done'])
        assert bench.set_autonomy(Autonomy.Full) is None
        assert results(bench) == ('done', [])

    def test_differs_a_request_is_not_withdrawn_by_the_state_which_is_frozen(self) -> None:
        """FlexBE goes on executing the state, which may change its mind under the operator's finger."""
        state, bench = subject(Autonomy.High)
        state.end('failed')
        bench.settle()
        state.outcome = None
        state.wake()
        bench.settle()
        assert results(bench) == (None, ['failed'])
        assert state.calls('execute') == 2


class TestPreemptableState:
    def test_a_stop_ends_the_machine_and_leaves_no_state_active(self) -> None:
        _, bench = subject()
        bench.stop()
        assert (bench.outcome, bench.active) == ('preempted', ())

    def test_differs_the_state_is_left_in_order(self) -> None:
        """FlexBE calls on_stop only."""
        state, bench = subject()
        bench.stop()
        assert state.trace[-2:] == ['on_exit PREEMPTED', 'on_stop']

    def test_a_stop_holds_for_its_run_only(self) -> None:
        state, bench = subject()
        bench.stop()
        made = machine(Child('subject', state, {'done': 'ended', 'failed': 'ended'}))
        again = Bench(made)
        assert again.active == ('/subject',)


class TestManuallyTransitionableState:
    def test_an_outcome_is_forced(self) -> None:
        state, bench = subject()
        executed = state.calls('execute')
        assert bench.force('/subject', 'failed') is None
        assert results(bench) == ('failed', [])
        assert state.calls('execute') == executed, 'a forced outcome skips execute'

    def test_another_target_is_refused_and_changes_nothing(self) -> None:
        _, bench = subject()
        assert bench.force('/invalid', 'failed') == "there is no state '/invalid'"
        assert results(bench) == (None, [])

    def test_differs_a_state_of_the_same_name_elsewhere_is_not_meant(self) -> None:
        """FlexBE goes by the name alone, so that a late command for one state fires on another."""
        places = [machine(Child('Work', Scripted(), {'done': 'ended'})) for _ in range(2)]
        bench = Bench(machine(Child('I1', places[0], {'ended': 'I2'}), Child('I2', places[1], {'ended': 'ended'})))
        assert bench.force('/I1/Work', 'done') is None
        assert bench.force('/I1/Work', 'done') == '/I1/Work is not active (active: /I2/Work)'
        assert bench.active == ('/I2/Work',)


class TestCrossCombinations:
    def test_forcing_works_at_the_lowest_level(self) -> None:
        _, bench = subject(Autonomy.Off)
        assert bench.force('/subject', 'failed') is None
        assert results(bench) == ('failed', [])

    def test_a_stop_works_at_the_lowest_level_and_while_something_is_requested(self) -> None:
        state, bench = subject(Autonomy.Off)
        state.end('done')
        bench.settle()
        assert results(bench) == (None, ['done'])
        bench.stop()
        assert results(bench) == ('preempted', [])


class TestUserData:
    def test_keys_are_read_remapped_and_outputs_appear_around(self) -> None:
        def work(_: Scripted, userdata: UserData) -> None:
            seen.append(userdata.data_in)
            userdata.data_out = 2

        seen: list[Any] = []
        state = Scripted(outcome='done', do={'execute': work}, input_keys=['data_in'], output_keys=['data_out'])
        bench = Bench(
            machine(
                Child('One', state, {'done': 'ended'}, {}, {'data_in': 'given', 'data_out': 'made'}),
                defaults={'given': 1},
            )
        )
        assert (seen, bench.run.userdata()) == ([1], {'given': 1, 'made': 2})

    def test_a_nested_machine_has_data_of_its_own_and_hands_out_what_it_declares(self) -> None:
        def work(_: Scripted, userdata: UserData) -> None:
            seen.append((userdata.own, userdata.outer))
            userdata.kept, userdata.shown, userdata.both = 'kept', 'shown', userdata.both + 1

        seen: list[Any] = []
        keys = {'input_keys': ['own', 'outer'], 'output_keys': ['kept', 'shown'], 'io_keys': ['both']}
        inner = machine(
            Child('Work', Scripted(outcome='done', do={'execute': work}, **keys), {'done': 'ended'}),  # type: ignore[arg-type]
            input_keys=['outer'],
            output_keys=['shown'],
            io_keys=['both'],
            defaults={'own': 1},
        )
        last: list[Any] = []
        reader = Scripted(outcome='done', do={'execute': read('shown', last)}, input_keys=['shown'])
        bench = Bench(
            machine(
                Child('Inner', inner, {'ended': 'Last'}, {}, {'outer': 'given', 'both': 'counter'}),
                Child('Last', reader, {'done': 'ended'}),
                defaults={'given': 2, 'counter': 7},
            )
        )
        assert (seen, last) == ([(1, 2)], ['shown'])
        assert bench.run.userdata() == {'given': 2, 'counter': 8, 'shown': 'shown'}


def read(key: str, into: list[Any]) -> Do:
    return lambda _, userdata: into.append(userdata[key])


def change(_: Scripted, userdata: UserData) -> None:
    userdata.table['new'] = 1


class TestExceptions:
    @pytest.mark.parametrize(
        ('do', 'error'),
        [
            (lambda *_: 'invalid', 'StateError'),
            (read('undeclared', []), 'UserDataError'),
            (lambda _, userdata: userdata.__setitem__('undeclared', 1), 'UserDataError'),
            (read('absent', []), 'UserDataError'),
        ],
    )
    def test_the_error_is_kept_and_the_state_is_not_tried_again(self, do: Do, error: str) -> None:
        state = Scripted(do={'execute': do}, input_keys=['absent', 'table'])
        bench = Bench(machine(Child('A', state, {'done': 'ended'}), input_keys=['absent', 'table']))
        assert bench.outcome == 'error'
        assert f'{error}: ' in bench.faults[0][1]
        assert state.calls('execute') == 1

    def test_differs_a_transition_to_nowhere_is_found_before_the_machine_runs(self) -> None:
        inner = machine(Child('A', Scripted(), {'done': 'nowhere'}))
        with pytest.raises(MachineError, match="/Inner/A: the outcome 'done' leads to 'nowhere'"):
            Bench(machine(Child('Inner', inner, {'ended': 'ended'})))

    def test_differs_an_input_is_a_copy_so_that_changing_it_in_place_changes_nothing(self) -> None:
        state = Scripted(outcome='done', do={'execute': change}, input_keys=['table'])
        bench = Bench(machine(Child('A', state, {'done': 'ended'}), input_keys=['table']), userdata={'table': {}})
        assert (bench.outcome, bench.run.userdata()) == ('ended', {'table': {}})

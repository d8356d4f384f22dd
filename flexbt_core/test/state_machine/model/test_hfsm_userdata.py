# SPDX-License-Identifier: BSD-3-Clause
"""Userdata in a run: declared keys, remapping through levels, scopes, copies, and what is refused."""

from __future__ import annotations

import copy
import itertools
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.definition import Child
from flexbt_core.state_machine.model.state_host import Severity
from flexbt_core.state_machine.model.userdata import Scope, UserData, UserDataError
from flexbt_testing.state_machines.bench import Bench, Do, Scripted, machine, passing


def read(key: str, into: list[Any]) -> Do:
    return lambda _, userdata: into.append(userdata[key])


def write(**values: Any) -> Do:
    def act(_: Scripted, userdata: UserData) -> None:
        for key, value in values.items():
            userdata[key] = value

    return act


def reader(key: str, into: list[Any], **options: Any) -> Scripted:
    return Scripted('done', 'failed', outcome='done', do={'execute': read(key, into)}, input_keys=[key], **options)


def writer(**values: Any) -> Scripted:
    return Scripted('done', 'failed', outcome='done', do={'execute': write(**values)}, output_keys=list(values))


ENDS = {'done': 'ended', 'failed': 'ended'}

NAMES = ('goal', 'target', 'goal', 'place')
"""A key on each level, from the state outwards. The name of the inmost one comes again further out, for another key."""


def wired(state: Scripted, *, inputs: bool) -> OperatableStateMachine:
    """Return a state in three machines, each of which remaps its key."""
    made: Scripted | OperatableStateMachine = state
    for own, outer in itertools.pairwise(NAMES):
        place = Child('In', made, {'done': 'done', 'failed': 'failed'}, {}, {own: outer})
        keys = {'input_keys' if inputs else 'output_keys': [outer]}
        made = machine(place, outcomes=['done', 'failed'], **keys)  # type: ignore[arg-type]
    assert isinstance(made, OperatableStateMachine)
    return made


def test_an_input_is_read_through_three_levels_of_remapping() -> None:
    seen: list[Any] = []
    bench = Bench(wired(reader('goal', seen), inputs=True), userdata={'place': 'kitchen', 'goal': 'a', 'target': 'b'})
    assert (bench.outcome, seen) == ('done', ['kitchen'])


def test_an_output_is_written_through_three_levels_of_remapping() -> None:
    bench = Bench(wired(writer(goal='kitchen'), inputs=False))
    assert (bench.outcome, bench.run.userdata()) == ('done', {'place': 'kitchen'})


def test_the_operator_sees_the_values_of_active_machines_their_writers_and_what_is_still_to_be_written() -> None:
    def made() -> OperatableStateMachine:
        waits = Scripted(do={'on_enter': write(inner=2)}, input_keys=['place'], output_keys=['inner'])
        inside = machine(Child('W', waits, {'done': 'ended'}), input_keys=['place', 'more'], defaults={'more': 0})
        return machine(
            Child('A', writer(goal=1), ENDS | {'done': 'M'}),
            Child('M', inside, {'ended': 'N'}, remapping={'place': 'goal'}),
            Child('N', reader('goal', []), ENDS, remapping={'goal': 'late'}),
            input_keys=['late'],
        )

    bench = Bench(made(), userdata={'late': 0}, start=False)
    run = bench.run
    assert (run.unwritten('/M'), run.unwritten('/M/W')) == (['goal'], [])
    run.start()
    bench.settle()
    assert run.userdata_of_machines() == {'/': {'late': 0, 'goal': 1}, '/M': {'more': 0, 'inner': 2}}
    assert run.writers_of_machines() == {'/': {'goal': ('/A', 0.0)}, '/M': {'inner': ('/M/W', 0.0)}}
    assert (run.unwritten('/M'), run.unwritten('/M/W'), run.unwritten('/N')) == ([], [], [])
    assert run.unwritten('/Nowhere/W') == []


@pytest.mark.parametrize(
    ('do', 'words'),
    [
        (lambda _, userdata: userdata.secret, "/Work: cannot read userdata key 'secret'; declare it in input_keys"),
        (lambda _, userdata: userdata['secret'], "/Work: cannot read userdata key 'secret'; declare it in input_keys"),
        (write(secret=1), "/Work: cannot write userdata key 'secret'; declare it in output_keys"),
        (lambda _, userdata: setattr(userdata, 'secret', 1), "/Work: cannot write userdata key 'secret'; declare it in "
         'output_keys'),
        (write(given=1), "/Work: cannot write userdata key 'given'; declare it in output_keys"),
        (lambda _, userdata: userdata.missing, "/Work: userdata key 'missing' (remapped to 'absent') has no value; "
         'nobody has written it'),
        (lambda _, userdata: setattr(userdata, '_private', 1), '_private: userdata keys do not begin with an '
         'underscore'),
        (lambda _, userdata: userdata._private, '_private'),
    ],
)  # fmt: skip
def test_what_is_not_declared_or_not_there_is_a_fault_that_says_what_to_do(do: Do, words: str) -> None:
    state = Scripted('done', 'failed', outcome='done', do={'execute': do}, input_keys=['given', 'missing'])
    root = machine(
        Child('Work', state, {'done': 'done', 'failed': 'failed'}, {}, {'missing': 'absent'}),
        outcomes=['done', 'failed'],
        input_keys=['given', 'absent'],
    )
    bench = Bench(root, userdata={'given': 1, 'secret': 2})
    assert bench.outcome == 'failed'
    ((path, text),) = bench.faults
    assert path == '/Work'
    assert text.startswith('execute raised:\nTraceback')
    assert text.splitlines()[-1].endswith(f'Error: {words}')
    assert bench.run.userdata() == {'given': 1, 'secret': 2}


def test_what_there_is_can_be_listed() -> None:
    def look(_: Scripted, userdata: UserData) -> None:
        seen.extend([list(userdata), len(userdata), 'a' in userdata, 'b' in userdata, 'c' in userdata, repr(userdata)])

    seen: list[Any] = []
    state = Scripted(outcome='done', do={'execute': look}, input_keys=['a', 'b', 'd'])
    bench = Bench(
        machine(Child('One', state, {'done': 'ended'}, {}, {'a': 'z'}), input_keys=['z', 'b', 'c', 'd']),
        userdata={'z': 'zebra', 'c': 3, 'd': 4},
    )
    assert bench.outcome == 'ended'
    assert seen == [['a', 'd'], 2, True, False, False, "UserData(a='zebra', d=4)"]


def test_what_is_only_read_is_a_copy_and_what_is_written_too_is_the_thing_itself() -> None:
    def change(_: Scripted, userdata: UserData) -> None:
        userdata.items.append(1)
        seen.append(list(userdata.items))

    seen: list[Any] = []
    mine = Scripted(outcome='done', do={'execute': change}, input_keys=['items'])
    ours = Scripted(outcome='done', do={'execute': change}, io_keys=['items'])
    bench = Bench(
        machine(Child('Mine', mine, {'done': 'Ours'}), Child('Ours', ours, {'done': 'ended'}), input_keys=['items']),
        userdata={'items': [0]},
    )
    assert bench.outcome == 'ended'
    assert seen == [[0, 1], [0, 1]]
    assert bench.run.userdata() == {'items': [0, 1]}


def test_machines_that_are_active_at_once_see_what_each_writes_to_a_key_that_both_read_and_write() -> None:
    def add(_: Scripted, userdata: UserData) -> None:
        userdata.count += 1

    def counting(wait: Scripted) -> OperatableStateMachine:
        first, then = (Scripted(outcome='done', do={'execute': add}, io_keys=['count']) for _ in range(2))
        waits = Child('Wait', wait, {'done': 'Then'})
        children = Child('First', first, {'done': 'Wait'}), waits, Child('Then', then, {'done': 'ended'})
        inner = machine(*children, io_keys=['count'])
        return machine(Child('In', inner, {'ended': 'ended'}, {}, {'count': 'own'}), io_keys=['own'])

    waits = Scripted(), Scripted()
    both = machine(
        Child('One', counting(waits[0]), {}, {}, {'own': 'shared'}),
        Child('Other', counting(waits[1]), {}, {}, {'own': 'shared'}),
        conditions=[('ended', [('One', 'ended'), ('Other', 'ended')])],
        io_keys=['shared'],
    )
    bench = Bench(machine(Child('Both', both, {'ended': 'ended'}, {}, {'shared': 'total'}), defaults={'total': 0}))
    for wait in waits:
        wait.end('done')
        bench.settle()
    assert (bench.outcome, bench.run.userdata()) == ('ended', {'total': 4})


def test_one_key_of_the_machine_as_input_and_output_of_a_state_can_be_read_after_it_was_written() -> None:
    def update(_: Scripted, userdata: UserData) -> None:
        before = userdata['before']
        userdata['after'] = [*before, 2]
        seen.append((before, userdata['before'], userdata['after']))

    seen: list[Any] = []
    state = Scripted(outcome='done', do={'execute': update}, input_keys=['before'], output_keys=['after'])
    bench = Bench(
        machine(Child('One', state, {'done': 'ended'}, {}, {'before': 'items', 'after': 'items'}), io_keys=['items']),
        userdata={'items': [1]},
    )
    assert bench.outcome == 'ended'
    assert seen == [([1], [1, 2], [1, 2])]


class Driver:
    """An object of users, which only one may have."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.moves: list[str] = []


def numbers() -> Iterator[int]:
    yield from range(3)


@pytest.mark.parametrize('make', [Driver, threading.Lock, numbers, lambda: sys, lambda: {'inner': [Driver()]}])
def test_differs_a_value_that_cannot_be_copied_is_handed_on_itself_with_one_warning(make: Callable[[], Any]) -> None:
    value, seen = make(), list[Any]()
    inner = machine(Child('In', reader('thing', seen), ENDS), input_keys=['thing'])
    bench = Bench(
        machine(
            Child('One', inner, {'ended': 'Two'}, {}, {'thing': 'shared'}),
            Child('Two', reader('thing', seen), ENDS, {}, {'thing': 'shared'}),
            input_keys=['shared'],
        ),
        userdata={'shared': value},
    )
    assert (bench.outcome, bench.faults) == ('ended', [])
    assert [one is value for one in seen] == [True, True]
    ((severity, path, text),) = bench.lines
    assert (severity, path) == (Severity.WARN, '/One/In')
    assert text.startswith(f"the {type(value).__name__} in userdata key 'thing' cannot be copied (")


class Unprintable(Exception):
    def __str__(self) -> str:
        raise ValueError


@pytest.mark.parametrize(
    ('error', 'reason'),
    [(ValueError('it is open'), 'it is open'), (ValueError(), 'ValueError'), (Unprintable(), 'Unprintable')],
)
def test_the_warning_says_why_a_value_cannot_be_copied(error: Exception, reason: str) -> None:
    class Handle:
        def __deepcopy__(self, memo: object) -> Handle:
            raise error

    state = reader('lock', [])
    bench = Bench(nested_in_root(state), userdata={'lock': Handle()})
    ((_, _, text),) = bench.lines
    assert text == (
        f"the Handle in userdata key 'lock' cannot be copied ({reason}): states get the object itself, and see what "
        'others change in it'
    )


def test_a_default_that_cannot_be_copied_is_that_of_each_visit() -> None:
    driver, seen = Driver(), list[Any]()
    made = machine(Child('One', reader('driver', seen), ENDS))
    made.userdata['driver'] = driver
    assert Bench(made).outcome == 'ended'
    assert seen == [driver]


def test_who_declares_a_value_that_cannot_be_copied_as_an_output_too_is_not_warned() -> None:
    lock = threading.Lock()
    seen: list[Any] = []
    sharing = Scripted('done', 'failed', outcome='done', do={'execute': read('lock', seen)}, io_keys=['lock'])
    bench = Bench(nested_in_root(sharing), userdata={'lock': lock})
    assert (bench.outcome, bench.lines) == ('done', [])
    assert seen == [lock]


def nested_in_root(state: Scripted) -> OperatableStateMachine:
    return machine(
        Child('One', state, {'done': 'done', 'failed': 'failed'}), outcomes=['done', 'failed'], input_keys=['lock']
    )


def loop(inner: OperatableStateMachine, visits: int) -> OperatableStateMachine:
    """Return the machine again and again."""
    left = [visits]

    def decide(state: Scripted, _: Any) -> str:
        left[0] -= 1
        return 'again' if left[0] else 'done'

    return machine(
        Child('Inner', inner, {'ended': 'Check'}),
        Child('Check', Scripted('again', 'done', do={'execute': decide}), {'again': 'Inner', 'done': 'ended'}),
        output_keys=['result'],
        defaults={'result': None},
    )


def test_each_visit_of_a_machine_and_each_run_begins_with_its_defaults() -> None:
    def append(_: Scripted, userdata: UserData) -> None:
        userdata.items.append(len(userdata.items))
        seen.append(list(userdata.items))

    seen: list[Any] = []
    state = Scripted(outcome='done', do={'execute': append}, io_keys=['items'])
    inner = machine(Child('One', state, {'done': 'ended'}), defaults={'items': []})
    made = loop(inner, 3)
    assert Bench(made).outcome == 'ended'
    assert seen == [[0]] * 3
    state = Scripted(outcome='done', do={'execute': append}, io_keys=['items'])
    root = machine(Child('One', state, {'done': 'ended'}), defaults={'items': []})
    seen.clear()
    for _ in range(2):
        assert Bench(root).run.userdata() == {'items': [0]}


def test_each_visit_of_a_state_has_copies_of_its_own() -> None:
    def append(_: Scripted, userdata: UserData) -> str:
        userdata.items.append(len(userdata.items))
        seen.append(list(userdata.items))
        return 'again' if len(seen) < 3 else 'done'

    seen: list[Any] = []
    state = Scripted('again', 'done', do={'execute': append}, input_keys=['items'])
    bench = Bench(
        machine(Child('One', state, {'again': 'One', 'done': 'ended'}), input_keys=['items']), userdata={'items': []}
    )
    assert seen == [[0]] * 3
    assert bench.run.userdata() == {'items': []}


def test_what_a_concurrent_state_changes_in_place_is_seen_at_the_next_execution() -> None:
    def append(_: Scripted, userdata: UserData) -> str | None:
        userdata.items.append(len(userdata.items))
        return 'done' if len(userdata.items) == 3 else None

    def read(_: Scripted, userdata: UserData) -> str | None:
        userdata.items.append('mine')
        seen.append(list(userdata.items))
        return 'done' if len(seen) == 3 else None

    seen: list[Any] = []
    writer = Scripted('done', do={'execute': append}, io_keys=['items'], rate=10.0)
    reader = Scripted('done', do={'execute': read}, input_keys=['items'], rate=10.0)
    both = [(label, 'done') for label in 'AB']
    bench = Bench(
        machine(Child('A', writer), Child('B', reader), conditions=[('ended', both)], io_keys=['items']),
        userdata={'items': []},
    )
    bench.pass_time(0.5)
    assert bench.outcome == 'ended'
    assert seen == [[0, 'mine'], [0, 1, 'mine'], [0, 1, 2, 'mine']]


def test_a_default_yields_to_what_is_around_the_machine() -> None:
    seen: list[Any] = []
    place = Child('One', reader('speed', seen), {'done': 'ended', 'failed': 'ended'})
    inner = machine(place, input_keys=['speed'], defaults={'speed': 1})
    root = machine(Child('Inner', inner, {'ended': 'ended'}, {}, {'speed': 'limit'}), input_keys=['limit'])
    assert Bench(root, userdata={'limit': 5}).outcome == 'ended'
    assert Bench(root).outcome == 'ended'
    assert seen == [5, 1]


def test_the_default_of_an_output_is_what_the_machine_gives_when_no_state_writes_it() -> None:
    """The check of the machine counts it as written, so whoever reads it has to find it."""
    seen: list[Any] = []
    quiet = machine(Child('Pass', passing(), {'done': 'ended'}), output_keys=['result'], defaults={'result': 'nothing'})
    last = reader('found', seen)
    root = machine(
        Child('Quiet', quiet, {'ended': 'Last'}, {}, {'result': 'found'}),
        Child('Last', last, {'done': 'ended', 'failed': 'ended'}),
    )
    assert Bench(root).outcome == 'ended'
    assert seen == ['nothing']


def test_what_a_machine_does_not_declare_stays_in_it() -> None:
    inner = machine(
        Child('Write', writer(shown=1, hidden=2), {'done': 'ended', 'failed': 'ended'}), output_keys=['shown']
    )
    bench = Bench(machine(Child('Inner', inner, {'ended': 'ended'}), output_keys=['shown']))
    assert bench.run.userdata() == {'shown': 1}


def test_a_state_that_is_left_sees_its_userdata_in_on_exit() -> None:
    state = Scripted(do={'on_exit': write(last='seen')}, output_keys=['last'])
    bench = Bench(machine(Child('One', state, {'done': 'ended'}), output_keys=['last']))
    bench.stop()
    assert bench.run.userdata() == {'last': 'seen'}


def test_a_value_given_at_the_start_is_taken_over_a_default() -> None:
    seen: list[Any] = []
    made = machine(Child('One', reader('a', seen), {'done': 'ended', 'failed': 'ended'}), defaults={'a': 1})
    assert Bench(made, userdata={'a': 2}).outcome == 'ended'
    assert Bench(made).outcome == 'ended'
    assert seen == [2, 1]


def test_defaults_of_a_machine_are_attributes_or_items() -> None:
    userdata = machine().userdata
    userdata.goal = 'dock'
    userdata['speed'] = 2
    assert (userdata.goal, userdata['goal'], userdata.speed) == ('dock', 'dock', 2)
    assert ('goal' in userdata, 'late' in userdata, userdata.values()) == (True, False, {'goal': 'dock', 'speed': 2})
    assert copy.copy(userdata).values() == userdata.values()
    for key in ('late', '_late'):
        with pytest.raises(AttributeError, match=f"^the machine has no default for userdata key '{key}'$"):
            getattr(userdata, key)
    for key in ('', '_x'):
        with pytest.raises(UserDataError, match=f"^'{key}' cannot be a userdata key: it is empty or begins with an"):
            userdata[key] = 1


def test_a_scope_has_its_own_keys_and_those_inputs_that_have_a_value() -> None:
    outer = Scope({'a': 1})
    scope = Scope({'own': 2}, outer, {'given': 'a', 'late': 'z'})
    assert [key in scope for key in ('own', 'given', 'late', 'a', 'none')] == [True, True, False, False, False]
    assert (scope.get('own'), scope.get('given'), scope.visible()) == (2, 1, {'given': 1, 'own': 2})
    for key, missing in (('late', 'z'), ('a', 'a'), ('none', 'none')):
        with pytest.raises(KeyError, match=f"^'{missing}'$"):
            scope.get(key)

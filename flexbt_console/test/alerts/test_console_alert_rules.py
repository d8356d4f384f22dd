# SPDX-License-Identifier: BSD-3-Clause
"""Rules of calls: each thing is called once, in its time, on a simulated clock and over restarts; and their file."""

from __future__ import annotations

import dataclasses
import math
import os
import traceback
from collections import Counter
from datetime import UTC, datetime, time
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_console.alerts import escalation
from flexbt_console.alerts.escalation import (
    FIND_SECONDS,
    MOST_THINGS,
    Escalation,
    SeenNeed,
    SeenRobot,
    seen,
)
from flexbt_console.alerts.rules import AlertRules, QuietHours, Rule, Severity, Step, load_rules
from flexbt_console.alerts.store import Store
from flexbt_console.errors import RefusedError, UsageError
from flexbt_console.mirror.fleet import Urgency, overview_of
from flexbt_console.mirror.freshness import LinkState
from flexbt_console.mirror.records import (
    Decision,
    DecisionKind,
    ExecutiveSnapshot,
    ExecutiveState,
    IncidentReport,
    StopGuard,
)
from flexbt_console.mirror.view import View

DAY = 86_400.0
CONDITIONS = (Urgency.ALARM, Urgency.DECISION, Urgency.FAILED, Urgency.DEGRADED)
ROBOTS = ('/a', '/b')
CONTACTS = ('anna', 'ben', 'cleo')


def rules_of(*rules: Rule, quiet: QuietHours | None = None) -> AlertRules:
    addresses = {contact: (f'json://{contact}',) for contact in CONTACTS}
    return AlertRules(rules, addresses, 'http://station:8465', zone=UTC, quiet=quiet)


def rule(*steps: Step, conditions: tuple[Urgency, ...] = CONDITIONS, robots: str = '*', **more: Any) -> Rule:
    severity = more.get('severity', Severity.WARNING)
    return Rule(conditions, (robots,), severity, steps, more.get('over', False), 1)


steps = st.lists(
    st.builds(
        Step, st.integers(0, 6).map(lambda n: 600.0 * n), st.sets(st.sampled_from(CONTACTS), min_size=1).map(tuple)
    ),
    min_size=1,
    max_size=3,
)
some_rules = st.lists(
    st.builds(
        lambda steps, conditions, robots, severity, over: Rule(
            tuple(conditions), (robots,), severity, tuple(steps), over, 1
        ),
        steps,
        st.sets(st.sampled_from(CONDITIONS), min_size=1),
        st.sampled_from(['*', '/a', '/b']),
        st.sampled_from([*Severity]),
        st.booleans(),
    ),
    min_size=1,
    max_size=3,
)
quiet_hours = st.none() | st.builds(
    QuietHours, st.sampled_from([time(20), time(3)]), st.sampled_from([time(4), time(22)]), st.sampled_from([*Severity])
)
things = st.lists(
    st.tuples(
        st.sampled_from(ROBOTS),
        st.sampled_from(CONDITIONS),
        st.integers(0, 100),  # begins, in periods
        st.integers(1, 100),  # lasts
        st.none() | st.integers(0, 100),  # is acknowledged
    ),
    max_size=6,
)
PERIOD = 600.0


class Model:
    """What has to happen to one thing, written down on its own: when which contacts are called, and told the end."""

    def __init__(self, thing: tuple[Any, ...], rules: AlertRules) -> None:
        robot, condition, begins, lasts, acknowledged = thing
        self.calls: Counter[tuple[int, str, bool]] = Counter()
        found = [one for one in rules.rules if condition in one.conditions and one.robots[0] in ('*', robot)]
        if not found:
            return
        told: dict[str, None] = {}
        reference, number = begins, 0
        for tick in range(begins, begins + lasts):
            hour = (tick * PERIOD % DAY) / 3600.0
            is_quiet = False
            if rules.quiet is not None and found[0].severity < rules.quiet.unless:
                begin, end = rules.quiet.begin.hour, rules.quiet.end.hour
                is_quiet = begin <= hour < end if begin < end else not end <= hour < begin
            if is_quiet or (acknowledged is not None and tick >= acknowledged):
                continue
            while number < len(found[0].steps) and (tick - reference) * PERIOD >= found[0].steps[number].after:
                self.calls.update((tick, contact, False) for contact in found[0].steps[number].contacts)
                told.update(dict.fromkeys(found[0].steps[number].contacts))
                reference, number = tick, number + 1
        if found[0].over:
            self.calls.update((begins + lasts, contact, True) for contact in told)


@settings(max_examples=40, deadline=None)
@given(things, some_rules, quiet_hours, st.sets(st.integers(0, 210)), st.booleans())
def test_each_thing_is_called_once_in_its_time_as_the_model_says_also_over_restarts(
    tmp_path_factory: pytest.TempPathFactory,
    things: list[tuple[Any, ...]],
    rules: list[Rule],
    quiet: QuietHours | None,
    restarts: set[int],
    loses_sight: bool,
) -> None:
    known = rules_of(*rules, quiet=quiet)
    expected: Counter[tuple[int, str, bool, int]] = Counter()
    for index, thing in enumerate(things):
        for (tick, contact, is_over), count in Model(thing, known).calls.items():
            expected[tick, contact, is_over, index] += count
    file = tmp_path_factory.mktemp('alerts') / 'alerts.db'
    store = Store(file)
    got: Counter[tuple[int, str, bool, int]] = Counter()
    number_of: dict[int, int] = {}
    for tick in range(202):
        if tick in restarts:
            store.close()
            store = Store(file)
            store.memory.resume(tick * PERIOD)
        memory = store.memory
        by_number = {index: number for number, index in number_of.items()}
        memory.acknowledge(
            {by_number[index]: 'eve' for index, two in enumerate(things) if two[4] == tick and index in by_number}
        )
        there = {index: one for index, one in enumerate(things) if one[2] <= tick < one[2] + one[3]}
        look = [
            SeenRobot(
                robot,
                True,
                tuple(
                    SeenNeed(one[1], f'key {index}', 0.0, f'thing {index}')
                    for index, one in there.items()
                    if one[0] == robot
                ),
            )
            for robot in ROBOTS
        ]
        if loses_sight and tick % 7 == 3 and not any(tick in (one[2], one[2] + one[3]) for one in things):
            look = [SeenRobot(one.name, False, ()) for one in look]  # nothing is known, nothing is over
        memory.step(tick * PERIOD, datetime.fromtimestamp(tick * PERIOD, UTC), look, known)
        for one in memory.things.values():
            number_of[one.id] = int(one.text.split()[1])
            if things[number_of[one.id]][4] is not None and things[number_of[one.id]][4] <= tick:
                memory.acknowledge({one.id: 'eve'})  # what is acknowledged before it is there
        for call in list(memory.calls.values()):
            index = number_of[call.thing]
            got[tick, call.contact, call.is_over, index] += 1
            del memory.calls[call.id]
        assert store.save() == ''
    store.close()
    expected = Counter({key: count for key, count in expected.items() if key[0] < 202})
    late = {index for index, one in enumerate(things) if one[4] is not None and one[4] <= one[2]}
    # One that was acknowledged before it began cannot be: it is acknowledged after its first step.
    assert {key: count for key, count in got.items() if key[3] not in late} == {
        key: count for key, count in expected.items() if key[3] not in late
    }


def test_the_clock_may_be_set_while_the_program_does_not_run(tmp_path: Path) -> None:
    known = rules_of(rule(Step(600.0, ('anna',)), Step(600.0, ('ben',))))
    look = [SeenRobot('/a', True, (SeenNeed(Urgency.DECISION, 'k', 0.0, 'asks'),))]
    local = datetime(2026, 1, 1, tzinfo=UTC)
    store = Store(tmp_path / 'alerts.db')
    store.memory.step(10_000.0, local, look, known)
    store.memory.step(10_600.0, local, look, known)
    assert [call.contact for call in store.memory.calls.values()] == ['anna']
    assert store.save() == ''
    store.close()
    store = Store(tmp_path / 'alerts.db')
    store.memory.resume(5_000.0)  # an hour back
    for seconds in (5_000.0, 5_599.0):
        store.memory.step(seconds, local, look, known)
        assert [call.contact for call in store.memory.calls.values()] == ['anna']
    store.memory.step(5_600.0, local, look, known)
    assert [call.contact for call in store.memory.calls.values()] == ['anna', 'ben']
    store.close()


def test_a_call_whose_attempt_fails_after_the_end_says_that_it_is_over() -> None:
    memory, rules = Escalation(), rules_of(rule(Step(0.0, ('anna',))))
    need = SeenNeed(Urgency.DECISION, 'k', 0.0, 'asks')
    memory.step(1000.0, datetime.fromtimestamp(1000.0, UTC), [SeenRobot('/a', True, (need,))], rules)
    (call,) = memory.calls.values()
    call.is_begun = True
    memory.step(1060.0, datetime.fromtimestamp(1060.0, UTC), [SeenRobot('/a', True, ())], rules)
    assert memory.calls[call.id].title == '/a waits for a decision (over since 00:17)'


def test_each_address_that_has_the_call_is_told_the_end_whatever_another_one_of_its_contact_has() -> None:
    both = {'anna': ('json://reached', 'json://not-reached')}
    memory = Escalation()
    rules = dataclasses.replace(rules_of(rule(Step(0.0, ('anna',)), over=True)), addresses=both)
    need = SeenNeed(Urgency.DECISION, 'k', 0.0, 'asks')
    memory.step(1000.0, datetime.fromtimestamp(1000.0, UTC), [SeenRobot('/a', True, (need,))], rules)
    delivered = next(call for call in memory.calls.values() if call.address == 0)
    del memory.calls[delivered.id]
    memory.step(1060.0, datetime.fromtimestamp(1060.0, UTC), [SeenRobot('/a', True, ())], rules)
    assert {call.address: call.title for call in memory.calls.values()} == {
        0: '/a waits for a decision: over since 00:17',
        1: '/a waits for a decision (over since 00:17)',
    }


@pytest.mark.parametrize('is_begun', [False, True])
def test_calls_to_an_address_that_is_never_reached_do_not_pile_up(
    is_begun: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The service, which does not answer, may have them or not."""
    monkeypatch.setattr(escalation, 'MOST_UNSAID', 20)
    memory, rules = Escalation(), rules_of(rule(Step(0.0, ('anna',)), over=True))
    local = datetime(2026, 1, 1, tzinfo=UTC)
    lasts = SeenNeed(Urgency.FAILED, 'k', 0.0, 'has failed')
    for number in range(50):
        for needs in ((lasts, SeenNeed(Urgency.DECISION, f'{number}', 0.0, f'asks {number}')), (lasts,)):
            memory.step(1000.0 + number, local, [SeenRobot('/a', True, needs)], rules)
            for call in memory.calls.values():
                call.is_begun = is_begun
    assert len(memory.calls) == 20
    first, *_, last = memory.calls.values()
    assert first.title == '/a has failed' and 'asks 49' in last.lines, 'what is there, and the latest'


def test_a_robot_that_was_heard_before_a_restart_and_is_not_found_is_silent(tmp_path: Path) -> None:
    known = rules_of(rule(Step(0.0, ('anna',)), conditions=(Urgency.UNREACHABLE,)))
    local, there = datetime(2026, 1, 1, tzinfo=UTC), [SeenRobot(name, True, ()) for name in ROBOTS]
    store = Store(tmp_path / 'alerts.db')
    store.memory.step(0.0, local, there, known)
    assert store.save() == ''
    store.close()
    store = Store(tmp_path / 'alerts.db')
    for seconds in (50_000.0, 50_000.0 + FIND_SECONDS - 1.0):
        store.memory.step(seconds, local, there[:1], known)
        assert not store.memory.calls
    for seconds in (50_000.0 + FIND_SECONDS, 60_000.0):
        store.memory.step(seconds, local, there[:1], known)
        assert [call.title for call in store.memory.calls.values()] == ['/b is silent']
    store.memory.step(60_001.0, local, there, known)
    assert not store.memory.things
    store.memory.step(60_002.0, local, there[:1], dataclasses.replace(known, robots=('/a',)))
    assert not store.memory.things  # nobody wants to know any more
    store.close()


def test_an_incident_is_called_about_once_though_its_black_box_comes_and_goes(tmp_path: Path) -> None:
    """The robot goes on meanwhile, and the program is started again."""
    known = rules_of(rule(Step(0.0, ('anna',)), Step(600.0, ('ben',)), conditions=(Urgency.INCIDENT,), over=True))
    local, report = (
        datetime(2026, 1, 1, tzinfo=UTC),
        IncidentReport('2026_stop', '/incidents/2026_stop', 'STOP by cleo'),
    )
    runs = ExecutiveSnapshot('e', 1, state=ExecutiveState.RUNNING, run_id='r')
    with_it = View(LinkState.LIVE, 0.1, snapshot=runs, incidents=(report,))
    assert overview_of('/a', with_it).urgency is Urgency.RUNS, 'it is over'
    there, without = ([seen(overview_of('/a', one))] for one in (with_it, View(LinkState.LIVE, 0.1, snapshot=runs)))
    store = Store(tmp_path / 'alerts.db')
    for seconds, look in ((0.0, there), (1.0, without), (2.0, there), (3.0, without)):
        store.memory.step(seconds, local, look, known)
        assert store.save() == ''
        store.close()
        store = Store(tmp_path / 'alerts.db')
    (call,) = store.memory.calls.values()
    assert call.title == '/a has an incident' and call.lines[0] == '/incidents/2026_stop: STOP by cleo'
    assert store.memory.acknowledge({call.thing: 'ben'}) == [call.thing]
    for seconds, look in ((700.0, without), (701.0, there), (2 * DAY - 1.0, there), (2 * DAY, without)):
        store.memory.step(seconds, local, look, known)
        assert len(store.memory.calls) == 1, 'neither called again, nor told that it is over'
    assert not store.memory.things
    store.close()


def test_needs_of_any_length_and_number_are_bounded() -> None:
    known, memory = rules_of(rule(Step(0.0, ('anna',)))), Escalation()
    long, now = 'x' * 10_000_000, datetime(2026, 1, 1, tzinfo=UTC)
    decisions = tuple(
        Decision(f'{index}{long}', DecisionKind.TRANSITION, long, long, (long,) * 3, prompt=long, since=math.nan)
        for index in range(2)
    )
    snapshot = ExecutiveSnapshot(long, 1, state=ExecutiveState.RUNNING, run_id=long, behavior=long, decisions=decisions)
    robot = seen(overview_of('/a', View(LinkState.LIVE, 0.1, snapshot=snapshot)))
    memory.step(0.0, now, [robot], known)
    assert len(memory.things) == len(memory.calls) == 2
    for call in memory.calls.values():
        assert sum(map(len, [call.title, *call.lines])) < 5_000
    robots = [
        SeenRobot(f'/r{number}', True, tuple(SeenNeed(Urgency.DECISION, str(key), 0.0, 'asks') for key in range(90)))
        for number in range(20)
    ]
    memory.step(1.0, now, robots, known)
    assert (len(memory.things), memory.left_out) == (MOST_THINGS, 1800 - MOST_THINGS)  # those of /a made room
    called = len(memory.calls)
    memory.step(2.0, now, robots, known)
    assert len(memory.calls) == called


def test_a_robot_needs_what_the_list_of_robots_says() -> None:
    asked = Decision('d1', DecisionKind.TRANSITION, '/Drive', 'done', ('done', 'failed'), 2, since=70.0)
    runs = ExecutiveSnapshot('e', 1, state=ExecutiveState.RUNNING, run_id='r', stamp=100.0, decisions=(asked,))
    robot = seen(overview_of('/a', View(LinkState.LIVE, 0.1, snapshot=runs, guard=StopGuard(holding=True))))
    assert [(one.condition, one.seconds) for one in robot.needs] == [(Urgency.DECISION, 30.0), (Urgency.DEGRADED, 0.0)]
    assert robot.needs[0].text == '/Drive wants done (auto at Full)'
    interrupted = ExecutiveSnapshot('e', 1, state=ExecutiveState.INTERRUPTED, run_id='r', behavior='Patrol')
    (need,) = seen(overview_of('/a', View(LinkState.LIVE, 0.1, snapshot=interrupted))).needs
    assert need.condition is Urgency.FAILED and '"resume" continues it' in need.text
    silent = seen(overview_of('/a', View(LinkState.LOST, 9.0, snapshot=runs)))
    assert not silent.is_live and [one.condition for one in silent.needs] == [Urgency.UNREACHABLE]
    assert seen(overview_of('/a', View(LinkState.LOST, None, listening=True))).needs == ()


def test_a_message_says_what_where_since_when_what_to_do_and_has_the_link() -> None:
    asked = Decision('e7 3', DecisionKind.TRANSITION, '/Drive', 'done', ('done', 'failed'), 2, since=40.0)
    runs = ExecutiveSnapshot('e', 1, state=ExecutiveState.RUNNING, run_id='r', stamp=100.0, decisions=(asked,))
    robot, memory = seen(overview_of('/a', View(LinkState.LIVE, 0.1, snapshot=runs))), Escalation()
    memory.step(1_000.0, datetime(2026, 1, 1, 12, 0, tzinfo=UTC), [robot], rules_of(rule(Step(0.0, ('anna',)))))
    (call,) = memory.calls.values()
    assert call.title == '/a waits for a decision'
    assert call.lines == [
        '/Drive wants done (auto at Full)',
        'Choices: 1 done*  2 failed',
        'Since 2026-01-01 11:59 UTC',
        'Answer on the page, or with "console confirm", "force" or "input".',
        'http://station:8465/?robot=/a&decision=e7%203',
        'To acknowledge, enter on the page: alerts acknowledge 1',
    ]


# The file.

GOOD = """\
contacts: people.yaml
page: http://station:8465/
robots: [a, /b]
time_zone: Europe/Berlin
quiet_hours: {from: 22:00, to: '06:00'}
rules:
  - when: [decision, failed]
    robots: /a*
    for: 1.5 min
    call: [anna, ben]
    then: [{after: 2 h, call: cleo}]
    over: true
  - {when: decision, call: anna, severity: critical}
"""
SECRET = 'slack://SECRETA/SECRETB/SECRETC'  # noqa: S105 of nobody
PEOPLE = f'anna: {SECRET}\nben: ["json://u:SECRETD@host/SECRETE"]\n'


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv('FLEXBT_CONTACT_CLEO', 'json://SECRETF json://SECRETG')
    people = tmp_path / 'people.yaml'
    people.write_text(PEOPLE)
    people.chmod(0o600)
    (tmp_path / 'alerts.yaml').write_text(GOOD)
    return tmp_path


def problems(folder: Path) -> str:
    with pytest.raises(UsageError) as caught:
        load_rules(folder / 'alerts.yaml')
    assert 'SECRET' not in str(caught.value)
    return str(caught.value)


def test_the_file_is_read(folder: Path) -> None:
    rules = load_rules(folder / 'alerts.yaml')
    first, second = rules.rules
    assert first == Rule(
        (Urgency.DECISION, Urgency.FAILED),
        ('/a*',),
        Severity.WARNING,
        (Step(90.0, ('anna', 'ben')), Step(7200.0, ('cleo',))),
        True,
        7,
    )
    assert (second.severity, second.robots, rules.robots) == (Severity.CRITICAL, ('*',), ('/a', '/b'))
    assert rules.addresses['cleo'] == ('json://SECRETF', 'json://SECRETG')
    assert 'SECRET' not in repr(rules)
    assert rules.page == 'http://station:8465'
    assert rules.is_held(Severity.WARNING, datetime(2026, 1, 1, 5, 59))
    assert not rules.is_held(Severity.WARNING, datetime(2026, 1, 1, 6, 0))
    assert not rules.is_held(Severity.CRITICAL, datetime(2026, 1, 1, 23, 0))


def test_a_robot_of_a_rule_needs_no_slash(folder: Path) -> None:
    (folder / 'alerts.yaml').write_text(GOOD.replace('robots: /a*', "robots: [a, '*x']"))
    assert load_rules(folder / 'alerts.yaml').rules[0].robots == ('/a', '*x')


@pytest.mark.parametrize(
    ('old', 'new', 'problem'),
    [
        ('when: decision', 'when: descision', "13: when: 'descision': expected moved or decision"),
        ('severity', 'severty', "13: a rule cannot have 'severty'; did you mean 'severity'?"),
        ('critical', 'bad', "13: severity: 'bad': expected info or warning or critical"),
        ('call: cleo', 'call: clio', "11: call: there is no contact 'clio'; write it into the file of contacts"),
        ('call: cleo', f'call: {SECRET}', '11: call: give names of contacts; addresses belong into the file'),
        ('1.5 min', '1.5 mins', "9: for: '1.5 mins' is no time such as 30 s, 5 min or 2 h"),
        ('22:00', '25:00', "5: from: '25:00' is no time of the day such as 22:00"),
        ('22:00', "'06:00'", '5: quiet_hours: "from" and "to" are the same time'),
        ('Berlin', 'Berlino', "4: time_zone: 'Europe/Berlino' is not known"),
        ('8465/', '8465/#token=SECRET', '2: page: leave out name, password, token'),
        ('http://station', 'station', '2: page: give the address of the page: http or https, the computer and'),
        ('[a, /b]', '[a-b]', "3: robots: 'a-b' is not a namespace of ROS"),
        ('people.yaml', 'persons.yaml', 'persons.yaml cannot be read: No such file or directory'),
        ('people.yaml', SECRET, '1: contacts: give the name of a file, and write addresses there'),
        ('over: true', 'over: yes', "12: over: 'yes': expected true or false"),
        ('robots: /a*', "robots: '*'", '13: the rule is never used'),
        ('robots: /a*', 'robots: /c*', '7: the rule is never used: its robots are none of /a, /b'),
        (GOOD, '', '1: the text is empty'),
        (GOOD, 'page: http://a', '1: the file needs "rules"'),
        (GOOD, 'rules: []', '1: rules: nothing is there, so nobody would be called'),
        (GOOD, '[', '1: no YAML'),
    ],
)
def test_what_is_wrong_with_the_file_is_told_with_its_line(folder: Path, old: str, new: str, problem: str) -> None:
    (folder / 'alerts.yaml').write_text(GOOD.replace(old, new))
    assert problem in problems(folder)


@given(st.data())
def test_no_mistake_in_the_files_tells_a_secret(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    """Lines are lost, doubled, cut, moved, with characters of YAML between; addresses are anywhere among the rules."""
    folder = tmp_path_factory.mktemp('files')
    texts = {'alerts.yaml': GOOD, 'people.yaml': f'{PEOPLE}cleo: [{SECRET}]\n'}
    marks = ['', '\n', '\t', ': ', '- ', '[', '}', '!', '&a ', '*a', '"', '%', '\0', '\x85']
    for _ in range(data.draw(st.integers(1, 4))):
        name = data.draw(st.sampled_from(sorted(texts)))
        text = texts[name]
        at, to = sorted(data.draw(st.tuples(st.integers(0, len(text)), st.integers(0, len(text)))))
        put = data.draw(st.sampled_from(marks))
        texts[name] = text[:at] + put + (text[to:] if data.draw(st.booleans()) else text[at:])
    for at in data.draw(st.lists(st.integers(0, len(texts['alerts.yaml'])), max_size=3)):
        texts['alerts.yaml'] = texts['alerts.yaml'][:at] + SECRET + texts['alerts.yaml'][at:]
    for file, text in texts.items():
        (folder / file).write_text(text)
        (folder / file).chmod(0o600)
    try:
        load_rules(folder / 'alerts.yaml', {})
    except UsageError as error:
        assert 'SECRET' not in ''.join(traceback.format_exception(error))


def test_only_its_owner_may_read_the_contacts(folder: Path) -> None:
    people = folder / 'people.yaml'
    for mode in (0o640, 0o604, 0o620):
        people.chmod(mode)
        assert f'has addresses, which are secrets, and mode {mode:o}; do chmod 600' in problems(folder)
    people.chmod(0o600)
    people.unlink()
    people.mkdir()
    assert 'it is a directory' in problems(folder)
    people.rmdir()
    people.write_text(PEOPLE + f'dora: {SECRET}' + 'S' * 5_000)
    people.chmod(0o600)
    assert 'people.yaml:3: dora needs an address, or a list of them, of up to 4000 characters' in problems(folder)
    people.write_text(PEOPLE * 100_000)
    assert 'people.yaml is longer than 1000000 bytes' in problems(folder)
    people.unlink()
    os.mkfifo(people, 0o600)
    assert 'it is a pipe or device' in problems(folder)


# The memory.


def test_a_file_is_used_by_one_program_and_survives_damage(tmp_path: Path) -> None:
    store = Store(tmp_path / 'alerts.db')
    assert (tmp_path / 'alerts.db').stat().st_mode & 0o777 == 0o600
    with pytest.raises(RefusedError, match=r'is used by another "console alerts" \(process \d+\)'):
        Store(tmp_path / 'alerts.db')
    known = rules_of(rule(Step(0.0, ('anna',))))
    look = [SeenRobot('/a', True, (SeenNeed(Urgency.DECISION, 'k', 0.0, 'asks'),))]
    store.memory.step(0.0, datetime(2026, 1, 1, tzinfo=UTC), look, known)
    assert store.save() == ''
    store.close()
    data = bytearray((tmp_path / 'alerts.db').read_bytes())
    for damage in (data[: len(data) // 2], data[:50], b'\xff' * len(data), data.replace(b'"robot"', b'"robut"')):
        (tmp_path / 'alerts.db').write_bytes(damage)
        store = Store(tmp_path / 'alerts.db')
        assert store.memory.things == {} and store.set_aside
        assert Path(store.set_aside).read_bytes() == damage
        store.close()

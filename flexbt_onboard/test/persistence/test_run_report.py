# SPDX-License-Identifier: BSD-3-Clause
"""Figures of a run: against a random run whose times are known, and from the event log of a real one."""

from __future__ import annotations

import itertools
import json
import os
import random
import socket
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from contextlib import nullcontext
from email.message import Message
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar, cast
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexbt_core.skills.skill import Outcome, Skill
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_msgs.msg import ExecutiveCommand
from flexbt_onboard.node.executive_parameters import ExecutiveParameters
from flexbt_onboard.persistence import run_report
from flexbt_onboard.persistence.run_metrics import RunMetrics, metrics_of, read_events
from flexbt_onboard.persistence.run_report import as_json, as_text, main, timeline
from flexbt_onboard.persistence.run_spans import ended_runs, spans_of
from flexbt_testing.nodes.executive_bench import ExecutiveBench, behavior_of
from flexbt_testing.waiting import DEADLINE, wait_until


def parsed(picture: str) -> ElementTree.Element:
    """Return the picture, which has to be well-formed."""
    return ElementTree.fromstring(picture)  # noqa: S314 - our own


PATHS = ['/A', '/B', '/M/C', '/M/D', '/M/N/E']


def random_run(seed: int) -> tuple[list[dict[str, Any]], dict[str, float], dict[str, int], float]:
    """Events of a run of states one after the other; time and visits by path, and the time of waiting."""
    source = random.Random(seed)
    now, waiting = 100.0, 0.0
    total: dict[str, float] = {}
    visits: dict[str, int] = {}
    events: list[dict[str, Any]] = []

    def note(event: str, **fields: Any) -> None:
        events.append({'time': now, 'stamp': now, 'event': event, 'run': 'r', **fields})

    note('started', behavior='B', by='ann')
    path = None
    for number in range(source.randint(0, 30)):
        following = source.choice(PATHS)
        if path is not None:
            note('left', path=path, outcome='done', target=following, reason='outcome')
            parents = [machine for machine in ('/M/N', '/M') if path.startswith(machine + '/')]
            for machine in parents:
                if not following.startswith(machine + '/'):
                    note('left', path=machine, outcome='done', target=following, reason='outcome')
        around = ['/M', '/M/N'][: following.count('/') - 1]
        for one in (following, *around):
            is_new = one == following or path is None or not path.startswith(one + '/')
            visits[one] = visits.get(one, 0) + is_new
        path = following
        note('entered', path=path)
        stay = source.choice([0.0, 0.5, 2.0])
        now += stay
        for one in (path, *around):
            total[one] = total.get(one, 0.0) + stay
        if source.random() < 0.4:
            note('waiting', decision=str(number), path=path, kind='transition', outcome='done')
            wait = source.choice([0.25, 4.0])
            now += wait
            waiting += wait
            for one in (path, *around):
                total[one] += wait
            note('decided', decision=str(number))
    note('ended', outcome='finished', message='')
    return events, total, visits, waiting


@given(st.integers(0, 10_000))
def test_times_visits_and_waiting_are_those_of_the_run(seed: int) -> None:
    events, total, visits, waiting = random_run(seed)
    (run,) = metrics_of(events)
    found = {one.path: one for one in run.paths() if one.path != '/'}
    assert {path: one.total for path, one in found.items()} == pytest.approx(total)
    assert {path: one.visits for path, one in found.items()} == visits
    assert run.waiting == pytest.approx(waiting)
    assert sum(one.waiting for one in found.values()) == pytest.approx(waiting)
    assert run.duration == pytest.approx(sum(found[path].total for path in found if path in PATHS))
    picture = parsed(timeline(run))
    bars = [one for one in picture.iter() if one.tag.endswith('rect') and len(one)]  # those with a tooltip
    shown = [one.get('class') for one in picture.iter() if one.tag.endswith(('rect', 'line')) and not len(one)]
    assert {kind for kind in shown if kind not in ('back', 'grid')} == {bar.get('class') for bar in bars}  # the legend
    assert len(bars) == len(run.visits) + len(run.waits)
    assert all(float(bar.get('x', 0)) + float(bar.get('width', 0)) <= 260 + 900 + 1 for bar in bars)


def test_a_crash_ends_what_was_active_and_the_run_may_go_on_later(monkeypatch: pytest.MonkeyPatch) -> None:
    def event(time: float, event: str, **fields: Any) -> dict[str, Any]:
        return {'time': time, 'stamp': time, 'event': event, **fields}

    story = [
        event(0.0, 'started', run='r', behavior='B', by='ann'),
        event(1.0, 'entered', run='r', path='/A'),
        event(2.0, 'waiting', run='r', decision='d', path='/A', kind='choice'),
        event(60.0, 'executive', state='started'),
        event(61.0, 'resumed', run='r', behavior='B', by='bob'),
        event(61.0, 'entered', run='r', path='/A'),
        event(63.0, 'left', run='r', path='/A', outcome='done', target='=finished', reason='forced'),
        event(63.0, 'ended', run='r', behavior='B', outcome='finished', message=''),
    ]

    def followed(events: list[dict[str, Any]]) -> list[RunMetrics]:
        tail = SimpleNamespace(stdout=[json.dumps(one) for one in events])
        monkeypatch.setattr(subprocess, 'Popen', lambda *_, **__: nullcontext(tail))
        return list(ended_runs(Path('log.jsonl')))

    for metrics in (metrics_of, followed):
        (run,) = metrics(story)
        of_a = next(one for one in run.paths() if one.path == '/A')
        assert (of_a.visits, of_a.total, run.outcome, run.by) == (2, 3.0, 'finished', 'ann')
        assert [visit.outcome for visit in run.visits if visit.path == '/A'] == ['', 'done']
        (rest,) = metrics(story[4:])  # as of a log whose older files are gone
        assert (rest.behavior, rest.by, rest.duration) == ('B', 'bob', 2.0)


class Ask(EventState):
    def __init__(self) -> None:
        super().__init__(outcomes=['done', 'out'], desired_rate=None)

    def execute(self, userdata: Any) -> str:
        return 'done'


def asking() -> OperatableStateMachine:
    machine = OperatableStateMachine(outcomes=['finished'])
    with machine:
        OperatableStateMachine.add('Ask', Ask(), {'done': 'Ask', 'out': 'finished'}, autonomy={'done': Autonomy.Full})
    return machine


def test_the_report_of_a_real_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bench = ExecutiveBench(
        behavior_of(asking, 'Ask <&> me'), parameters=ExecutiveParameters(peers=(), event_log_directory=str(tmp_path))
    )
    try:
        for _ in range(2):
            run_id = bench.start('Ask <&> me', operator_id='ann')
            decision = bench.wait_for(lambda status: status.decisions, 'decision')[0]
            bench.applied(ExecutiveCommand.CONFIRM, decision_id=decision.id, operator_id='eve\x1b[31m')
            bench.applied(ExecutiveCommand.FORCE, path='/Ask', outcome='out', operator_id='ann')
            bench.wait_idle()
        bench.applied(ExecutiveCommand.NOTE, text='a \x1b[31m scratch', operator_id='ann')  # for the run that has ended
    finally:
        bench.close()
    file = str(tmp_path / 'onboard_executive.jsonl')
    assert main([file, '--list']) == 0
    assert len(capsys.readouterr().out.splitlines()) == 2
    assert main([str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert 'Ask <&> me: finished' in text
    assert '\x1b' not in text
    assert 'CONFIRM 1, FORCE 1, NOTE 1' in text
    assert 'ann: NOTE a \\e[31m scratch (applied)' in text
    assert main([file, '--json', '--run', run_id[:8]]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told['commands'] == {'CONFIRM': 1, 'FORCE': 1, 'NOTE': 1}
    assert [(one['path'], one['visits'], one['outcomes']) for one in told['states']] == [
        ('/', 1, {'finished': 1}),
        ('/Ask', 2, {'done': 1, 'out': 1}),
    ]
    assert told['waiting'] > 0.0
    assert main([file, '--svg', str(tmp_path / 'run.svg')]) == 0
    capsys.readouterr()
    picture = parsed((tmp_path / 'run.svg').read_text())
    assert [one.get('class') for one in picture.iter() if one.tag.endswith('line') and one.get('class') == 'who']
    assert main([file, '--run', 'nonsense']) == 1
    capsys.readouterr()
    assert main([str(tmp_path / 'missing.jsonl')]) == 2
    assert capsys.readouterr().err == f'run_report: {tmp_path}/missing.jsonl: No such file or directory\n'
    assert main(['/dev/zero']) == 2
    assert 'run_report: /dev/zero: it is a pipe or device' in capsys.readouterr().err


def test_without_a_file_it_is_of_the_executive_that_ran_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv('HOME', str(tmp_path))
    assert main([]) == 2
    assert 'has no event log' in capsys.readouterr().err
    names = ['domain_1/robot.onboard_executive', 'domain_2/onboard_executive.1', 'domain_2/onboard_executive']
    for age, name in enumerate(names):
        file = tmp_path / '.ros' / 'flexbt' / f'{name}.jsonl'
        file.parent.mkdir(parents=True, exist_ok=True)
        event = {'time': 1.0, 'stamp': 1.0, 'event': 'started', 'run': name, 'behavior': name, 'by': 'ann'}
        file.write_text(json.dumps(event) + '\n')
        os.utime(file, (100 + age, 100 + age))
    assert main(['--list']) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == names[1:]
    os.utime(tmp_path / '.ros' / 'flexbt' / f'{names[0]}.jsonl', (200, 200))
    assert main(['--list']) == 0
    assert names[0] in capsys.readouterr().out
    incident = tmp_path / '.ros' / 'flexbt' / 'incidents' / 'one' / 'records'
    incident.mkdir(parents=True)
    (incident / 'copy.jsonl').write_text(json.dumps({'event': 'started', 'run': 'copied', 'time': 1.0, 'stamp': 1.0}))
    assert main(['--list']) == 0
    assert names[0] in capsys.readouterr().out
    assert main(['--list', str(incident.parent)]) == 0
    assert 'copied' in capsys.readouterr().out


def test_a_run_without_any_event_has_a_report_as_well() -> None:
    empty = RunMetrics('r')
    assert as_text(empty)
    assert as_json(empty)['duration'] == 0.0
    parsed(timeline(empty))


def test_what_comes_after_the_end_is_not_of_the_run() -> None:
    """A command that is refused as too late makes the run no longer; the result of one that ended it may be late."""
    kinds: list[dict[str, Any]] = [
        {'event': 'started', 'behavior': 'B', 'by': 'ann', 'at': 1.0},
        {'event': 'ended', 'outcome': 'preempted', 'at': 3.0},
        {'event': 'command', 'command': 'STOP', 'effect': 'applied', 'at': 3.5},
        {'event': 'command', 'command': 'CONFIRM', 'effect': 'refused', 'at': 60.0},
    ]
    (run,) = metrics_of({**kind, 'run': 'r', 'stamp': kind['at']} for kind in kinds)
    assert run.duration == 2.0
    assert [(one.command, one.time) for one in run.interventions] == [('STOP', 3.0)]


def test_waits_are_told_by_their_causes() -> None:
    def event(time: float, name: str, **fields: Any) -> dict[str, Any]:
        return {'event': name, 'stamp': time, 'time': time, 'run': 'r', **fields}

    answer = {'command': 'CONFIRM', 'effect': 'applied'}
    (run,) = metrics_of(
        [
            event(0.0, 'started', behavior='B'),
            event(1.0, 'waiting', decision='d1', path='/A', kind='transition'),
            event(1.0, 'waiting', decision='d2', path='/B', kind='transition'),
            event(9.0, 'decided', decision='d1'),
            event(9.0, 'command', decision='d1', wait_queue=0.0, wait_interaction=3.0, **answer),
            event(20.0, 'decided', decision='d2'),
            event(20.1, 'command', decision='d2', wait_queue=3.0, wait_interaction=2.0, **answer),
            event(21.0, 'waiting', decision='d3', path='/A', kind='transition'),
            event(25.0, 'decided', decision='d3'),
            event(26.0, 'ended', outcome='done'),
        ]
    )
    causes = run.wait_causes()
    assert causes == {'queue': 3.0, 'unnoticed': 5.0 + 14.0, 'interaction': 5.0, 'not measured': 4.0}
    assert sum(causes.values()) == sum(wait.end - wait.begin for wait in run.waits)


def test_an_input_after_a_restart_of_the_executive_has_its_own_causes() -> None:
    """A restarted executive numbers its inputs anew. The result of a command may come before or after the decision."""

    def event(time: float, name: str, **fields: Any) -> dict[str, Any]:
        return {'event': name, 'stamp': time, 'time': time, 'run': 'r', **fields}

    def asked(time: float, *measured: float) -> list[dict[str, Any]]:
        given = dict(zip(('wait_queue', 'wait_interaction'), measured, strict=False))
        answers = [
            event(time + 4.0, 'decided', decision='input-1'),
            event(time + 4.0, 'command', decision='input-1', effect='applied', **given),
        ]
        return [
            event(time, 'waiting', decision='input-1', path='/A', kind='input'),
            *(answers if 1.0 in measured else answers[::-1]),
            event(time + 5.0, 'executive', state='started'),
            event(time + 6.0, 'resumed', behavior='B'),
        ]

    story = [event(0.0, 'started', behavior='B'), *asked(1.0, 1.0, 2.0), *asked(10.0), *asked(20.0, 0.0, 3.0)]
    (run,) = metrics_of(story)
    assert [(wait.queue, wait.interaction) for wait in run.waits] == [(1.0, 2.0), (None, None), (0.0, 3.0)]


@pytest.mark.parametrize('offset', [0.0, -100.0])
def test_that_the_clock_was_set_counts_in_no_time(offset: float) -> None:
    """The stamps are of the computer's clock, or of a simulated one."""

    def event(steady: float, name: str, *, step: float = 0.0, **fields: Any) -> dict[str, Any]:
        stamp = 10.0 + steady + (offset or step)
        return {'event': name, 'stamp': stamp, 'time': 10.0 + steady + step, 'steady': steady, 'run': 'r', **fields}

    events = [
        event(0.0, 'started', behavior='B'),
        event(1.0, 'entered', path='/A'),
        event(2.0, 'waiting', decision='d', path='/A', kind='transition'),
        event(5.0, 'decided', step=3600.0, decision='d'),
        event(6.0, 'left', step=3600.0, path='/A', outcome='done', reason='outcome'),
        event(7.0, 'entered', step=-3600.0, path='/B'),
        event(9.0, 'ended', step=-3600.0, outcome='done'),
    ]
    for wall in (False, True):
        (run,) = metrics_of(events, wall=wall)
        assert run.duration == pytest.approx(9.0)
        assert {one.path: one.total for one in run.paths()} == pytest.approx({'/': 8.0, '/A': 5.0, '/B': 2.0})
        assert [wait.wall for wait in run.waits] == pytest.approx([3.0])
        assert run.clock_set == pytest.approx([3600.0, -7200.0])
    assert "the computer's clock was set by +3600.0 s" in '\n'.join(as_text(run))


class Grab(EventState):
    skill = Skill.of(preconditions=['not holding'], outcomes={'done': ['holding']})

    def __init__(self) -> None:
        super().__init__(outcomes=['done'], desired_rate=None)

    def execute(self, userdata: Any) -> str:
        return 'done'


class Look(EventState):
    """Measures that the hand is empty."""

    is_instant = True
    skill = Skill.of(outcomes={'false': Outcome.of('answered', 'not holding')})

    def __init__(self) -> None:
        super().__init__(outcomes=['false'], desired_rate=None)

    def execute(self, userdata: Any) -> str:
        return 'false'


def grabbing() -> OperatableStateMachine:
    machine = OperatableStateMachine(outcomes=['finished'])
    with machine:
        OperatableStateMachine.add('Grab', Grab(), {'done': 'Look'})
        OperatableStateMachine.add('Look', Look(), {'false': 'Again'})
        OperatableStateMachine.add('Again', Grab(), {'done': 'finished'})
    return machine


def test_an_effect_that_did_not_happen_is_in_the_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bench = ExecutiveBench(
        behavior_of(grabbing, 'Grab'), parameters=ExecutiveParameters(peers=(), event_log_directory=str(tmp_path))
    )
    try:
        bench.start('Grab')
        bench.wait_idle()
    finally:
        bench.close()
    assert main([str(tmp_path)]) == 0
    shown = capsys.readouterr().out
    assert 'not as the skills of the states say:' in shown
    assert "/Look: /Grab ended by 'done', after which holding was to hold; it does not" in shown
    assert main([str(tmp_path), '--json']) == 0
    assert [one['path'] for one in json.loads(capsys.readouterr().out)['contradictions']] == ['/Look']


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)
WORDS = (
    'executive started resumed skills entered left waiting decided fault command ended time stamp steady run path '
    'outcome reason by behavior decision kind effect wait_queue wait_interaction operator target autonomy text'
)
EVENTS = st.fixed_dictionaries(
    {'event': st.sampled_from(WORDS.split()) | JSON},
    optional={word: JSON | st.sampled_from([1.0, 'r', '/A', '/', 'applied']) for word in WORDS.split()},
)


@given(events=st.lists(EVENTS, max_size=12), other=JSON)
def test_lines_of_any_json_are_events_or_left_out(
    tmp_path_factory: pytest.TempPathFactory, events: list[Any], other: Any
) -> None:
    file = tmp_path_factory.mktemp('log') / 'log.jsonl'
    lines = [json.dumps(one) for one in ({'event': 'started', 'run': 'r'}, *events, other)]
    file.write_text('\n'.join([*lines, '[' * 100_000, '{"event": "sta']))
    for run in metrics_of(read_events([file])):
        json.dumps(as_json(run), allow_nan=False)
        parsed(timeline(run))
        assert as_text(run)


def test_spans_are_below_their_machine_and_have_their_own_waits() -> None:
    def event(time: float, name: str, **fields: Any) -> dict[str, Any]:
        return {'event': name, 'stamp': time, 'time': time, 'run': 'r', **fields}

    events = [event(0.0, 'started', behavior='B')]
    for begin in (1.0, 5.0):
        events += [
            event(begin, 'entered', path='/A'),
            event(begin, 'waiting', path='/A', decision=str(begin), kind='transition'),
            event(begin + 4.0, 'decided', decision=str(begin)),
            event(begin + 4.0, 'left', path='/A', outcome='again', reason='outcome'),
        ]
    (run,) = metrics_of([*events, event(9.0, 'ended', outcome='done')], wall=True)
    root, machine, *visits = spans_of(run)['resourceSpans'][0]['scopeSpans'][0]['spans']
    assert (root['name'], machine['name'], machine['parentSpanId']) == ('behavior B', '/', root['spanId'])
    assert [(one['name'], one['parentSpanId'], len(one['events'])) for one in visits] == [
        ('/A', machine['spanId'], 1),
        ('/A', machine['spanId'], 1),
    ]


class Collector(BaseHTTPRequestHandler):
    """A collector of OpenTelemetry that keeps what it takes, and refuses the first request."""

    taken: ClassVar[list[dict[str, Any]]] = []
    refused: ClassVar[int] = 1

    def do_POST(self) -> None:
        data = json.loads(self.rfile.read(int(self.headers['Content-Length'])))
        is_refused, Collector.refused = Collector.refused > 0, Collector.refused - 1
        if not is_refused and self.path == '/v1/traces':
            Collector.taken.append(data)
        self.send_response(503 if is_refused else 200)
        self.end_headers()

    def log_message(self, *_: Any) -> None:
        pass


@pytest.mark.dds('a process sends to a socket')
def test_runs_are_sent_as_spans_also_while_the_log_is_rotated_and_a_collector_refuses(tmp_path: Path) -> None:
    file = tmp_path / 'executive.jsonl'
    file.write_text('{"time": 1, "stamp": 1, "event": "executive", "state": "started"}\n')
    server = HTTPServer(('127.0.0.1', 0), Collector)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    url = f'http://127.0.0.1:{server.server_port}'
    words = ['-m', 'flexbt_onboard.persistence.run_report', str(file), '--otlp', url, '--follow']
    process = subprocess.Popen([sys.executable, *words], stderr=subprocess.DEVNULL)
    try:

        def one_more() -> bool:
            seed = next(seeds)
            if seed % 7 == 0:
                file.rename(tmp_path / 'executive.1.jsonl')
            with file.open('a') as log:
                log.writelines(json.dumps({**event, 'run': f'r{seed}'}) + '\n' for event in random_run(seed)[0])
            return len(Collector.taken) >= 5

        seeds = itertools.count(1)
        wait_until(one_more, 'runs', 2 * DEADLINE)
    finally:
        process.kill()
        process.wait()
        server.shutdown()
    for body in Collector.taken:
        (scope,) = body['resourceSpans'][0]['scopeSpans']
        spans = {one['spanId']: one for one in scope['spans']}
        assert len(spans) == len(scope['spans']) and len({one['traceId'] for one in spans.values()}) == 1
        roots = [one for one in spans.values() if not one['parentSpanId']]
        assert [one['name'] for one in roots] == ['behavior B']
        for one in spans.values():
            assert int(one['startTimeUnixNano']) <= int(one['endTimeUnixNano'])
            assert one['parentSpanId'] in ('', *spans)
    assert len(Collector.taken) >= 5


@pytest.mark.parametrize('follow', [(), ('--follow',)])
def test_what_is_no_collector_is_refused_at_once(capsys: pytest.CaptureFixture[str], follow: tuple[str, ...]) -> None:
    with pytest.raises(SystemExit):
        main(['--otlp', 'localhost:4318', *follow])
    told = "'localhost:4318': give the address of a collector, such as http://localhost:4318"
    assert told in capsys.readouterr().err


def test_a_run_that_a_collector_never_takes_does_not_keep_back_the_next_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / 'executive.jsonl'
    file.touch()
    codes = iter([503, 413, 200, 200])
    sent = []

    def urlopen(request: urllib.request.Request, timeout: float) -> nullcontext[None]:
        sent.append(json.loads(cast(bytes, request.data))['resourceSpans'][0]['scopeSpans'][0]['spans'][0]['name'])
        if (code := next(codes)) != 200:
            raise urllib.error.HTTPError(request.full_url, code, 'no', Message(), None)
        return nullcontext()

    monkeypatch.setattr(urllib.request, 'urlopen', urlopen)
    runs = [RunMetrics(name, name) for name in ('large', 'second', 'third')]
    monkeypatch.setattr(run_report, 'ended_runs', lambda _: runs)
    assert main([str(file), '--otlp', 'http://here', '--follow']) == 0
    assert sent == [f'behavior {name}' for name in ('large', 'large', 'second', 'third')]
    assert [line.partition('; ')[2] for line in capsys.readouterr().err.splitlines()] == [
        '1 runs wait for it',
        'a run is left out',
    ]


def test_a_collector_that_is_not_there_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / 'executive.jsonl'
    file.write_text(''.join(json.dumps(event) + '\n' for event in random_run(3)[0]))
    assert main([str(file), '--otlp', 'http://127.0.0.1:9']) == 1
    assert capsys.readouterr().err == 'run_report: http://127.0.0.1:9/v1/traces: Connection refused\n'
    assert main([str(file), '--follow']) == 2
    assert 'needs --otlp' in capsys.readouterr().err


@pytest.mark.dds('a thread waits at a socket of the computer')
@pytest.mark.parametrize(
    ('answer', 'told'),
    [
        (b'\0\0\6\4\0\0\0\0\0', 'the answer is not HTTP; a collector takes OTLP over HTTP at port 4318'),  # gRPC's port
        (b'HTTP/1.1 404 Not Found\r\n\r\n', 'HTTP Error 404: Not Found'),
    ],
)
def test_what_answers_otherwise_than_a_collector_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], answer: bytes, told: str
) -> None:
    file = tmp_path / 'executive.jsonl'
    file.write_text(''.join(json.dumps(event) + '\n' for event in random_run(3)[0]))
    with socket.create_server(('127.0.0.1', 0)) as server:

        def reply() -> None:
            connection, _ = server.accept()
            with connection:
                connection.recv(1_000_000)
                connection.sendall(answer)
                connection.shutdown(socket.SHUT_WR)
                while connection.recv(1_000_000):
                    pass

        threading.Thread(target=reply, daemon=True).start()
        url = f'http://127.0.0.1:{server.getsockname()[1]}'
        assert main([str(file), '--otlp', url]) == 1
    assert capsys.readouterr().err == f'run_report: {url}/v1/traces: {told}\n'


@pytest.mark.parametrize('address', ['http://localhost:port', 'http://[::1'])
def test_an_address_that_no_computer_can_have_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], address: str
) -> None:
    file = tmp_path / 'executive.jsonl'
    file.write_text(''.join(json.dumps(event) + '\n' for event in random_run(3)[0]))
    assert main([str(file), '--otlp', address]) == 1
    assert capsys.readouterr().err.startswith(f'run_report: {address}/v1/traces: ')


def test_a_line_of_the_log_cannot_control_the_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / 'executive.jsonl'
    started = {'event': 'started', 'run': 'r'}
    file.write_text(
        ''.join(
            json.dumps({'time': 1.0, 'stamp': 1.0, 'run': 'r', **event}) + '\n'
            for event in (started, {'event': 'command', 'command': '\x1b[2JSTOP', 'effect': '\x1b[2Japplied'})
        )
    )
    assert main([str(file)]) == 0
    assert '\x1b' not in capsys.readouterr().out

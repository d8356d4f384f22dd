# SPDX-License-Identifier: BSD-3-Clause
"""What people are told: what is late calmly and what is gone loudly, why something waits, and in which colours."""

from __future__ import annotations

import io
import time
from dataclasses import replace
from typing import Any

import pytest

from flexbt_console.mirror.mirror import LISTEN_SECONDS, Mirror, Transit
from flexbt_console.mirror.records import (
    ActiveState,
    Decision,
    DecisionKind,
    DriveProgress,
    EventKind,
    ExecutiveEvent,
    ExecutiveSnapshot,
    ExecutiveState,
    FramedPose,
    LogLine,
    LogSeverity,
    Peer,
)
from flexbt_console.present.events import Follower
from flexbt_console.present.rendering import (
    alarm_line,
    asked_text,
    behavior_line,
    event_line,
    log_lines,
    progress_text,
    status_lines,
)
from flexbt_console.present.style import Tone, coloured, has_colours, tone_of
from flexbt_console.ui.line.toolbar import toolbar
from flexbt_core.clock.clock import ManualClock

RUNNING = ExecutiveSnapshot('e', 1, state=ExecutiveState.RUNNING, run_id='r1', behavior='Patrol', heartbeat_period=0.5)
FAILED = Decision('t1', DecisionKind.TRANSITION, '/Drive', 'failed', ('done', 'failed'), 3, since=12.0)


class Scene:
    """A mirror, and what its follower tells people."""

    def __init__(self, **places: FramedPose) -> None:
        self.clock = ManualClock()
        self.mirror = Mirror(self.clock, places)
        self._follower = Follower(self.mirror)
        self._sequence = 0

    def show(self, snapshot: ExecutiveSnapshot) -> list[str]:
        self._sequence += 1
        now = self.clock.now()
        self.mirror.receive_snapshot(replace(snapshot, sequence=self._sequence), Transit(now, now))
        return self.told()

    def told(self) -> list[str]:
        return [line for event in self._follower.events(self.mirror.view()) for line in event.text]

    def toolbar(self, width: int = 80, height: int = 12) -> list[str]:
        return [line for _, line in toolbar(self.mirror.view(), width, height)]


def test_that_there_is_no_executive_is_told_only_when_one_would_have_been_heard() -> None:
    scene = Scene()
    assert (scene.told(), scene.toolbar()) == ([], ['LISTENING'])
    assert status_lines(scene.mirror.view()) == ['link      LISTENING for an executive']
    scene.clock.advance(1.0)
    assert scene.show(RUNNING)[0] == 'link: LIVE 0.0 s'
    nobody = Scene()
    assert nobody.told() == []
    assert nobody.mirror.next_link_change() == LISTEN_SECONDS  # whoever waits is woken then
    nobody.clock.advance(LISTEN_SECONDS)
    assert (nobody.told(), nobody.toolbar()) == (['link: NO EXECUTIVE'], ['NO EXECUTIVE'])
    assert nobody.told() == []
    wrong = Scene()
    wrong.mirror.set_problem('another version')
    assert wrong.told() == ['link: NO EXECUTIVE', 'another version']


def test_a_link_that_is_late_again_and_again_is_no_event_and_one_that_is_lost_is() -> None:
    scene = Scene()
    assert scene.show(RUNNING)[0] == 'link: LIVE 0.0 s'
    for _ in range(20):
        scene.clock.advance(1.5)
        assert scene.toolbar()[0].startswith('STALE 1.5 s')
        assert scene.told() == []
        assert scene.show(RUNNING) == []
    scene.clock.advance(6.0)
    assert (lost := scene.told()) == ['link: LOST 6.0 s']
    assert tone_of(lost[0]) is Tone.ERROR
    assert scene.show(RUNNING) == ['link: LIVE 0.0 s']


def test_why_an_alarm_about_motion_is_over_is_told_as_it_is() -> None:
    scene = Scene()
    stopped = replace(RUNNING, state=ExecutiveState.IDLE, outcome='preempted')

    def at(second: int, x: float | None, snapshot: ExecutiveSnapshot = stopped) -> list[str]:
        pose = None if x is None else FramedPose(x, 0.0)
        return scene.show(replace(snapshot, stamp=100.0 + second, robot_pose=pose))

    told = [line for second in range(8) for line in at(second, 0.1 * second)]
    assert told[-1].startswith('ALARM: THE ROBOT MOVES') and tone_of(told[-1]) is Tone.ERROR
    assert at(8, None) == []
    assert alarm_line(scene.mirror.view()).startswith('ALARM: THE ROBOT MOVED, 0.50 m when its pose was last known')
    stands = [line for second in range(9, 20) for line in at(second, 2.0)]
    assert stands == ['the robot stands again']
    assert any('MOVES' in line for second in range(20, 30) for line in at(second, 0.1 * second))
    assert at(30, 3.0, RUNNING)[0] == 'the robot need not stand still any more'


@pytest.mark.parametrize(
    ('levels', 'told'),
    [
        ((), 'step'),
        ((('/Drive', 1),), 'auto at High'),
        ((('/Driver', 1),), 'step'),
        ((('/Drive', 1), ('/Drive/Around', 3)), 'step'),
    ],
)
def test_what_holds_a_transition_is_told_by_the_level_of_its_state(
    levels: tuple[tuple[str, int], ...], told: str
) -> None:
    wanted = Decision('t1', DecisionKind.TRANSITION, '/Drive/Around/Turn', 'done', required_autonomy=1)
    stepping = replace(RUNNING, autonomy=2, autonomy_levels=levels, step='over /Drive/Around/Turn')
    assert asked_text(wanted, stepping) == f'/Drive/Around/Turn wants done ({told})'


def test_a_node_that_is_late_is_shown_with_its_age_and_a_dead_one_is_told() -> None:
    scene = Scene()

    def peers(**fields: Any) -> ExecutiveSnapshot:
        return replace(RUNNING, peers=(Peer('/bt_server', **{'alive': True, **fields}),))

    scene.show(peers())
    for age in (0.5, 0.0, 1.5, 0.0):
        assert scene.show(peers(late=age > 0.0, age=age)) == []
    late = [scene.show(peers(late=True, ready=False, age=age, problem='it hangs')) for age in (1.0, 2.1, 3.0, 4.0)]
    assert late == [[]] * 4
    assert '/bt_server late 4.0 s: it hangs' in scene.toolbar()
    assert 'node      /bt_server late 4.0 s: it hangs' in status_lines(scene.mirror.view())
    gone = scene.show(peers(alive=False, ready=False, problem='start it again'))
    assert gone == ['node /bt_server not found: start it again']
    assert tone_of(gone[0]) is Tone.ERROR
    assert scene.show(peers()) == ['node /bt_server is there again']
    assert status_lines(scene.mirror.view())[-1] == 'nodes     /bt_server ok'


def test_why_a_transition_waits_stands_beside_it() -> None:
    scene = Scene()
    for number, (stamp, severity, path, run, text) in enumerate(
        [
            (1.0, LogSeverity.ERROR, '/Drive', 'r1', 'of an earlier visit'),
            (11.0, LogSeverity.ERROR, '/Drive', 'r1', 'the goal is in a wall'),
            (11.5, LogSeverity.INFO, '/Drive', 'r1', 'gives up'),
            (11.6, LogSeverity.ERROR, '/Drive2', 'r1', 'another state'),
            (11.7, LogSeverity.ERROR, '/Drive', 'r0', 'another run'),
        ]
    ):
        scene.mirror.receive_log(LogLine('e', number, severity, text, path, run, stamp))
    told = scene.show(replace(RUNNING, active_states=(ActiveState('/Drive', 10.0),), decisions=(FAILED,)))
    assert '  because ERROR: the goal is in a wall' in scene.toolbar()
    assert '  because ERROR: the goal is in a wall' in status_lines(scene.mirror.view())
    assert told.index('log: ERROR: /Drive: the goal is in a wall') < told.index('active: /Drive')
    # Of a container, of which no one knows when it was entered: what was told in it just now.
    scene.show(replace(RUNNING, decisions=(replace(FAILED, id='t2', path='/'),)))
    assert '  because ERROR: /Drive2: another state' in scene.toolbar()


def test_what_was_told_before_a_state_came_to_wait_stands_beside_its_question() -> None:
    scene = Scene()
    ways = (('/Go', '/Drive', 10.0), ('/Drive', '/Tell', 20.0), ('/Tell', '/Ask', 20.1), ('/Watch', '/Log', 20.05))
    events = [
        ExecutiveEvent('e', number, EventKind.TRANSITION, path, target=target, run_id='r1', stamp=stamp)
        for number, (path, target, stamp) in enumerate(ways)
    ]
    for number, (stamp, severity, path, text) in enumerate(
        [
            (9.9, LogSeverity.ERROR, '/Drive', 'of an earlier visit'),
            (19.5, LogSeverity.WARN, '/Drive/Follow', 'no way to the kitchen'),
            (20.0, LogSeverity.INFO, '/Drive', 'gives up'),
            (20.04, LogSeverity.ERROR, '/Watch', 'another state'),
            (20.05, LogSeverity.INFO, '/Tell', 'only leads on'),
        ]
    ):
        scene.mirror.receive_log(LogLine('e', number, severity, text, path, 'r1', stamp))
    asked = Decision('c1', DecisionKind.CHOICE, '/Ask', outcomes=('again', 'home'))
    waiting = replace(RUNNING, active_states=(ActiveState('/Ask', 20.1),), decisions=(asked,))
    scene.show(waiting)
    assert 'after' not in ' '.join(scene.toolbar())  # how the robot came here is not known yet
    scene.mirror.receive_events(events)
    assert '  after WARN: /Drive/Follow: no way to the kitchen' in scene.toolbar()
    assert '  after WARN: /Drive/Follow: no way to the kitchen' in status_lines(scene.mirror.view())
    # What has gone on for a while since then has got over it.
    scene.mirror.receive_events([replace(events[2], sequence=4, stamp=40.0)])
    assert not scene.mirror.view().reasons


def test_the_leaf_of_the_active_tree_is_shown_however_little_room_there_is() -> None:
    scene = Scene()
    nodes = (*(f'Level{number}' for number in range(20)), 'FollowPath::12')
    state = ActiveState('/Mission/' + 'Area/' * 20 + 'Drive', activity=nodes)
    scene.show(replace(RUNNING, active_states=(state,), decisions=(FAILED,)))
    for width, height in ((80, 12), (80, 7), (40, 24), (80, 8)):
        text = scene.toolbar(width, height)
        assert '    FollowPath::12' in text or height < 8, (width, height, text)
        assert any(line.startswith('> /Mission/') and line.endswith('/Drive') for line in text), (width, text)
        assert all(len(line) <= width for line in text)


def test_a_refused_start_is_no_run_that_has_failed() -> None:
    scene = Scene()
    scene.show(replace(RUNNING, state=ExecutiveState.IDLE, message="input 'x' is no key"))
    assert behavior_line(scene.mirror.view()) == "IDLE  Patrol did not start (input 'x' is no key)"
    scene.show(replace(RUNNING, state=ExecutiveState.IDLE, outcome='error', message='a wheel is off'))
    assert behavior_line(scene.mirror.view()) == 'IDLE  Patrol ended: error (a wheel is off)'


def test_what_has_not_stopped_and_what_is_not_paused_is_told_and_not_again_and_again() -> None:
    scene = Scene()
    scene.show(RUNNING)
    stopping = [
        scene.show(replace(RUNNING, state=ExecutiveState.STOPPING, message=f'/Drive has not stopped for {age} s'))
        for age in (1, 2, 3)
    ]
    assert stopping == [['behavior: STOPPING  Patrol (/Drive has not stopped for 1 s)'], [], []]
    assert '/Drive has not stopped for 3 s' in scene.toolbar()
    paused = ActiveState('/Drive', paused=True, not_paused=('Spin::4: its server cannot',))
    scene.show(replace(RUNNING, state=ExecutiveState.PAUSED, active_states=(paused,)))
    assert scene.toolbar()[1:3] == ['> /Drive (paused)', '    still active: Spin::4: its server cannot']
    assert '            still active: Spin::4: its server cannot' in status_lines(scene.mirror.view())


def test_places_of_the_robot_count_and_those_of_the_console_are_added() -> None:
    scene = Scene(kitchen=FramedPose(9.0, 9.0), shed=FramedPose(5.0, 5.0))
    scene.mirror.receive_places({'kitchen': FramedPose(1.0, 2.0)})
    view = scene.mirror.view()
    assert view.has_places
    assert view.places == {'kitchen': FramedPose(1.0, 2.0), 'shed': FramedPose(5.0, 5.0)}


def test_the_log_has_times_of_day_or_of_the_simulation() -> None:
    line = LogLine('e', 1, LogSeverity.WARN, 'two\nlines', '/Drive', stamp=12.34)
    assert log_lines(line, with_time=True) == ['  12.3 s  WARN: /Drive: two', '    lines']
    day = time.mktime((2026, 1, 2, 3, 4, 5, 0, 0, -1))
    assert log_lines(replace(line, stamp=day), with_time=True)[0] == '03:04:05  WARN: /Drive: two'


def test_a_command_of_another_operator_is_told_with_what_it_is_about() -> None:
    event = ExecutiveEvent('e', 1, EventKind.COMMAND, operator='bob', command='START', target='Navigate')
    assert event_line(event) == 'bob: start Navigate: applied'
    refused = replace(event, command='AUTONOMY', target='2', path='/Drive', applied=False, reason='ann has it')
    assert event_line(refused) == 'bob: autonomy 2 /Drive: refused: ann has it'
    scene = Scene()
    scene.mirror.receive_log(LogLine('e', 1, LogSeverity.INFO, 'bob notes: all is well'))
    noted = replace(event, sequence=2, command='NOTE', target='', text='all is well')
    scene.mirror.receive_events([event, noted])
    told = scene.show(RUNNING)
    assert 'bob: start Navigate: applied' in told and [line for line in told if 'all is well' in line] == [
        'log: bob notes: all is well'
    ]


class FakeTerminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_colours_are_for_terminals_that_want_them(monkeypatch: pytest.MonkeyPatch) -> None:
    line = log_lines(LogLine('e', 1, LogSeverity.ERROR, 'broken'))[0]
    monkeypatch.setenv('TERM', 'xterm')
    monkeypatch.delenv('NO_COLOR', raising=False)
    assert coloured(line, has_colours(FakeTerminal())) == '\x1b[31mERROR: broken\x1b[0m'
    assert coloured(line, has_colours(io.StringIO())) == 'ERROR: broken'
    monkeypatch.setenv('NO_COLOR', '1')
    assert coloured(line, has_colours(FakeTerminal())) == 'ERROR: broken'


def test_one_recovery_is_no_plural() -> None:
    told = [progress_text(DriveProgress(distance=4.24, recoveries=number), {}) for number in (0, 1, 2)]
    assert told == ['4.2 m', '4.2 m  1 recovery', '4.2 m  2 recoveries']

# SPDX-License-Identifier: BSD-3-Clause
"""Who comes late sees what is to be judged, and the plan that is driven along: every console, and a recording."""

from __future__ import annotations

import asyncio
import json
import re
import signal
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from aiohttp import ClientSession, WSMsgType

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.mirror.view import View
from flexbt_console.recording.player import RunPlayer
from flexbt_msgs.msg import ExecutiveStatus, PendingDecision
from flexbt_testing.nodes.operator import Operator
from flexbt_testing.system.processes import Stack
from flexbt_testing.system.python_processes import console_answer, run_console, start_console
from flexbt_testing.waiting import wait_until

DEADLINE = 120.0
GOAL = (10.0, 2.3)


def console(*words: str) -> Any:
    """Return what a command of ann's console, which is opened for it, answers."""
    return console_answer(*words, '--operator', 'ann')


def late_page(done: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
    """Return the parts of a page that is opened now, as soon as they are what is waited for."""

    async def look(address: str) -> dict[str, Any]:
        parts: dict[str, Any] = {}
        async with (
            asyncio.timeout(DEADLINE),
            ClientSession() as session,
            session.ws_connect(f'{address}link', max_msg_size=0) as socket,
        ):
            await socket.send_json({'hello': None})
            while True:
                message = await socket.receive()
                if message.type is WSMsgType.TEXT:
                    parts.update(json.loads(message.data).get('parts', {}))
                with suppress(KeyError, IndexError, TypeError):
                    if done(parts):
                        return parts

    with start_console('web', '--port', '0', '--operator', 'bob', '--timeout', '60') as web:
        try:
            assert web.stdout is not None
            found = re.search(r'http://127\.0\.0\.1:\d+/', told := web.stdout.readline())
            assert found is not None, told
            return asyncio.run(look(found[0]))
        finally:
            web.kill()


def is_judged(status: ExecutiveStatus) -> bool:
    """Return whether the operator is asked for a choice."""
    return bool(status.decisions[0].kind == PendingDecision.CHOICE)


def ends_at_goal(points: Any) -> bool:
    """Return whether a path leads to the goal."""
    return len(points) > 2 and max(abs(points[-1][0] - GOAL[0]), abs(points[-1][1] - GOAL[1])) < 0.3


def test_who_comes_late_sees_the_path_and_the_goal_that_are_to_be_judged(tmp_path: Path) -> None:
    file = tmp_path / 'run.mcap'
    with Stack(tmp_path) as stack, NodeRuntime.open('early') as runtime:
        early = Operator(runtime)  # waits: each look of a console that is opened for it would cost half a second
        stack.start_all({'speed_factor': '2.0'}, onboard_executive={'journal_directory': str(tmp_path)}, in_one=True)
        early.wait_for(lambda status: status.peers and all(peer.ready for peer in status.peers), 'all are ready')
        console('start', 'Navigate Split', '--autonomy', 'high')
        early.wait_for(lambda status: status.decisions[0].kind == PendingDecision.INPUT, 'the question for a goal')
        console('input', f'{GOAL[0]} {GOAL[1]} 0')
        early.wait_for(is_judged, 'the question about the path')
        assert console('status')['decisions'][0]['subject'] == ['path', 'goal']

        def sees_all() -> None:
            """Every console that is opened now, and none of them was there when the path was planned."""
            drawn = console('map')
            assert ends_at_goal(drawn['plan']) and drawn['goal'] == list(GOAL) and drawn['lacks'] == ''
            told = run_console('status').stdout
            assert re.search(r'about path: \d+\.\d m to x 1\d\.\d\d y 2\.\d\d; goal: x 10\.00 y 2\.30', told), told
            page = late_page(lambda parts: parts['decisions'][0]['lacks'] == '' and parts['decisions'][0]['drawn'])
            assert ends_at_goal(page['decisions'][0]['drawn']['plan'])
            assert page['decisions'][0]['drawn']['goal'] == list(GOAL)

        sees_all()
        stack.kill('onboard_executive')
        stack.start('onboard_executive', {'journal_directory': str(tmp_path)})
        early.wait_for(lambda status: status.state == ExecutiveStatus.INTERRUPTED, 'the run that can be resumed')
        console('resume')
        early.wait_for(is_judged, 'the question about the path')
        sees_all()

        stack.start('recorder', {'use_sim_time': 'false', 'file': str(file)})
        wait_until(lambda: 'ready: hears all' in stack.output('recorder'), 'the recorder hears all', DEADLINE)
        console('confirm')
        early.wait_active('/FollowPath')
        assert ends_at_goal(console('map')['plan'])
        driven = late_page(lambda parts: parts['active']['paths'] == ['/', '/FollowPath'] and len(parts['plan']) > 2)
        assert ends_at_goal(driven['plan'])
        console('stop')
        assert stack.end('recorder', signal.SIGINT, DEADLINE).exit_code == 0

    def recorded(wanted: Callable[[View], object]) -> View:
        player = RunPlayer(file)
        while not wanted(view := player.mirror.view()):
            assert player.time < player.duration, view
            player.go_to(player.next_said(1))
        return view

    judged = recorded(lambda view: view.decision is not None and not view.lacks(view.decision))
    assert ends_at_goal(judged.drawn.plan) and judged.drawn.goal == GOAL
    assert ends_at_goal(recorded(lambda view: '/FollowPath' in view.active_paths).drawn.plan)

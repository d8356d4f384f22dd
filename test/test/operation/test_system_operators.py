# SPDX-License-Identifier: BSD-3-Clause
"""Several operators at consoles of their own, as processes: who may command, and who is gone."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from flexbt_common.lifecycle.presence import PRESENCE_LEASE_SECONDS
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_msgs.msg import ExecutiveStatus
from flexbt_testing.system.probe import Probe
from flexbt_testing.system.processes import Stack
from flexbt_testing.system.python_processes import console_answer, silent_console
from flexbt_testing.waiting import uncontended_time, wait_until

TIMEOUT = 2.0
SEEN_AFTER_DEATH = PRESENCE_LEASE_SECONDS + 1.0


@pytest.fixture
def stack(tmp_path: Path) -> Iterator[Stack]:
    with Stack(tmp_path) as stack:
        directories = {'event_log_directory': str(tmp_path), 'journal_directory': str(tmp_path)}
        stack.start('onboard_executive', {'use_sim_time': 'false', 'authority_timeout': str(TIMEOUT), **directories})
        yield stack


@pytest.fixture
def probe(stack: Stack) -> Iterator[Probe]:
    with NodeRuntime.open('probe') as runtime:
        probe = Probe(runtime)
        probe.wait_state(ExecutiveStatus.IDLE)
        yield probe


def console(operator: str, *words: str, exit_code: int = 0) -> Any:
    """Return what a command of an operator's console answers; None for an empty list."""
    return console_answer(*words, '--operator', operator, exit_code=exit_code)


def active(status: Any) -> list[str]:
    """Return the active states of a status."""
    return [state['path'] for state in status['active_states']]


def test_one_commands_and_the_next_one_gets_it_when_that_console_dies(stack: Stack, probe: Probe) -> None:
    watch = ('watch', '--json', '--operator')
    with silent_console(*watch, 'ann') as ann, silent_console(*watch, 'bob'):
        console('ann', 'claim')
        console('bob', 'claim', '--reason', 'my shift')
        claimed = ('ann', ['bob'])
        probe.wait(lambda: (probe.status.authority, list(probe.status.authority_requests)) == claimed, 'both claims')
        assert 'ann' in console('bob', 'autonomy', 'full', exit_code=3)['reason']
        console('ann', 'autonomy', 'high')
        ann.kill()
        killed = uncontended_time()
        probe.wait(lambda: probe.status.authority == 'bob', 'passed on')
        assert uncontended_time() - killed < TIMEOUT + SEEN_AFTER_DEATH
        console('bob', 'autonomy', 'full')
        assert 'bob' in console('ann', 'autonomy', 'off', exit_code=3)['reason']
    (record,) = stack.directory.glob('*.jsonl')
    events = [json.loads(line) for line in record.read_text().splitlines()]
    assert [(event['holder'], event['requests']) for event in events if event['event'] == 'authority'][:3] == [
        ('ann', []),
        ('ann', ['bob']),
        ('bob', []),
    ]
    refused = [event for event in events if event['event'] == 'command' and event['effect'] == 'refused']
    assert [event['operator'] for event in refused] == ['bob', 'ann']


def test_a_run_is_paused_locked_and_resumed_after_a_crash_from_the_command_line(stack: Stack) -> None:
    console('ann', 'start', 'Inspect Site', 'duration=1000', '--input', 'site=string:"gate"', '--autonomy', 'high')
    # The run may not have come to its first state.
    wait_until(lambda: active(console('bob', 'status')) == ['/Look'], 'the first state')
    (root,) = wait_until(lambda: console('bob', 'userdata', '/'), 'userdata of the run')
    assert ('site', 'string') in [(value['key'], value['type']) for value in root['values']]
    assert 'there are' in console('bob', 'userdata', '/', 'nothing', exit_code=3)['reason']
    console('ann', 'lock', 'Look')
    console('ann', 'pause')
    assert 'there is no state' in console('ann', 'breakpoint', 'Nowhere', exit_code=3)['reason']
    stack.kill('onboard_executive')
    stack.start('onboard_executive', {'use_sim_time': 'false', 'journal_directory': str(stack.directory)})
    status = console('bob', 'status')
    assert (status['state'], status['locked']) == ('interrupted', ['/Look'])
    console('bob', 'resume')  # the run
    console('bob', 'resume')  # from its pause
    console('bob', 'unlock', 'Look')
    console('bob', 'force', 'done')
    wait_until(lambda: [one['path'] for one in console('bob', 'status')['decisions']] == ['/Judge'], 'the decision')

# SPDX-License-Identifier: BSD-3-Clause
"""A model of crashes: nothing that was shown is undone by a loss of power at any moment, and each command counts once.

A random walk of an operator goes on in one process. Whenever a status goes out, what the disk had at that time is kept;
afterwards it is looked at as an executive would that is started again. FLEXBT_SEED sets the walk, FLEXBT_STEPS its
length.
"""

from __future__ import annotations

import copy
import os
import random
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import pytest

from flexbt_core.clock.clock import ManualClock
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_msgs.msg import CommandResult, ExecutiveCommand, ExecutiveStatus
from flexbt_onboard.link.console_link import ConsoleLink
from flexbt_onboard.node.executive_parameters import ExecutiveParameters
from flexbt_onboard.persistence import journal
from flexbt_onboard.persistence.journal import JournalLine, JournalState, read_journal
from flexbt_onboard.persistence.run_journal import RunJournal
from flexbt_testing.nodes.executive_bench import ExecutiveBench, behavior_of
from flexbt_testing.state_machines.bench import Add, Ask

C = ExecutiveCommand
STEPS = int(os.environ.get('FLEXBT_STEPS', '80'))
SEED = int(os.environ.get('FLEXBT_SEED', '1'))
NAME = '/onboard_executive'


def counting() -> OperatableStateMachine:
    """Ask and counts, in a machine inside."""
    inner = OperatableStateMachine(outcomes=['out'], io_keys=['count'])
    with inner:
        OperatableStateMachine.add('Ask', Ask(), {'again': 'Add', 'out': 'out'}, autonomy={'again': Autonomy.Full})
        OperatableStateMachine.add('Add', Add(), {'done': 'Ask'}, autonomy={'done': Autonomy.High})
    machine = OperatableStateMachine(outcomes=['finished'], output_keys=['count'])
    machine.userdata.count = 0
    with machine:
        OperatableStateMachine.add('Inner', inner, {'out': 'finished'})
    return machine


class Disk:
    """What a journal's disk has after a loss of power: what was there when it was told to write last."""

    def __init__(self, file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.content = b''
        self.history: list[bytes] = []
        self._file = file
        for name in ('fdatasync', 'fsync'):
            monkeypatch.setattr(os, name, self._kept(getattr(os, name)))

    def _kept(self, real: Callable[[int], None]) -> Callable[[int], None]:
        def sync(descriptor: int) -> None:
            content = self._file.read_bytes() if self._file.exists() else b''
            real(descriptor)
            self.content = content
            self.history.append(content)

        return sync


class Walk:
    """An operator who does anything, and what was shown of it."""

    def __init__(self, bench: ExecutiveBench, seed: int) -> None:
        self.bench = bench
        self.random = random.Random(seed)

    def step(self) -> None:
        """Send one command, and wait for its result."""
        bench, status = self.bench, self.bench.status
        if status.state == ExecutiveStatus.IDLE and self.random.random() < 0.2:
            bench.result(bench.send(C.AUTONOMY, autonomy=self.random.randrange(4)))
            return
        if status.state == ExecutiveStatus.IDLE and self.random.random() < 0.8:
            bench.result(
                bench.send(C.START, behavior=self.random.choice(['Test', 'Other']), autonomy=self.random.randrange(4))
            )
            return
        path = self.random.choice(['/Inner', '/Inner/Ask', '/Inner/Add'])
        decision = status.decisions[0].id if status.decisions else ''
        choices: list[tuple[int, dict[str, Any]]] = [
            *[(C.CONFIRM, {'decision_id': decision})] * 8,
            (C.FORCE, {'path': '/Inner/Ask', 'outcome': self.random.choice(['again', 'again', 'out'])}),
            (C.LOCK, {'path': path}),
            *[(C.UNLOCK, {'path': path})] * 2,
            (C.BREAKPOINT, {'path': path}),
            *[(C.CLEAR_BREAKPOINT, {'path': path})] * 2,
            (C.AUTONOMY, {'autonomy': self.random.randrange(4), 'path': self.random.choice(['', '/Inner'])}),
            (C.PAUSE, {}),
            *[(C.RESUME, {})] * 3,
            (C.SWITCH, {'behavior': self.random.choice(['Test', 'Other'])}),
            (C.STOP, {}),
        ]
        kind, fields = self.random.choice(choices)
        bench.result(bench.send(kind, run_id=status.run_id if kind != C.AUTONOMY or status.state else '', **fields))


@pytest.fixture
def disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Disk:
    return Disk(tmp_path / 'onboard_executive.journal', monkeypatch)


@pytest.fixture
def bench(disk: Disk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ExecutiveBench]:
    monkeypatch.setattr(journal, 'STUCK_SECONDS', 1000.0)  # after that long it is shown all the same
    parameters = ExecutiveParameters(peers=(), journal_directory=str(tmp_path))
    bench = ExecutiveBench(behavior_of(counting), behavior_of(counting, 'Other'), parameters=parameters)
    yield bench
    bench.close()


def started_again(parent: Path, content: bytes) -> RunJournal:
    """Return what an executive knows that finds this on its disk."""
    # In a directory of its own: on a slow disk the one before may not have let go of its files yet.
    file = Path(mkdtemp(dir=parent), 'onboard_executive.journal')
    file.write_bytes(content)
    journal = RunJournal(file, lambda _problem: None, ManualClock())
    journal.sync(20.0)
    journal.close()
    assert not journal.corruption
    return journal


def test_no_loss_of_power_undoes_what_was_shown(
    bench: ExecutiveBench, disk: Disk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[tuple[ExecutiveStatus, bytes]] = []
    publish = ConsoleLink.publish_status

    def keep(link: ConsoleLink, status: ExecutiveStatus) -> None:
        shown.append((copy.deepcopy(status), disk.content))
        publish(link, status)

    monkeypatch.setattr(ConsoleLink, 'publish_status', keep)
    walk = Walk(bench, SEED)
    for _ in range(STEPS):
        walk.step()
    known: dict[bytes, RunJournal] = {}
    for status, content in shown:
        if content not in known:
            known[content] = started_again(tmp_path, content)
        check(status, known[content], read_journal(content).lines)
    assert len(known) > STEPS // 4
    results = {result.command_id for status, _ in shown for result in status.results}
    assert len(results) >= STEPS


def check(status: ExecutiveStatus, found: RunJournal, lines: Sequence[JournalLine]) -> None:
    """Check that what was shown holds for whoever finds this; the machine may have gone on from there by some lines."""
    results = {one.command_id: (one.code, one.reason) for one in found.results}
    for result in status.results:
        assert results[result.command_id] == (result.code, result.reason)
    if status.state == ExecutiveStatus.STARTING:
        return  # nothing is said of it yet
    if status.state == ExecutiveStatus.STOPPING:
        assert found.interrupted is None or found.interrupted.run_id != status.run_id
        return
    states = [JournalState()]
    for line in lines:
        states.append(copy.copy(states[-1]))
        states[-1].apply(line)
    accounts = [said(found, state) for state in reversed(states)]
    assert shown_by(status) in accounts


def said(found: RunJournal, state: JournalState) -> tuple[Any, ...]:
    """Return what is shown by an executive that finds a journal that says this."""
    found = copy.copy(found)
    found.state = state
    run = found.interrupted
    if run is None:
        return '', Autonomy.Low if found.next_autonomy is None else found.next_autonomy
    position = run.position()
    levels = [(path, level) for path, level in sorted(run.levels.items()) if path != '/']
    is_paused = position is not None and position.is_paused
    return run.run_id, run.autonomy, run.behavior, is_paused, run.active, levels, run.locked, run.breakpoints


def shown_by(status: ExecutiveStatus) -> tuple[Any, ...]:
    """Return the same of a status."""
    if status.state == ExecutiveStatus.IDLE:
        return '', status.autonomy
    levels = [(one.path, one.level) for one in status.autonomy_levels]
    active = [one.path for one in status.active_states]
    is_paused = status.state == ExecutiveStatus.PAUSED
    rest = (is_paused, active, levels, list(status.locked), list(status.breakpoints))
    return (status.run_id, status.autonomy, status.behavior, *rest)


def test_each_confirmation_counts_once_wherever_the_journal_ends(
    bench: ExecutiveBench, disk: Disk, tmp_path: Path
) -> None:
    bench.start(autonomy=3)
    confirmed = 0
    for _ in range(12):
        decision = bench.wait_for(lambda status: status.decisions, 'question')[0]
        bench.applied(C.CONFIRM, id=f'confirm-{confirmed}', decision_id=decision.id)
        confirmed += 1
    bench.wait_for(lambda status: status.decisions, 'question')
    bench.executive._journal.sync(10.0)
    whole = disk.history[-1]
    lines = whole.splitlines(keepends=True)
    assert not read_journal(whole).corruption
    seen = set()
    for number in range(2, len(lines) + 1):
        for torn in (b'', lines[number][:17] if number < len(lines) else b''):
            found = started_again(tmp_path, b''.join(lines[:number]) + torn)
            applied = [
                one
                for one in found.results
                if one.command_id.startswith('confirm') and one.code == CommandResult.APPLIED
            ]
            run = found.interrupted
            assert run is not None
            position = run.position()
            if position is None:
                assert not applied
                continue
            inner = [values['count'] for values in position.userdata.values() if 'count' in values][-1]
            is_approved = '/Inner/Ask' in position.approved
            is_counted = '/Inner/Add' in position.wanted
            is_pending = is_approved or ('/Inner/Add' in [*position.active, *position.coming] and not is_counted)
            assert inner + is_pending == len(applied), (number, position)
            seen.add(len(applied))
    assert seen == set(range(confirmed + 1))

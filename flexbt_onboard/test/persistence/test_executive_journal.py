# SPDX-License-Identifier: BSD-3-Clause
"""The journal: what was written is read again, wherever the writing was cut off, and values come back as they were."""

from __future__ import annotations

import errno
import fcntl
import json
import math
import os
import random
import shutil
import stat
import subprocess
import sys
import tempfile
import threading
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped
from hypothesis import given, settings
from hypothesis import strategies as st
from nav_msgs.msg import Path as NavPath

from flexbt_core.clock.clock import ManualClock, SteadyClock
from flexbt_core.errors import FlexbtError
from flexbt_onboard.errors import OnboardError
from flexbt_onboard.persistence import journal as journal_module
from flexbt_onboard.persistence.journal import (
    FORMAT,
    REMEMBERED_COMMANDS,
    STUCK_SECONDS,
    Journal,
    JournalLine,
    JournalState,
    encode_head,
    encode_line,
    read_journal,
)
from flexbt_onboard.persistence.run_journal import from_plain_form, to_plain_form
from flexbt_testing.waiting import DEADLINE, wait_until

TEXTS = st.text(st.characters(codec='utf-8'), max_size=8)
RUNS = st.sampled_from('rs')
COMMANDS = st.lists(st.tuples(TEXTS, st.integers(1, 2), TEXTS), max_size=3)


def begin_of(run: str, **parts: Any) -> JournalLine:
    """Return what is written of a run that begins."""
    return {'run': run, 'behavior': 'B', 'arguments': [], 'inputs': [], 'by': 'ann', 'autonomy': 1} | parts


def position_of(*active: str) -> JournalLine:
    """Return what is written of a place in a machine."""
    return {'active': list(active), 'coming': [], 'levels': {'/': 1}, 'locked': [], 'breakpoints': []}


LINES = st.one_of(
    st.fixed_dictionaries({'begin': st.builds(begin_of, RUNS, autonomy=st.integers(0, 3))}),
    st.fixed_dictionaries({'run': RUNS, 'position': st.builds(position_of, TEXTS)}),
    st.fixed_dictionaries({'run': RUNS, 'end': TEXTS}),
    st.fixed_dictionaries({'commands': COMMANDS}),
    st.fixed_dictionaries({'autonomy': st.one_of(st.none(), st.integers(0, 3))}),
    st.fixed_dictionaries({'run': RUNS, 'position': st.builds(position_of, TEXTS), 'commands': COMMANDS}),
)
STORY: list[JournalLine] = [
    {'commands': [['first', 2, 'no']]},
    {'begin': begin_of('r', inputs=[['key', 'string', 'ä', 'AAAA']]), 'commands': [['start', 1, '']]},
    {'run': 'r', 'position': position_of('/A')},
    {'run': 'r', 'position': position_of('/B'), 'commands': [['confirm', 1, '']]},
    {'run': 'r', 'end': 'done'},
    {'begin': begin_of('s')},
    {'run': 's', 'position': position_of('/C')},
]
"""Two runs, of which the second goes on."""


def no_problem(text: str) -> None:
    raise AssertionError(text)


def state_of(lines: list[JournalLine]) -> JournalState:
    """Return what lines say."""
    state = JournalState()
    for line in lines:
        state.apply(line)
    return state


def file_of(lines: list[JournalLine]) -> bytes:
    """Return a journal with these lines."""
    return b''.join([encode_head(), *(encode_line(number, line) for number, line in enumerate(lines, 1))])


@pytest.fixture(scope='session')
def clock() -> Iterator[SteadyClock]:
    clock = SteadyClock()
    yield clock
    clock.close()


@pytest.fixture
def opened(clock: SteadyClock) -> Iterator[Callable[..., Journal]]:
    """Open journals, and closes them."""
    journals: list[Journal] = []

    def open_one(file: Path, on_problem: Callable[[str], None] = no_problem) -> Journal:
        journals.append(Journal(file, on_problem, clock))
        return journals[-1]

    yield open_one
    for journal in journals:
        journal.close()


def written(journal: Journal) -> Journal:
    """Return a journal whose lines are on the disk."""
    assert journal.sync(20.0)
    return journal


# -- what is read of a file -------------------------------------------------------------------------------------------


@settings(max_examples=80)
@given(st.lists(LINES, max_size=12))
def test_what_is_written_is_read(lines: list[JournalLine]) -> None:
    found = read_journal(file_of(lines))
    assert (found.corruption, found.torn) == ('', 0)
    assert state_of(list(found.lines)) == state_of(json.loads(json.dumps(lines)))


def test_a_file_that_is_cut_off_at_any_byte_holds_the_lines_before_and_says_so() -> None:
    data = file_of(STORY)
    ends = [len(file_of(STORY[:number])) for number in range(len(STORY) + 1)]
    for cut in range(1, len(data)):
        found = read_journal(data[:cut])
        whole = sum(end <= cut for end in ends) - 1
        assert list(found.lines) == STORY[: max(0, whole)], cut
        assert (found.corruption, bool(found.torn)) == ('', cut not in ends), cut
    assert 'empty' in read_journal(b'').corruption


def test_a_byte_that_is_flipped_costs_its_own_line_and_is_told() -> None:
    data = file_of(STORY)
    source = random.Random(1)
    for place in range(len(data)):
        flipped = bytearray(data)
        flipped[place] ^= 1 << source.randrange(8)
        found = read_journal(bytes(flipped))
        assert found.corruption or found.torn, place
        number = data[:place].count(b'\n')
        # A line break that is no more, or a new one, costs its neighbor, too.
        lost = [line for line in STORY if line not in found.lines]
        assert len(lost) <= 2 and all(
            line in (STORY[number - 1 : number + 1] if number else STORY[:1]) for line in lost
        )
        assert [line for line in STORY if line in found.lines] == list(found.lines)


def test_lines_that_are_swapped_doubled_or_missing_are_told_and_the_others_count() -> None:
    whole = file_of(STORY).splitlines(keepends=True)
    for first in range(len(whole)):
        without = whole[:first] + whole[first + 1 :]
        if first < len(whole) - 1:  # as if it had never been written
            found = read_journal(b''.join(without))
            assert found.corruption
            assert list(found.lines) == [line for number, line in enumerate(STORY, 1) if number != first]
        found = read_journal(b''.join([*whole[: first + 1], *whole[first:]]))
        assert 'as one before' in found.corruption and list(found.lines) == STORY
        for second in range(first):
            swapped = list(whole)
            swapped[first], swapped[second] = swapped[second], swapped[first]
            found = read_journal(b''.join(swapped))
            assert 'has the number' in found.corruption
            assert list(found.lines) == STORY


JSON = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5)),
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.dictionaries(
            st.sampled_from(['begin', 'position', 'end', 'commands', 'run', 'active', 'levels', 'other']), inner
        ),
    ),
    max_leaves=10,
)


@settings(max_examples=100)
@given(st.lists(JSON, min_size=1, max_size=4))
def test_lines_of_any_json_are_told_or_fit(contents: list[Any]) -> None:
    found = read_journal(file_of([STORY[1], *contents, STORY[2]]))
    assert found.lines[0] == STORY[1] and found.lines[-1] == STORY[2]
    assert bool(found.corruption) == (len(found.lines) < len(contents) + 2)
    state_of(list(found.lines))


BAD_PARTS: list[tuple[JournalLine, str]] = [
    ({'begin': begin_of('r') | {'autonomy': 4}}, 'autonomy'),
    ({'begin': {'run': 'r'}}, 'begin'),
    ({'begin': begin_of('r') | {'arguments': [['a']]}}, 'begin'),
    ({'begin': begin_of('r') | {'inputs': [['a', 'b', 'c', '%']]}}, 'begin'),
    ({'run': 'r', 'position': 3}, 'position'),
    ({'run': 'r', 'position': position_of() | {'levels': {'/': 'x'}}}, 'position'),
    ({'run': 'r', 'position': position_of() | {'active': [1]}}, 'position'),
    ({'position': position_of()}, 'which run'),
    ({'end': 'x'}, 'which run'),
    ({'commands': [['a', 1]]}, 'commands'),
    ({'commands': [['a', 300, '']]}, 'commands'),
    ({'autonomy': 4}, 'autonomy'),
    ({'new': 1}, 'new'),
    ({'begin': begin_of('r\ud800')}, 'begin'),  # no message can have it
    ({'begin': begin_of('r') | {'behavior': 'x' * 10_000_000}}, 'begin'),
    ({'commands': [['c\ud800', 1, '']]}, 'commands'),
    ({'run': 'r', 'position': position_of() | {'active': ['/A\ud800']}}, 'position'),
    ({'run': 'r', 'position': position_of() | {'active': ['/A'] * 20_000}}, 'position'),
]


@pytest.mark.parametrize(('line', 'named'), BAD_PARTS)
def test_a_line_of_another_shape_is_named(line: JournalLine, named: str) -> None:
    found = read_journal(file_of([*STORY[:2], line, *STORY[3:]]))
    assert 'line 4' in found.corruption and named in found.corruption
    assert list(found.lines) == [*STORY[:2], *STORY[3:]]


def test_a_file_of_corrupt_lines_alone_is_not_read_to_its_end() -> None:
    found = read_journal(file_of(STORY) + b'\n' * 1_000_000)
    assert list(found.lines) == STORY and 'nothing was read after line' in found.corruption
    found = read_journal(b'\0' * 1_000_000)  # as some file systems leave it after a loss of power
    assert 'does not begin as a journal' in found.corruption and not found.torn


def test_a_journal_of_another_format_is_refused_by_its_number(tmp_path: Path, opened: Any) -> None:
    assert 'does not begin as a journal' in read_journal(b'01234567 {}\n').corruption
    text = b'{"begin":{"run":"r"}}'
    assert 'of format 1,' in read_journal(b'%08x %s\n' % (zlib.crc32(text), text)).corruption
    later = encode_line(0, {'format': FORMAT + 1}) + encode_line(1, STORY[1])
    assert f'of format {FORMAT + 1},' in read_journal(later).corruption
    file = tmp_path / 'e.journal'
    file.write_bytes(later)
    journal = opened(file)
    (aside,) = tmp_path.glob('e.*.corrupt')
    assert aside.read_bytes() == later and str(aside) in journal.corruption
    assert journal.state == JournalState()


# -- the file as it is used -------------------------------------------------------------------------------------------


@settings(max_examples=40, deadline=None)
@given(st.lists(LINES, max_size=8), st.data())
def test_a_journal_that_was_cut_off_goes_on_from_the_lines_before(lines: list[JournalLine], data: Any) -> None:
    lines = json.loads(json.dumps(lines))
    clock = ManualClock()
    with tempfile.TemporaryDirectory() as directory:
        file = Path(directory) / 'e.journal'
        whole = file_of(lines)
        ends = [len(file_of(lines[:number])) for number in range(len(lines) + 1)]
        cut = data.draw(st.integers(ends[0], len(whole)), label='cut')
        file.write_bytes(whole[:cut] + data.draw(st.sampled_from([b'', b'\0' * 40]), label='rest'))
        survived = lines[: sum(end <= cut for end in ends) - 1]
        journal = Journal(file, no_problem, clock)
        assert journal.state == state_of(survived) and not journal.corruption
        journal.append(begin=begin_of('further'))
        journal.close()
        journal._thread.join()  # a slow disk is waited for
        last = Journal(file, no_problem, clock)
        last.close()
        last._thread.join()
        assert last.state == state_of([*survived, {'begin': begin_of('further')}])
        assert (last.corruption, last.torn) == ('', '')


def test_a_corrupt_file_is_kept_aside_and_told_once(tmp_path: Path, opened: Any) -> None:
    file = tmp_path / 'e.journal'
    data = bytearray(file_of(STORY))
    data[len(file_of(STORY[:3])) + 20] ^= 1
    file.write_bytes(bytes(data))
    journal = written(opened(file))
    (aside,) = tmp_path.glob('e.*.corrupt')
    assert all(text in journal.corruption for text in (str(aside), 'line 5', f'{len(STORY) - 1} lines'))
    assert aside.read_bytes() == data
    assert journal.state == state_of([*STORY[:3], *STORY[4:]])
    journal.close()
    again = opened(file)
    assert (again.state, again.corruption) == (journal.state, '')


def test_what_a_crash_has_cut_off_is_told(tmp_path: Path, opened: Any) -> None:
    file = tmp_path / 'e.journal'
    file.write_bytes(file_of(STORY)[:-3])
    journal = opened(file)
    assert 'cut off' in journal.torn and not journal.corruption
    assert journal.state == state_of(STORY[:-1])


def test_it_stays_small_and_forgets_only_the_oldest_commands(tmp_path: Path, opened: Any) -> None:
    journal = opened(tmp_path / 'e.journal')
    journal.append(begin=begin_of('r'))
    for number in range(30_000):
        journal.append([(f'command-{number}', 1, '')], run='r', position=position_of('/A', 'x' * 50, str(number)))
        if number % 100 == 0:
            assert written(journal).file.stat().st_size < 2_000_000
    expected = journal.state
    journal.close()
    again = written(opened(tmp_path / 'e.journal'))
    assert again.state == expected
    assert len(again.state.commands) == REMEMBERED_COMMANDS
    assert again.state.position['active'][-1] == '29999'
    assert again.file.stat().st_size < 200_000


def test_a_switch_that_comes_beside_the_stop_does_not_begin_the_run_again(tmp_path: Path, opened: Any) -> None:
    journal = opened(tmp_path / 'e.journal')
    journal.append(begin=begin_of('r'))
    journal.append(run='r', end='stopped by tester')  # on the executor's thread; below: on that of the run
    journal.append([('switch', 1, '')], run='r', position=position_of('/B'), begin=begin_of('r'))
    assert journal.state.begin is None and journal.state.position is None
    assert 'switch' in journal.state.commands


def test_a_file_system_without_locks_is_told_as_what_it_is(
    tmp_path: Path, opened: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(descriptor: int, operation: int) -> None:
        raise OSError(errno.ENOLCK, 'No locks available')

    monkeypatch.setattr(fcntl, 'flock', fail)
    with pytest.raises(OnboardError, match='No locks available'):
        opened(tmp_path / 'e.journal')


def test_two_executives_do_not_share_a_journal(tmp_path: Path, opened: Any) -> None:
    journal = opened(tmp_path / 'e.journal')
    with pytest.raises(OnboardError, match='in use by another'):
        opened(tmp_path / 'e.journal')
    journal.append(begin=begin_of('first'))
    journal.close()
    second = opened(tmp_path / 'e.journal')
    journal.append(begin=begin_of('too late'))
    second.append(run='first', position=position_of('/A'))
    second.close()
    assert opened(tmp_path / 'e.journal').state.begin == begin_of('first')


def test_a_directory_that_cannot_be_used_is_refused_by_name(tmp_path: Path, opened: Any) -> None:
    (tmp_path / 'file').write_text('')
    with pytest.raises(OnboardError, match='journal_directory'):
        opened(tmp_path / 'file' / 'e.journal')


# -- disks that fail --------------------------------------------------------------------------------------------------

FULL_DISK = """
import resource, signal, sys
from pathlib import Path
from flexbt_core.clock.clock import SteadyClock
from flexbt_onboard.persistence.journal import Journal
from flexbt_testing.waiting import wait_until
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))
problems = []
clock = SteadyClock()
journal = Journal(Path(sys.argv[1]), problems.append, clock)
journal.append(begin={'run': 'r', 'behavior': 'B', 'arguments': [], 'inputs': [], 'by': '', 'autonomy': 1})
def at(*active):
    journal.append(
        run='r', position={'active': active, 'coming': [], 'levels': {}, 'locked': [], 'breakpoints': []}
    )
    assert journal.sync(20.0)
for number in range(3):
    at('/A')
    assert len(problems) == 2 * number, problems
    at('x' * 3000)
    assert len(problems) == 2 * number + 1 and 'cannot be written' in problems[-1], problems
    at('/B')
    wait_until(lambda: len(problems) == 2 * number + 2, problems)
    assert problems[-1] == '', problems
at('/Last')
journal.close()
clock.close()
"""


@pytest.mark.dds('a process whose files the system limits')
def test_a_full_disk_is_told_once_each_time_and_what_fits_again_is_whole(tmp_path: Path, opened: Any) -> None:
    file = tmp_path / 'e.journal'
    subprocess.run([sys.executable, '-c', FULL_DISK, str(file)], check=True, timeout=60, env=os.environ)
    journal = opened(file)
    assert (journal.state.begin['run'], journal.state.position['active'], journal.corruption) == ('r', ['/Last'], '')


def test_a_journal_is_for_the_user_alone_and_nothing_beside_it_is_overwritten_by_it(
    tmp_path: Path, opened: Callable[..., Journal]
) -> None:
    other = tmp_path / 'other'
    other.write_text('of the user')
    (tmp_path / 'node.fresh').symlink_to(other)
    journal = written(opened(tmp_path / 'node.journal'))
    journal.append(**begin_of('r'))
    written(journal)
    assert other.read_text() == 'of the user'
    assert {file.name: oct(file.stat().st_mode)[-3:] for file in tmp_path.glob('node.*')} == {
        'node.journal': '600',
        'node.lock': '600',
    }


@pytest.mark.parametrize('kind', ['pipe', 'device', 'link'])
def test_what_never_ends_or_is_of_somebody_else_is_no_journal(kind: str, tmp_path: Path, opened: Any) -> None:
    file = tmp_path / 'node.journal'
    if kind == 'pipe':
        os.mkfifo(file)
    elif kind == 'device':
        file.symlink_to('/dev/zero')
    else:
        (tmp_path / 'other').write_bytes(file_of([begin_of('r')]))
        file.symlink_to(tmp_path / 'other')
    with pytest.raises(OnboardError, match=r'journal_directory: .*node\.journal cannot be used'):
        opened(file)


def test_a_directory_that_disappears_is_told_and_made_again(tmp_path: Path, opened: Any) -> None:
    told: list[str] = []
    file = tmp_path / 'journals' / 'e.journal'
    journal = written(opened(file, told.append))
    journal.append(begin=begin_of('r'))
    written(journal)
    for gone in (tmp_path / 'moved', None):
        told.clear()
        if gone is None:
            shutil.rmtree(file.parent)
        else:
            file.parent.rename(gone)
        journal.append(run='r', position=position_of(f'/{gone}'))
        assert journal.sync(20.0)
        assert 'moved or removed' in told[0]
        wait_until(lambda: told[1:] == [''], 'journal written again')
        assert state_of(list(read_journal(file.read_bytes()).lines)) == journal.state
        with pytest.raises(OnboardError, match='in use by another'):
            opened(file)


def test_a_directory_that_cannot_be_synced_is_told_and_costs_no_files(
    tmp_path: Path, opened: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []
    failed: list[int] = []

    def sync(descriptor: int) -> None:
        if stat.S_ISDIR(os.fstat(descriptor).st_mode):
            failed.append(descriptor)
            raise OSError(errno.EIO, 'the disk is broken')

    monkeypatch.setattr(os, 'fsync', sync)
    monkeypatch.setattr(journal_module, 'RETRY_SECONDS', 0.01)
    files = len(list(Path('/proc/self/fd').iterdir()))
    opened(tmp_path / 'e.journal', told.append)
    wait_until(lambda: len(failed) > 50, 'the attempts')
    assert len(list(Path('/proc/self/fd').iterdir())) < files + 25
    assert len(told) == 1 and 'the disk is broken' in told[0]


class SlowDisk:
    """Lets fdatasync and fsync wait until it is told to go on, and then raise ``error`` if there is one."""

    error: OSError | None = None

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.goes = threading.Event()
        self.entered = threading.Event()
        for name in ('fdatasync', 'fsync'):
            monkeypatch.setattr(f'os.{name}', self._waiting(getattr(os, name)))

    def _waiting(self, real: Callable[[int], None]) -> Callable[[int], None]:
        def wait(descriptor: int) -> None:
            self.entered.set()
            assert self.goes.wait(60.0)
            if self.error is not None:
                raise self.error
            real(descriptor)

        return wait


def test_nobody_waits_for_a_slow_disk_but_who_wants_to_know(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock, told, done = ManualClock(), list[str](), list[str]()
    journal = Journal(tmp_path / 'e.journal', told.append, clock)
    written(journal)
    disk = SlowDisk(monkeypatch)
    journal.append(begin=begin_of('r'))
    journal.when_durable(lambda: done.append('first'))
    journal.append(run='r', position=position_of('/A'))
    journal.when_durable(lambda: done.append('second'))
    assert disk.entered.wait(60.0) and not done
    disk.goes.set()
    wait_until(lambda: done == ['first', 'second'], lambda: done)
    disk.goes.clear()
    disk.entered.clear()
    journal.append(run='r', position=position_of('/B'))
    journal.when_durable(lambda: done.append('third'))
    assert disk.entered.wait(60.0)
    clock.advance(STUCK_SECONDS - 0.1)
    assert (told, done[2:]) == ([], [])
    clock.advance(0.2)  # told first, and then not waited for
    assert 'does not answer' in told[0] and done[2:] == ['third']
    journal.when_durable(lambda: done.append('at once'))
    assert done[-1] == 'at once'
    disk.goes.set()
    wait_until(lambda: told[1:] == [''], lambda: told)
    journal.close()
    assert state_of(list(read_journal(journal.file.read_bytes()).lines)) == journal.state


def hung(folder: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Journal, SlowDisk, list[str]]:
    """Return a journal whose disk hangs for longer than is usual, the disk, and what is told."""
    clock, told = ManualClock(), list[str]()
    journal = written(Journal(folder / 'e.journal', told.append, clock))
    disk = SlowDisk(monkeypatch)
    journal.append(begin=begin_of('r'))
    assert disk.entered.wait(60.0)
    clock.advance(STUCK_SECONDS + 0.1)
    return journal, disk, told


def test_a_disk_that_hangs_and_then_is_full_is_told_as_both(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    journal, disk, told = hung(tmp_path, monkeypatch)
    disk.error = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    disk.goes.set()
    wait_until(lambda: len(told) > 1, lambda: told)
    journal.close()
    assert 'does not answer' in told[0] and 'No space left' in told[1]


def test_who_opens_a_journal_anew_waits_until_the_disk_has_taken_the_last_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, opened: Any
) -> None:
    journal = written(Journal(tmp_path / 'e.journal', no_problem, ManualClock()))
    disk = SlowDisk(monkeypatch)
    journal.append(begin=begin_of('r'))
    journal.close()
    join = journal._thread.join

    def wait(seconds: float) -> None:
        disk.goes.set()
        join(DEADLINE)

    monkeypatch.setattr(journal._thread, 'join', wait)
    assert opened(journal.file).state.begin == begin_of('r')


def test_lines_that_wait_for_a_disk_are_bounded_and_none_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal = written(Journal(tmp_path / 'e.journal', no_problem, ManualClock()))
    disk = SlowDisk(monkeypatch)
    journal.append(begin=begin_of('r'))
    for number in range(5000):
        journal.append([(str(number), 1, '')], run='r', position=position_of(str(number)))
        assert len(journal._lines) <= 1001
    disk.goes.set()
    written(journal).close()
    assert state_of(list(read_journal(journal.file.read_bytes()).lines)) == journal.state


def test_while_the_disk_hangs_no_lines_wait_for_it_since_each_may_be_large(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal, disk, told = hung(tmp_path, monkeypatch)
    for number in range(100):
        journal.append(run='r', position=position_of(str(number)))
    disk.goes.set()
    wait_until(lambda: told[1:] == [''], lambda: told)
    lines = read_journal(written(journal).file.read_bytes()).lines
    journal.close()
    assert len(lines) == 2 and state_of(list(lines)) == journal.state


# -- values -----------------------------------------------------------------------------------------------------------


def pose(x: float) -> PoseStamped:
    message = PoseStamped()
    message.header.frame_id = 'map'
    message.pose.position.x = x
    return message


FLOATS = st.floats(allow_nan=False)
SCALARS = st.one_of(st.none(), st.booleans(), st.integers(), FLOATS, st.text(), st.binary(), st.builds(pose, FLOATS))
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.lists(inner, max_size=4).map(tuple),
        st.dictionaries(
            st.one_of(st.text(), st.integers(), st.sampled_from(['$map', '$lost', '$'])), inner, max_size=4
        ),
    ),
    max_leaves=12,
)


@given(VALUES)
def test_values_come_back_exactly(value: Any) -> None:
    again = from_plain_form(json.loads(json.dumps(to_plain_form(value))))
    assert again == value
    assert repr(again) == repr(value)  # of the same types, all the way down


def test_not_a_number_and_messages_in_messages_come_back() -> None:
    assert math.isnan(from_plain_form(json.loads(json.dumps(to_plain_form(math.nan)))))
    path = NavPath(poses=[pose(1.0), pose(2.0)])
    assert from_plain_form(to_plain_form({'path': path})) == {'path': path}


class Handle:
    pass


@pytest.mark.parametrize('value', [Handle(), [1, {2: Handle()}], {'a': {Handle: 1}}, {1, 2}, [10**5000]])
def test_what_cannot_be_written_is_named_when_it_is_read(value: Any) -> None:
    plain = json.loads(json.dumps(to_plain_form(value)))
    with pytest.raises(FlexbtError, match=r'type .*could not be written'):
        from_plain_form(plain)


def test_what_is_in_too_many_others_is_named() -> None:
    value: Any = []
    for _ in range(900):
        value = [value]
    with pytest.raises(FlexbtError, match='is in 66 others'):
        from_plain_form(value)


@pytest.mark.parametrize('plain', [{'$message': ['os/system', '']}, {'$message': 3}, {'$bytes': 'ä'}, {'$new': 1}])
def test_nothing_else_is_read(plain: Any) -> None:
    with pytest.raises(FlexbtError):
        from_plain_form(plain)


@pytest.mark.dds('a process is forked')
def test_a_process_that_was_forked_and_lives_on_does_not_keep_the_journal(tmp_path: Path, clock: SteadyClock) -> None:
    journal = Journal(tmp_path / 'e.journal', no_problem, clock)
    begun, begins = os.pipe()
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:  # as a worker of a state whose executive is killed
        os.close(writing)
        os.write(begins, b'.')
        os.read(reading, 1)
        os._exit(0)
    try:
        os.close(begins)
        assert os.read(begun, 1)
        journal.close()
        Journal(tmp_path / 'e.journal', no_problem, clock).close()
    finally:
        for descriptor in (begun, writing, reading):
            os.close(descriptor)
        os.waitpid(child, 0)

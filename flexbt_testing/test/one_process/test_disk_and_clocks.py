# SPDX-License-Identifier: BSD-3-Clause
"""A disk that is full, slow, hung, or without power, and clocks that jump: what files have, and how missions go on."""

from __future__ import annotations

import errno
import itertools
import os
import re
import shutil
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from simulation_interfaces.srv import ResetSimulation

from flexbt_console.mirror.records import ExecutiveState
from flexbt_console.mirror.view import View
from flexbt_onboard.persistence.journal import read_journal
from flexbt_testing.one_process.graph import DOMAIN
from flexbt_testing.one_process.programs import Program, named_programs
from flexbt_testing.one_process.world import World

KEPT = {'journal_directory': '~/kept', 'event_log_directory': '~/kept'}
LOGGED = {'btlog_directory': '~/kept'}
on_disk = pytest.mark.world(motion='abstract', executive=KEPT, server=LOGGED)


@pytest.fixture
def bare() -> Iterator[World]:
    """Yield a world without a robot."""
    with World(7, [Program('', 'idle', main=lambda: time.sleep(1e6))]) as made:
        yield made


def opened(name: str) -> int:
    return os.open(Path.home() / name, os.O_WRONLY | os.O_CREAT | os.O_APPEND)


def logged() -> str:
    """Return what the programs have logged so far."""
    return '\n'.join(text for _, process, _, _, text in DOMAIN.log if process.name != 'world')


def is_interrupted(view: View) -> bool:
    return view.snapshot is not None and view.snapshot.state is ExecutiveState.INTERRUPTED


# ------------------------------------------------------------------------------------------------------------ the disk


def test_what_was_appended_without_a_sync_is_lost_torn_or_whole(bare: World) -> None:
    def append() -> None:
        file = opened('log')
        os.write(file, b'synced\n')
        os.fsync(file)
        os.fsync(os.open(Path.home(), os.O_RDONLY))
        os.write(file, b'not synced\n')
        time.sleep(1e6)

    found = []
    for _ in range(40):
        bare.launch(append)
        bare.run(1.0)
        bare.lose_power('append')
        found.append((bare.home / 'log').read_bytes())
        (bare.home / 'log').unlink()
    whole = b'synced\nnot synced\n'
    assert all(whole.startswith(one) and len(one) >= len(b'synced\n') for one in found)
    assert {b'synced\n', whole} < set(found)


def test_a_file_that_replaces_another_does_so_at_the_sync_of_the_directory(bare: World) -> None:
    (bare.home / 'file').write_text('old')

    def replace(is_synced: bool) -> None:
        fresh = opened('fresh')
        os.write(fresh, b'new')
        os.fsync(fresh)
        (Path.home() / 'fresh').replace(Path.home() / 'file')
        if is_synced:
            os.fdatasync(os.open(Path.home(), os.O_RDONLY))
        time.sleep(1e6)

    def replace_and_sync() -> None:
        replace(True)

    found = set()
    for _ in range(20):
        bare.launch(lambda: replace(False))
        bare.run(1.0)
        bare.lose_power('<lambda>')
        found.add((bare.home / 'file').read_text())
        (bare.home / 'file').write_text('old')
    assert found == {'old', 'new'}
    for _ in range(20):
        bare.launch(replace_and_sync)
        bare.run(1.0)
        bare.lose_power('replace_and_sync')
        assert (bare.home / 'file').read_text() == 'new'


def test_a_file_that_is_renamed_or_removed_keeps_a_name_or_is_gone(bare: World) -> None:
    def rotate() -> None:
        for old, new in (('log.1', 'log.2'), ('log', 'log.1')):
            (Path.home() / old).rename(Path.home() / new)
        os.write(opened('log'), b'C')
        os.close(opened('gone'))
        (Path.home() / 'gone').unlink()
        time.sleep(1e6)

    names = ('log', 'log.1', 'log.2', 'gone')
    found = set()
    for _ in range(20):
        for name, text in zip(names, 'ABxD', strict=True):
            (bare.home / name).write_text(text)
        (bare.home / 'log.2').unlink()
        bare.launch(rotate)
        bare.run(1.0)
        bare.lose_power('rotate')
        left = [bare.home / name for name in names]
        found.add(tuple(one.read_text() if one.exists() else None for one in left))
    before, after = {('A', 'B', None)}, {('C', 'A', 'B'), ('', 'A', 'B')}
    assert {one[:3] for one in found} == before | after
    assert {one[3] for one in found} == {'D', None}


def test_a_file_that_is_written_anew_may_be_cut_anywhere(bare: World) -> None:
    def write() -> None:
        (Path.home() / 'file').write_text('new and long')
        time.sleep(1e6)

    found = set()
    for _ in range(60):
        (bare.home / 'file').write_text('old')
        bare.launch(write)
        bare.run(1.0)
        bare.lose_power('write')
        found.add((bare.home / 'file').read_text())
    assert {'old', '', 'new and long'} < found
    assert all('new and long'.startswith(one) for one in found - {'old'})


def test_a_process_that_is_killed_leaves_what_it_has_written(bare: World) -> None:
    def append() -> None:
        os.write(opened('log'), b'not synced\n')
        time.sleep(1e6)

    found = set()
    for _ in range(20):
        bare.launch(append)
        bare.run(1.0)
        bare.kill('append')
        assert (bare.home / 'log').read_bytes() == b'not synced\n'
        bare.lose_power()
        found.add((bare.home / 'log').exists())
        (bare.home / 'log').unlink(missing_ok=True)
    assert found == {True, False}, 'that of the computer takes it, too'


def test_a_full_disk_takes_a_part(bare: World) -> None:
    told: list[Any] = []

    def write() -> None:
        file = opened('log')
        told.append(os.write(file, b'12345'))
        for _ in range(2):
            try:
                told.append(os.write(file, b'67890'))
            except OSError as error:
                told.append(error.errno)
        bare.disk.clear()
        told.append(os.write(file, b'67890'))

    bare.disk.fill(leaving=8)
    program = bare.launch(write)
    bare.run_while(lambda: program.is_alive, 'the program')
    assert told == [5, 3, errno.ENOSPC, 5]


def test_a_file_is_copied_onto_the_disk(bare: World) -> None:
    told: list[Any] = []

    def copy() -> None:
        source = Path.home() / 'source'
        source.write_bytes(b'12345')
        shutil.copyfile(source, Path.home() / 'first')
        bare.disk.fill(leaving=2)
        try:
            shutil.copyfile(source, Path.home() / 'second')
        except OSError as error:
            told.append(error.errno)

    program = bare.launch(copy)
    bare.run_while(lambda: program.is_alive, 'the program')
    assert told == [errno.ENOSPC]
    assert (bare.home / 'first').read_bytes() == b'12345'


def test_plain_files_of_python_are_on_the_disk(bare: World) -> None:
    told: list[Any] = []

    def note() -> None:
        with (Path.home() / 'log').open('w') as file:
            file.write('kept\n')
            file.flush()
            os.fsync(file.fileno())
            os.fsync(os.open(Path.home(), os.O_RDONLY))
            print('not synced', file=file, flush=True)
            print('in the buffer', file=file)
            time.sleep(10.0)
            for write in (file.flush, lambda: (Path.home() / 'other').write_bytes(b'too much')):
                try:
                    write()
                except OSError as error:
                    told.append(error.errno)
        told.append((Path.home() / 'log').read_text())

    for lost in range(20):
        process = bare.launch(note)
        bare.run(1.0)
        if lost == 0:
            bare.disk.fill()
            bare.run(20.0)
            bare.disk.clear()
            assert process.exit_code != 0, 'closing the file fails as well'
            assert told == [errno.ENOSPC] * 2
            continue
        bare.lose_power('note')
        told.append((bare.home / 'log').read_text())
    assert 'kept\nnot synced\n'.startswith(min(told[2:], key=len))
    assert {'kept\n', 'kept\nnot synced\n'} < set(told[2:]), 'lost, whole, or cut; never what was in the buffer'


def test_a_sync_takes_its_time_and_a_hung_disk_answers_later(bare: World) -> None:
    times: list[float] = []

    def write() -> None:
        file = opened('log')
        os.write(file, b'x')
        times.append(bare.now)
        os.fsync(file)
        times.append(bare.now)
        bare.disk.hang()
        os.write(file, b'x')
        times.append(bare.now)

    bare.disk.delay = 0.5
    program = bare.launch(write)
    bare.run(5.0)
    assert times[1] - times[0] == pytest.approx(0.5, abs=0.01)
    assert len(times) == 2
    bare.disk.go_on()
    bare.run_while(lambda: program.is_alive, 'the program')
    assert times[2] - times[1] > 4.0


def test_threads_that_write_one_file_wait_for_a_hung_disk_together(bare: World) -> None:
    def write() -> None:
        with (Path.home() / 'log').open('w') as file:
            threads = [threading.Thread(target=lambda: print('x', file=file, flush=True)) for _ in range(2)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()

    bare.disk.hang()
    program = bare.launch(write)
    bare.run(1.0)
    assert program.is_alive
    bare.disk.go_on()
    bare.run_while(lambda: program.is_alive, 'the program')
    assert (bare.home / 'log').read_text() == 'x\nx\n'


# ---------------------------------------------------------------------------------------------------------- missions


@on_disk
def test_a_mission_goes_on_with_a_full_disk(world: World) -> None:
    world.start('Navigate')
    world.disk.fill(leaving=30)
    world.answer('/AskGoal', 'kitchen')
    world.run_until(world.asks('/AskGoal'), within=90)
    assert world.robot.near('kitchen')
    for what in ('the journal', 'the event log'):
        assert re.search(rf'{what} \S+ cannot be written: .*No space left on device', logged())
    assert re.search('the log of this run ends here: .*No space left on device', logged())
    world.disk.clear()
    world.answer('/AskGoal', 'dock')
    world.run(2.0)
    world.lose_power('onboard_executive')
    [journal] = (world.home / 'kept').glob('*.journal')
    assert not read_journal(journal.read_bytes()).corruption
    world.restart('onboard_executive')
    world.run_until(is_interrupted)
    world.resume()
    world.run_until(world.asks('/AskGoal'), within=90)
    assert world.robot.near('dock')


def test_nothing_that_was_shown_is_lost_with_the_power(tmp_path: Path) -> None:
    torn: list[bool] = []
    for seed in itertools.takewhile(lambda seed: len(set(torn)) < 2 and seed < 9, itertools.count()):
        programs = named_programs('', tmp_path, tmp_path, 'abstract', executive=KEPT)
        with World(seed, programs) as world:
            world.start('Navigate')
            world.answer('/AskGoal', 'kitchen')
            world.run_until(lambda view: view.active_paths == ('/Drive',))
            world.disk.delay = 1.0
            world.run_while(lambda: world.transitions[-1] != ('/Drive', 'done'), 'the drive')
            world.run(0.5)
            assert world.view.active_paths == ('/Drive',), 'what is not on the disk is not shown'
            world.lose_power('onboard_executive')
            world.disk.delay = 0.0
            [journal] = (world.home / 'kept').glob('*.journal')
            found = read_journal(journal.read_bytes())
            assert not found.corruption
            torn.append(bool(found.torn))
            world.restart('onboard_executive')
            world.run_until(is_interrupted)
            assert ('was cut off when the executive ended' in logged()) == torn[-1]
            world.resume()
            world.run_until(world.asks('/AskGoal'), within=90)
            assert world.robot.near('kitchen')
    assert len(set(torn)) == 2, 'a line that was cut off, and none'


@on_disk
def test_a_slow_disk_holds_nobody_up(world: World) -> None:
    world.start('Navigate')
    world.answer('/AskGoal', 'kitchen')
    world.disk.delay = 1.9
    world.run(5.0)
    assert not world.robot.at_rest
    stopped: list[float] = []

    def stop() -> None:
        world.stop()
        stopped.append(world.now)

    began = world.now
    world.at(began, stop)
    while world.view.running or not stopped:
        assert world.view.live
        assert world.robot.at_rest or world.now - began < 1.0
        assert world.now - began < 10.0
        world.run(0.05)
    assert stopped[0] - began < 1.0
    assert world.now - began > 1.9, 'the end is shown when it is on the disk'
    assert 'does not answer' not in logged()


# ------------------------------------------------------------------------------------------------------------ clocks


@pytest.mark.world(motion='abstract')
def test_a_mission_does_not_notice_that_the_system_clock_jumps(world: World) -> None:
    world.start('Navigate')
    lengths = []
    for jumps in ((), (3600.0, -7200.0)):
        for place in ('kitchen', 'dock'):
            world.answer('/AskGoal', place)
            began = world.now
            for number, seconds in enumerate(jumps):
                world.at(began + 3.0 + number, partial(world.jump_clock, seconds))
            while not world.asks('/AskGoal')(world.view):
                assert world.view.live
                assert world.now - began < 90.0
                world.run(0.05)
            assert world.robot.near(place)
            lengths.append(world.now - began)
    assert lengths[2:] == pytest.approx(lengths[:2], abs=0.3)
    assert world.wall == pytest.approx(1_700_000_000 + world.now - 7200.0)


def test_a_mission_goes_on_when_the_simulated_time_begins_again(world: World) -> None:
    world.start('Navigate')
    world.answer('/AskGoal', 'kitchen')
    world.run(5.0)
    assert world.robot.length > 0.5
    request = ResetSimulation.Request(scope=ResetSimulation.Request.SCOPE_TIME)
    response = world.ask(ResetSimulation, 'reset_simulation', request)
    assert response.result.result == response.result.RESULT_OK, response.result.error_message
    world.run_until(lambda view: bool(view.decisions), within=90)
    while '/Drive' in world.decisions:
        world.choose('/Drive', 'failed')
        world.answer('/AskGoal', 'kitchen')
        world.run_until(lambda view: bool(view.decisions), within=90)
    assert world.robot.near('kitchen')

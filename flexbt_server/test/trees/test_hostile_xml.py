# SPDX-License-Identifier: BSD-3-Clause
"""Broken and hostile documents through the loader of the live server and through ``bt_tool check``: refused in time,
with place and reason, and without harm."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from flexbt_core.behavior_tree.model.errors import TreeLoadError
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_msgs.action import BtExecute, BtLoad
from flexbt_msgs.msg import BtLoadReport
from flexbt_testing.behavior_trees.bt_tool import ACCEPTED, BROKEN_IN_MANY_PLACES, CORPUS, TREE, tool
from flexbt_testing.nodes.server_world import ServerWorld, open_server_world
from flexbt_testing.waiting import processor_time, wait_until

Result = BtLoad.Result
IN_TIME = 10.0
"""Seconds of processor time, some ten times what it takes: what is hostile would take minutes, or have no end."""
MEMORY = 50e6


@pytest.fixture(scope='module')
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return where the server may read files."""
    return tmp_path_factory.mktemp('trees')


@pytest.fixture(scope='module')
def world(directory: Path) -> Iterator[ServerWorld]:
    with open_server_world(allowed_directories=[str(directory)]) as opened:
        wait_until(opened.client.loader.is_ready)
        yield opened


@pytest.fixture(autouse=True)
def bounded_memory() -> Iterator[None]:
    def resident() -> int:
        return int(Path('/proc/self/statm').read_text().split()[1]) * os.sysconf('SC_PAGE_SIZE')

    before = resident()
    yield
    assert resident() - before < MEMORY


def refused(world: ServerWorld, file: Path) -> list[BtLoadReport]:
    """Return the reports of a file that must not be loaded."""
    began = processor_time()
    result = world.client.load(str(file))
    assert processor_time() - began < IN_TIME
    assert result.code == Result.FAILURE, result.message
    assert len(result.message) < 2000
    return list(result.reports)


@pytest.mark.parametrize('name', CORPUS)
def test_the_server_refuses_in_time_and_says_where(world: ServerWorld, directory: Path, name: str) -> None:
    content, words = CORPUS[name]
    file = directory / 'hostile.xml'
    file.write_bytes(content)
    if not words:
        began = processor_time()
        world.client.load(str(file))
        assert processor_time() - began < IN_TIME
        return
    (report,) = refused(world, file)
    first = report.errors[0]
    assert words in first.message
    assert first.file == str(file) and first.line >= 1 and first.column >= 1
    assert world.client.execute(str(file)).result.code == BtExecute.Result.ERROR


@pytest.mark.parametrize('name', CORPUS)
def test_the_command_refuses_in_time_and_says_where(tmp_path: Path, name: str) -> None:
    content, words = CORPUS[name]
    file = tmp_path / 'hostile.xml'
    file.write_bytes(content)
    began = processor_time()
    done = tool('check', str(file))
    assert processor_time() - began < IN_TIME
    if words:
        assert done.code == 1
        first = done.out.splitlines()[0]
        assert first.startswith(f'{file}:') and words in first
    assert not set(done.out) - {'\n'} - {chr(code) for code in range(32, 127)} - {'é', '…'}
    assert max(map(len, done.out.splitlines()), default=0) < 2000
    assert 'Traceback' not in done.err


@pytest.mark.parametrize('name', ACCEPTED)
def test_what_looks_odd_but_is_fine_is_loaded(world: ServerWorld, directory: Path, tmp_path: Path, name: str) -> None:
    file = directory / 'odd.xml'
    file.write_bytes(ACCEPTED[name])
    began = processor_time()
    result = world.client.load(str(file))
    assert processor_time() - began < IN_TIME
    assert result.code == Result.SUCCESS, result.message
    assert tool('check', str(file), '--ignore', 'never-written').code == 0


def test_a_file_that_ends_too_early_is_refused_wherever_it_ends(world: ServerWorld, directory: Path) -> None:
    content = TREE.encode()
    registry = builtin_registry()
    lines = TREE.count('\n') + 1
    file = directory / 'short.xml'
    for size in range(len(content)):
        with pytest.raises(TreeLoadError) as caught:
            load_xml(content[:size], 'short.xml', registry)
        assert all(1 <= error.line <= lines and error.column >= 1 for error in caught.value.errors)
        if size % 23 == 0:
            file.write_bytes(content[:size])
            refused(world, file)
            assert tool('check', str(file)).code == 1


def test_all_errors_of_a_file_are_reported_with_their_places(world: ServerWorld, directory: Path) -> None:
    file = directory / 'many.xml'
    file.write_text(BROKEN_IN_MANY_PLACES)
    done = tool('check', str(file), '--json')
    assert done.code == 1
    lines = [line for line in tool('check', str(file)).out.splitlines() if ': error: ' in line]
    unknown = [line for line in lines if ', [Nope49] are not registered; ' in line]
    assert len(unknown) == 1 and unknown[0].startswith(f'{file}:3:')
    others = [line for line in lines if line not in unknown]
    assert len(others) == 1 + 3 * 50
    for number, line in enumerate(others[1:]):
        assert line.startswith(f'{file}:{3 + number // 3}:')
    (report,) = refused(world, file)
    assert [error.line for error in report.errors] == [2] + [
        3 + number // 4 for number in range(len(report.errors) - 1)
    ]
    assert f'(and {4 * 50} more errors)' in world.client.load(str(file)).message


def test_a_file_of_100_mb_is_not_read(world: ServerWorld, directory: Path) -> None:
    file = directory / 'huge.xml'
    with file.open('wb') as content:
        content.write(TREE.encode())
        content.truncate(100_000_000)
    (report,) = refused(world, file)
    assert 'limit' in report.errors[0].message
    assert tool('check', str(file)).code == 1


def include(path: str, package: str = '') -> str:
    attributes = f'path="{path}"' + (f' ros_pkg="{package}"' if package else '')
    return f'<root BTCPP_format="4">\n<include {attributes}/></root>'


def test_includes_lead_nowhere_but_to_files_that_are_allowed(
    world: ServerWorld, directory: Path, tmp_path: Path
) -> None:
    secret = tmp_path / 'secret.xml'
    secret.write_text('<root>\nthe secret</root>')
    (directory / 'link.xml').symlink_to(secret)
    (directory / 'links').symlink_to(tmp_path)
    (directory / 'loop.xml').symlink_to(directory / 'loop.xml')
    (directory / 'dangling.xml').symlink_to(directory / 'nowhere.xml')
    os.mkfifo(directory / 'fifo.xml')
    (directory / 'a').mkdir()
    (directory / 'self.xml').write_text(include('self.xml'))
    (directory / 'a/one.xml').write_text(include('../two.xml'))
    (directory / 'two.xml').write_text(include('a/one.xml'))
    (directory / 'deep.xml').write_text(include('a/../a/./one.xml'))
    forbidden = os.path.relpath(secret, directory)
    cases = {
        str(secret): 'allowed', forbidden: 'allowed', 'link.xml': 'allowed', 'links/secret.xml': 'allowed',
        '/etc/passwd': 'allowed', '/proc/self/environ': 'allowed', '/dev/zero': 'allowed', 'loop.xml': 'no such file',
        'dangling.xml': 'no such file', 'fifo.xml': 'not a file', 'a': 'not a file', '': 'not a file',
        'file:///etc/passwd': 'no such file', 'http://127.0.0.1:9/a.xml': 'no such file', '~/a.xml': 'no such file',
        '&#10;': 'no such file', 'x' * 5000: 'xxx ... xxx', '../' * 50 + 'etc/passwd': 'allowed',
        'self.xml': 'included by itself', 'two.xml': 'included by itself', 'deep.xml': 'included by itself',
    }  # fmt: skip
    file = directory / 'including.xml'
    for path, words in cases.items():
        file.write_text(include(path))
        errors = [error for report in refused(world, file) for error in report.errors]
        told = ' '.join(error.message for error in errors)
        assert words in told, (path, told)
        assert 'the secret' not in told and 'root:' not in told
        assert all(error.line == 2 for error in errors)
    packages = {'no_such_package': 'no_such_package', '..': '..', 'flexbt_msgs': 'no such file', '/etc': 'package'}
    for package, words in packages.items():
        file.write_text(include('../../passwd' if package == '..' else 'passwd', package))
        assert words in ' '.join(error.message for report in refused(world, file) for error in report.errors)
    for name in ('link.xml', 'links/secret.xml', 'loop.xml', 'fifo.xml', 'a', '../x', '.', 'a\ufffd'):
        refused(world, directory / name)

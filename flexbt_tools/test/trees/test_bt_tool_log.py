# SPDX-License-Identifier: BSD-3-Clause
"""Log files: ``bt_tool log`` prints what ``bt_tool run`` printed; files that are cut off or no logs do no harm."""

from __future__ import annotations

import contextlib
import json
import resource
import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexbt_server.groot2.log_file import LogError, read_log
from flexbt_testing.behavior_trees.bt_tool import tool
from flexbt_testing.behavior_trees.random_trees import wheel_case

TREE = """<root BTCPP_format="4" main_tree_to_execute="Main">
<BehaviorTree ID="Main"><Sequence name="&lt;top&gt;"><Script code="n := 0"/>
<RetryUntilSuccessful num_attempts="3"><Sequence><Sleep msec="1500"/><SubTree ID="Sub" name="inner" n="{n}"/></Sequence>
</RetryUntilSuccessful></Sequence></BehaviorTree>
<BehaviorTree ID="Sub"><ScriptCondition code="n &gt; 1" _onFailure="n := n + 1"/></BehaviorTree></root>"""


def logged(directory: Path, xml: str) -> tuple[str, Path]:
    """Return what a run has printed of its transitions, and its log."""
    (directory / 'tree.xml').write_text(xml)
    log = directory / 'run.btlog'
    # A mock that no node needs is refused, as is a node that needs one.
    for mocks in ((), ('*=SUCCESS,FAILURE',), ('Deco=pass',), ('*=SUCCESS,FAILURE', 'Deco=pass')):
        words = [word for mock in mocks for word in ('--mock', mock)]
        done = tool('run', '--timeout', '30', *words, '--btlog', str(log), str(directory / 'tree.xml'))
        if done.code != 3:
            break
    assert done.code in (0, 1, 4, 5), done.err
    return ''.join(line + '\n' for line in done.out.splitlines() if ' -> ' in line), log


@pytest.mark.parametrize('seed', [None, *range(12)])
def test_a_log_is_what_was_printed(tmp_path: Path, seed: int | None) -> None:
    """The halt at the end follows, which is not printed."""
    printed, log = logged(tmp_path, TREE if seed is None else wheel_case(seed)['xml'])
    done = tool('log', str(log))
    assert done.code == 0
    head, _, lines = done.out.partition('\n')
    assert lines.startswith(printed)
    assert f'{lines.count(chr(10))} transitions' in head
    assert {line.split()[3] for line in lines[len(printed) :].splitlines()} <= {'IDLE'}
    if seed is None:
        assert '1.500  IDLE    -> RUNNING  inner' in lines
        events = [json.loads(line) for line in tool('log', '--json', str(log)).out.splitlines()]
        assert [event['path'] for event in events] == [line.split(maxsplit=4)[4] for line in lines.splitlines()]
        assert {'ScriptCondition', 'Sub', 'Sequence'} < {event['type'] for event in events}


def test_a_log_that_is_cut_off_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    _, path = logged(tmp_path, TREE)
    whole = path.read_bytes()
    full = read_log(path)
    start = len(whole) - 9 * len(full.transitions)
    for size in [*range(0, start, 41), *range(start - 9, len(whole))]:
        path.write_bytes(whole[:size])
        if size < start:
            with pytest.raises(LogError, match=r'run\.btlog'):
                read_log(path)
        else:
            cut = read_log(path)
            assert cut.transitions == full.transitions[: (size - start) // 9]
            assert cut.left_over == (size - start) % 9
    assert tool('log', str(path)).err.endswith('the last 8 bytes are not a whole transition\n')


def test_a_disk_that_is_full_leaves_a_log_of_whole_rounds_or_none(tmp_path: Path) -> None:
    _, path = logged(tmp_path, TREE)
    whole, full = path.read_bytes(), read_log(path)
    start = len(whole) - 9 * len(full.transitions)
    words = ('run', '--quiet', '--btlog', str(path), str(tmp_path / 'tree.xml'))
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    sizes = set()
    for size in (100, start - 1, *range(start, len(whole), 23)):
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
        try:
            assert 'the log of this run ends here: [Errno 27] File too large' in tool(*words).err
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        assert path.exists() == (size >= start)
        if path.exists():
            cut = read_log(path)
            assert cut.left_over == 0 and cut.transitions == full.transitions[: len(cut.transitions)]
            sizes.add(len(cut.transitions))
    assert len(sizes) > 2


@given(xml=st.binary() | st.text().map(str.encode), tail=st.binary(), length=st.none() | st.integers(-10, 1 << 31 - 1))
def test_any_bytes_are_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, xml: bytes, tail: bytes, length: int | None
) -> None:
    path = tmp_path_factory.getbasetemp() / 'any.btlog'
    said = len(xml) if length is None else length
    for data in (xml, b'BTCPP4-FileLogger2\1' + struct.pack('<i', said) + b'<root>' + xml + b'</root>' + tail):
        path.write_bytes(data)
        with contextlib.suppress(LogError):
            read_log(path)


def test_where_no_log_can_be_written_or_read(tmp_path: Path) -> None:
    (tmp_path / 'tree.xml').write_text(TREE)
    tree = str(tmp_path / 'tree.xml')
    for name, words in (
        ('no/run.btlog', ('run', tree, '--btlog')),
        ('run.txt', ('run', tree, '--btlog')),
        ('nothing.btlog', ('log',)),
    ):
        done = tool(*words, str(tmp_path / name))
        assert done.code == 2
        assert name in done.err
    assert 'pipe or device' in tool('log', '/dev/zero').err
    done = tool('log', tree, '--json')
    assert done.code == 3 and 'not a log file' in json.loads(done.out)['findings'][0]['message']

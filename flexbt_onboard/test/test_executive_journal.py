# SPDX-License-Identifier: BSD-3-Clause
"""The journal: what was written is read again, wherever the writing was cut off, and values come back as they were."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped
from hypothesis import given, settings
from hypothesis import strategies as st
from nav_msgs.msg import Path as NavPath

from flexbt_core.errors import FlexbtError
from flexbt_onboard.durability import (
    REMEMBERED_COMMANDS,
    Journal,
    JournalState,
    encode_line,
    from_plain_form,
    to_plain_form,
)
from flexbt_onboard.errors import OnboardError

TEXTS = st.text(st.characters(codec='utf-8'), max_size=8)
LINES = st.one_of(
    st.fixed_dictionaries({'begin': st.fixed_dictionaries({'run': TEXTS})}),
    st.fixed_dictionaries({'position': st.dictionaries(TEXTS, st.integers())}),
    st.fixed_dictionaries({'end': TEXTS}),
    st.fixed_dictionaries({'commands': st.lists(st.tuples(TEXTS, st.integers(1, 2), TEXTS), max_size=3)}),
    st.fixed_dictionaries({'position': st.integers(), 'commands': st.just([('c', 1, '')])}),
)


def no_problem(text: str) -> None:
    raise AssertionError(text)


def state_of(lines: list[dict[str, Any]]) -> JournalState:
    """What lines say."""
    state = JournalState()
    for line in lines:
        state.apply(line)
    return state


@settings(max_examples=60)
@given(st.lists(LINES, max_size=12), st.data())
def test_a_journal_that_is_cut_off_anywhere_holds_the_lines_before(lines: list[dict[str, Any]], data: Any) -> None:
    with tempfile.TemporaryDirectory() as directory:
        file = Path(directory) / 'e.journal'
        journal = Journal(file, no_problem)
        ends = [0]
        for line in lines:
            journal.write(**line)
            ends.append(file.stat().st_size)
        journal.close()
        whole = file.read_bytes()
        cut = data.draw(st.integers(0, len(whole)), label='cut')
        file.write_bytes(whole[:cut] + data.draw(st.sampled_from([b'', b'\0' * 40, b'0badf00d {}\n']), label='rest'))
        again = Journal(file, no_problem)
        survived = sum(end <= cut for end in ends) - 1
        assert again.state == state_of(lines[:survived])
        again.write(position='further')
        again.close()
        last = Journal(file, no_problem)
        assert last.state == state_of([*lines[:survived], {'position': 'further'}])
        last.close()


@pytest.mark.parametrize(
    ('rest', 'is_damage'), [(b'', False), (b'12345678 {"beg', False), (b'\0' * 64, False), (b'00000000 {}\n', True)]
)
def test_damage_that_no_crash_leaves_is_told_and_kept(tmp_path: Path, rest: bytes, is_damage: bool) -> None:
    file = tmp_path / 'e.journal'
    first = encode_line({'begin': {'run': 'r'}})
    data = first + rest + (encode_line({'end': 'over'}) if is_damage else b'')
    file.write_bytes(data)
    journal = Journal(file, no_problem)
    journal.close()
    assert journal.state.begin == {'run': 'r'}
    corrupt = tmp_path / 'e.corrupt'
    assert bool(journal.damage) == corrupt.exists() == is_damage
    if is_damage:
        assert str(corrupt) in journal.damage and 'after 1 lines' in journal.damage
        assert corrupt.read_bytes() == data
    assert Journal(file, no_problem).damage == ''


def test_it_stays_small_and_forgets_only_the_oldest_commands(tmp_path: Path) -> None:
    journal = Journal(tmp_path / 'e.journal', no_problem)
    journal.write(begin={'run': 'r'})
    for number in range(30_000):
        journal.write(commands=[(f'command-{number}', 1, '')], position={'number': number, 'text': 'x' * 50})
        assert number % 1000 or journal.file.stat().st_size < 2_000_000
    expected = journal.state
    journal.close()
    again = Journal(tmp_path / 'e.journal', no_problem)
    assert again.state == expected
    assert len(again.state.commands) == REMEMBERED_COMMANDS
    assert again.state.position['number'] == 29_999
    assert again.file.stat().st_size < 200_000


def test_two_executives_do_not_share_a_journal(tmp_path: Path) -> None:
    journal = Journal(tmp_path / 'e.journal', no_problem)
    with pytest.raises(OnboardError, match='in use by another'):
        Journal(tmp_path / 'e.journal', no_problem)
    journal.write(begin={'run': 'first'})
    journal.close()
    second = Journal(tmp_path / 'e.journal', no_problem)
    journal.write(begin={'run': 'too late'})
    second.write(position=1)
    second.close()
    assert Journal(tmp_path / 'e.journal', no_problem).state.begin == {'run': 'first'}


def test_a_directory_that_cannot_be_used_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / 'file').write_text('')
    with pytest.raises(OnboardError, match='journal_directory'):
        Journal(tmp_path / 'file' / 'e.journal', no_problem)


FULL_DISK = """
import resource, signal, sys
from pathlib import Path
from flexbt_onboard.durability.journal import Journal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))
problems = []
journal = Journal(Path(sys.argv[1]), problems.append)
journal.write(begin={'run': 'r'})
for number in range(100):
    journal.write(position=[number] * (1 if number % 7 else 900))
assert [bool(problem) for problem in problems] == [True, False] * (len(problems) // 2), problems
assert len(problems) > 4
journal.write(position='last')
journal.close()
"""


def test_a_full_disk_is_told_once_each_time_and_what_fits_again_is_whole(tmp_path: Path) -> None:
    file = tmp_path / 'e.journal'
    subprocess.run([sys.executable, '-c', FULL_DISK, str(file)], check=True, timeout=60, env=os.environ)
    journal = Journal(file, no_problem)
    assert (journal.state.begin, journal.state.position) == ({'run': 'r'}, 'last')
    journal.close()


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


@pytest.mark.parametrize('value', [Handle(), [1, {2: Handle()}], {'a': {Handle: 1}}, {1, 2}])
def test_what_cannot_be_written_is_named_when_it_is_read(value: Any) -> None:
    plain = json.loads(json.dumps(to_plain_form(value)))
    with pytest.raises(FlexbtError, match=r'type .*could not be written'):
        from_plain_form(plain)


@pytest.mark.parametrize('plain', [{'$message': ['os/system', '']}, {'$message': 3}, {'$bytes': 'ä'}, {'$new': 1}])
def test_nothing_else_is_read(plain: Any) -> None:
    with pytest.raises(FlexbtError):
        from_plain_form(plain)

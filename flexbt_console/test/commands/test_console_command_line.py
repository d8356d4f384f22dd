# SPDX-License-Identifier: BSD-3-Clause
"""Command lines: parsing and help come from one table."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexbt_console.commands.command_line import check, command_help, overview, parse, prompt_command_help, prompt_help
from flexbt_console.commands.operator_values import autonomy_level
from flexbt_console.commands.registry import COMMANDS, find
from flexbt_console.commands.spec import Send
from flexbt_console.errors import ConsoleError, ExitCode, UsageError
from flexbt_console.mirror.records import NOTE_LENGTH, AutonomyLevel, CommandKind


def test_every_command_has_a_name_of_its_own_and_every_kind_is_sent_by_one() -> None:
    names = [spec.name for spec in COMMANDS]
    assert len(names) == len(set(names))
    sent = {kind for spec in COMMANDS if isinstance(spec.action, Send) for kind in spec.action.kinds}
    assert sent == set(CommandKind)


def in_one_line(text: str) -> str:
    """Text as it was before it was broken into lines."""
    return ' '.join(text.split())


def test_the_help_has_every_command_option_and_exit_code_in_80_columns() -> None:
    text = overview()
    for spec in COMMANDS:
        assert f'  {spec.name} ' in text and spec.summary in in_one_line(text)
        helped = command_help(spec)
        told = {told for option in spec.options for told in (option.name, option.help)} | {spec.summary}
        assert [part for part in told if part not in in_one_line(helped)] == []
    for code in ExitCode:
        assert f'  {code.value} ' in text
    assert max(map(len, text.splitlines())) <= 80


def test_the_help_of_the_prompt_tells_what_each_command_and_option_does_in_80_columns() -> None:
    overview_lines = prompt_help('the robot continues')
    for spec in (spec for spec in COMMANDS if spec.in_prompt):
        assert spec.summary in in_one_line('\n'.join(overview_lines)), spec.name
        helped = prompt_command_help(spec)
        told = [spec.summary, *spec.details, *(option.help for option in spec.options if option.in_prompt)]
        assert [part for part in told if in_one_line(part) not in in_one_line('\n'.join(helped))] == [], spec.name
        assert max(map(len, [*overview_lines, *helped])) <= 80
    assert 'as Ctrl-D does: the robot continues' in in_one_line('\n'.join(overview_lines))


@pytest.mark.parametrize(
    ('words', 'positional', 'options'),
    [
        ('input 1 -2.5 -1e-3', ('1', '-2.5', '-1e-3'), {}),
        ('start Drive a=1 --autonomy 2 b=x --json', ('Drive', 'a=1', 'b=x'), {'--autonomy': ['2'], '--json': []}),
        ('--json --timeout=2 confirm d1', ('d1',), {'--json': [], '--timeout': ['2']}),
        ('input -- --odd', ('--odd',), {}),
        ('start Navigate Split a=1', ('Navigate Split', 'a=1'), {}),
        ('start D --input a=int:1 --input b=int:2', ('D',), {'--input': ['a=int:1', 'b=int:2']}),
    ],
)
def test_parsing(words: str, positional: tuple[str, ...], options: dict[str, list[str]]) -> None:
    line = parse(words.split())
    assert line.words == positional
    assert line.options == options


def test_ros_arguments_are_set_aside() -> None:
    line = parse(['status', '--ros-args', '-r', '__ns:=/robot1', '--', '--json'])
    assert line.ros_arguments == ('--ros-args', '-r', '__ns:=/robot1')
    assert line.has('--json')


@pytest.mark.parametrize(
    'words',
    [
        'statsu', 'start', 'confirm a b', 'autonomy', 'autonomy 4', 'autonomy 1 2 3', 'status --nope', 'force a b c',
        'status --timeout', 'status --timeout 0', 'status --timeout nan', 'status --timeout x', 'status --json=1',
        'start D =1', 'start D a=1 x', 'start D --autonomy most', 'input', 'log 0', 'log x', 'stop --json --json',
        'synthesize', 'synthesize a b', 'synthesize a --file b', 'synthesize a --retries -1',
        'synthesize a --liveness no',
        'synthesize a --cancel', 'synthesize --cancel --goal x', 'synthesize a --time-limit 0',
        'note', 'note ' + 'x' * (NOTE_LENGTH + 1),
    ],
)  # fmt: skip
def test_wrong_usage_is_found_before_anything_is_started(words: str) -> None:
    with pytest.raises(UsageError):
        check(parse(words.split()))


def test_cancel_stands_alone_among_the_options_of_its_command() -> None:
    check(parse(['synthesize', '--cancel', '--operator', 'ann', '--timeout', '2']))


def test_a_near_name_is_suggested() -> None:
    with pytest.raises(UsageError, match="did you mean 'status'"):
        parse(['statsu'])
    with pytest.raises(UsageError, match="did you mean '--autonomy'"):
        parse(['start', 'D', '--autonomie', '1'])


@pytest.mark.parametrize(
    ('words', 'told'),
    [
        ('queue list', 'usage: queue; or one of queue add, queue edit, '),
        ('queue move 3 frist', "'frist': expected first, last or the number of an entry"),
    ],
)
def test_a_wrong_word_is_answered_by_what_can_be_there(words: str, told: str) -> None:
    with pytest.raises(UsageError) as caught:
        check(parse(words.split()))
    assert str(caught.value).startswith(told)


@given(st.lists(st.text(max_size=8), max_size=6))
def test_any_words_are_parsed_or_refused(words: list[str]) -> None:
    try:
        line = parse(words)
        if line.spec.name and not line.has('--help'):
            check(line)
    except ConsoleError as error:
        assert isinstance(error, UsageError)
        assert str(error)


def test_levels_by_name_and_number() -> None:
    assert [autonomy_level(text) for text in ('off', 'LOW', '2', 'Full')] == list(AutonomyLevel)
    assert find('nothing') is None

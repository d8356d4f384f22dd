# SPDX-License-Identifier: BSD-3-Clause
"""Tab in bash and zsh."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexbt_console.commands.command_line import COMMON_OPTIONS
from flexbt_console.commands.completion import as_typed, completion_script, read_line, shell_words
from flexbt_console.commands.registry import COMMANDS
from flexbt_console.mirror.freshness import LinkState
from flexbt_console.mirror.records import Behavior, BehaviorParameter, ExecutiveSnapshot, ExecutiveState
from flexbt_console.mirror.view import View
from flexbt_console.ui.console import main

NOTHING = View(LinkState.LOST, None)
ROBOT = View(
    LinkState.LIVE, 0.1, '', ExecutiveSnapshot('e', 1, state=ExecutiveState.IDLE),
    behaviors=(Behavior('Night Watch', parameters=(BehaviorParameter('speed'),)), Behavior('a$(touch x)\n')),
)  # fmt: skip


def completed(text: str, view: View = ROBOT, program: str = 'bash', robots: tuple[str, ...] = ()) -> list[str]:
    """Return what Tab makes of the line."""
    line = read_line(text)
    return as_typed(shell_words(line, view, robots)[0], line, program) if line is not None else []


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('console st', ['status ', 'structure ', 'start ', 'stop ', 'step ']),
        ('console start N', [r'Night\ Watch ']),
        (r'console start Night\ W', [r'Night\ Watch ']),
        ('console start "Night W', ['Night Watch']),
        ("console start 'Night Watch' s", ['speed=']),
        ('console start x --autonomy="l', ['low']),
        ("console start x --aut'onomy=l", ['onomy=low']),
        ('console start x y="a\\"b" "--autonomy=l', ['--autonomy=low']),
        ('console --namespace r2 start --autonomy l', ['low ']),
        ('console start x --autonomy=l', ['low ']),
        ('console map --p', ['--png ', '--places ']),
        ('console map --png ', []),
        ('console nothing ', []),
        ('console status --ros-args -r ', []),
    ],
)  # fmt: skip
def test_a_line_is_completed_as_the_shell_takes_it(text: str, words: list[str]) -> None:
    assert completed(text) == words


def test_zsh_takes_words_whole_and_robots_are_known_by_their_names() -> None:
    assert completed('console start x --autonomy=l', program='zsh') == ['--autonomy=low ']
    assert completed('console status --namespace ', robots=('/r1', '/r2')) == ['/r1 ', '/r2 ']
    assert completed('console web --robot=/r', program='zsh', robots=('/r1',)) == ['--robot=/r1 ']


def test_the_robot_is_asked_only_for_what_it_alone_knows() -> None:
    for text, asks in (('console st', False), ('console start ', True), ('console autonomy ', False),
                       ('console start --autonomy ', False), ('console status --namespace ', True)):  # fmt: skip
        line = read_line(text)
        assert line is not None and shell_words(line, NOTHING)[1] == asks, text


def test_each_command_has_its_options() -> None:
    for spec in COMMANDS:
        offered = {word.strip() for word in completed(f'console {spec.name} --')}
        assert offered == {option.name for option in (*spec.options, *COMMON_OPTIONS)}


@given(st.text(max_size=40))
def test_any_line_can_be_typed(text: str) -> None:
    completed(f'console {text}')


def test_bash_runs_the_script(tmp_path: Path) -> None:
    (tmp_path / 'console').write_text('#!/bin/sh\nprintf "%s\\n" "$*" "two\\\\ words "\n')
    (tmp_path / 'console').chmod(0o755)
    use = 'COMP_LINE="console st  ;" COMP_POINT=10; _flexbt_console; printf "%s|" "${COMPREPLY[@]}"'
    done = subprocess.run(
        ['bash', '-c', f'{completion_script("bash")}{use}'], capture_output=True, text=True, check=True,
        env=os.environ | {'PATH': f'{tmp_path}:{os.environ["PATH"]}'}, timeout=60,
    )  # fmt: skip
    assert done.stdout == 'completion bash --line console st|two\\ words |'


def test_the_script_is_printed_and_another_shell_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['completion', 'zsh']) == 0 and 'bashcompinit' in capsys.readouterr().out
    assert main(['completion', 'bash', '--line', 'console sto']) == 0 and capsys.readouterr().out == 'stop \n'
    assert main(['completion', 'fish']) == 2 and 'bash or zsh' in capsys.readouterr().err

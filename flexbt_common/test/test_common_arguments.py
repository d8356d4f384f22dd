# SPDX-License-Identifier: BSD-3-Clause
"""Words of a command line that are not known."""

from __future__ import annotations

import pytest

from flexbt_common.command_line import SuggestingArgumentParser


def parser() -> SuggestingArgumentParser:
    made = SuggestingArgumentParser(prog='tool')
    made.add_argument('--speed', type=float)
    commands = made.add_subparsers()
    check = commands.add_parser('check')
    check.add_argument('--strict', action='store_true')
    check.add_argument('--kind', choices=['tree', 'machine'])
    commands.add_parser('draw')
    return made


@pytest.mark.parametrize(
    ('words', 'told'),
    [
        ('--speeed=2', "tool: error: unrecognized arguments: --speeed=2; did you mean '--speed'?"),
        ('check --strickt', "tool check: error: unrecognized arguments: --strickt; did you mean '--strict'?"),
        ('check --zzz', 'tool check: error: unrecognized arguments: --zzz\n'),
        ('chek', "; did you mean 'check'?"),
        ('check --kind tre', "; did you mean 'tree'?"),
        ('check --kind=x --strict more', "argument --kind: invalid choice: 'x' (choose from "),
    ],
)
def test_what_may_have_been_meant_is_told(words: str, told: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        parser().parse_args(words.split())
    err = capsys.readouterr().err
    assert ended.value.code == 2 and told in err
    assert err.count('did you mean') == told.count('did you mean')


def test_what_is_right_is_taken() -> None:
    found = parser().parse_args(['--speed', '2', 'check', '--kind', 'tree'])
    assert (found.speed, found.kind, found.strict) == (2.0, 'tree', False)

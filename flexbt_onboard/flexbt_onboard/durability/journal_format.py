# SPDX-License-Identifier: BSD-3-Clause
"""The lines of a journal: how they are written, and what can be read of a file that is corrupt.

A line is the CRC-32 of its rest as eight hexadecimal digits, its number, and an object of JSON, with a space between
them. The first line, number 0, is the head, ``{"format": 2}``; the others have some of these:

========  ==============================================================================================================
begin     a run has begun, or goes on with another behavior: its request, as the executive gave it
position  of the run that ``run`` names: what the machine needs to go on from there
end       the run that ``run`` names has ended, or will not go on: why
autonomy  the level for the next run, as an operator set it; null for that of the parameter
commands  lists of id, code and reason: commands that were decided with what else is in the line
========  ==============================================================================================================

Each line says by itself what it is about, so that those after a corrupt one are of use.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from flexbt_core.state_machine import Autonomy
from flexbt_core.values import shown
from flexbt_msgs.msg import CommandResult

FORMAT: Final = 2
"""The version of the format; the one before had neither head nor numbers."""

Line = dict[str, Any]

_MOST_TOLD: Final = 5
"""Problems of a file that are told one by one."""

_MOST_PROBLEMS: Final = 10_000
"""Lines that are corrupt, after which nothing more is read: the start of an executive waits for it."""

_LONGEST_NAME: Final = 4096
_LONGEST_TEXT: Final = 2_000_000
"""Characters of what is shown of a run, and of what it was given: no command can have more."""

_MOST_PATHS: Final = 10_000
"""Paths of a position."""


@dataclass(frozen=True)
class FoundJournal:
    """What a file says: the content of its lines, and what is wrong with it."""

    lines: Sequence[Line] = ()
    corruption: str = ''
    """What no crash leaves behind; '' for nothing."""
    torn: int = 0
    """Bytes of a last line that was not written to its end, as a crash leaves it."""


def encode_line(number: int, content: Line) -> bytes:
    """A line of the file."""
    text = b'%d %s' % (number, json.dumps(content, ensure_ascii=True, separators=(',', ':')).encode())
    return b'%08x %s\n' % (zlib.crc32(text), text)


def encode_head() -> bytes:
    """The first line of a file."""
    return encode_line(0, {'format': FORMAT})


def read_journal(data: bytes) -> FoundJournal:
    """Read a file. Never raises: every line that is whole counts, in the order of the numbers."""
    *raw_lines, rest = data.split(b'\n')
    found: dict[int, Line] = {}
    problems: list[str] = []
    version: Any = None
    expected = 0
    for place, raw in enumerate(raw_lines, 1):
        try:
            number, content = _decode(raw)
            if number == 0:
                version = content.get('format')
                if version != FORMAT:
                    return FoundJournal(corruption=_of_format(version))
            elif problem := _problem_of(content):
                raise ValueError(problem)
            if number in found:
                raise ValueError(f'has the number {number}, as one before')
        except ValueError as error:
            problems.append(f'line {place} {error}')
            if len(problems) >= _MOST_PROBLEMS:
                problems.append(f'nothing was read after line {place}')
                break
            continue
        if number != expected:
            problems.append(f'line {place} has the number {number}, not {expected}')
        found[number], expected = content, number + 1
    if raw_lines and version is None:
        if not found:
            return FoundJournal(corruption=_of_format(1 if _is_of_format_1(raw_lines[0]) else None))
        if not problems:
            problems.append('it has no head')
    elif not data:
        problems.append('it is empty')
    elif not raw_lines and not encode_head().startswith(data):  # as of zeros, after a loss of power
        return FoundJournal(corruption=_of_format(None))
    found.pop(0, None)
    return FoundJournal([found[number] for number in sorted(found)], _told(problems), len(rest))


def _decode(raw: bytes) -> tuple[int, Line]:
    """Number and content of a line; raises ValueError, whose text follows the place of the line."""
    checksum, _, text = raw.partition(b' ')
    if checksum != b'%08x' % zlib.crc32(text):
        raise ValueError('does not have the checksum that it gives')
    number, _, encoded = text.partition(b' ')
    if not number.isdigit() or len(number) > len(str(2**63)):
        raise ValueError('has no number')
    try:
        content = json.loads(encoded)
    except (ValueError, RecursionError) as error:
        raise ValueError(f'is no JSON: {error}') from None
    if not isinstance(content, dict):
        raise ValueError('is no object')
    return int(number), content


def _of_format(version: Any) -> str:
    if version is None:
        return 'it does not begin as a journal does'
    return f'it is of format {shown(version)}, and this version of FlexBT reads format {FORMAT} only'


def _is_of_format_1(raw: bytes) -> bool:
    checksum, _, text = raw.partition(b' ')
    return text.startswith(b'{') and checksum == b'%08x' % zlib.crc32(text)


def _told(problems: Sequence[str]) -> str:
    more = [f'{len(problems) - _MOST_TOLD} more', problems[-1]] if len(problems) > _MOST_TOLD else []
    return '; '.join([*problems[:_MOST_TOLD], *more])


def _problem_of(content: Line) -> str:
    """Why that is no line of a journal; '' when it is one."""
    for name, value in content.items():
        check = _CHECKS.get(name)
        if check is None:
            return f'has {shown(name)}, which is not known'
        if not check(value):
            return f'has a {name} that cannot be: {shown(value)}'
    if 'run' not in content and not content.keys().isdisjoint({'position', 'end'}):
        return 'does not say which run it is about'
    return ''


def _is_any_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_text(value: Any, longest: int = _LONGEST_TEXT) -> bool:
    """Whether it is one that a message can have: JSON has lone surrogates, too."""
    return isinstance(value, str) and len(value) <= longest and value.encode('utf-8', 'replace').decode() == value


def _is_name(value: Any) -> bool:
    return _is_text(value, _LONGEST_NAME)


def _are_paths(value: Any) -> bool:
    return isinstance(value, list | dict) and len(value) <= _MOST_PATHS and all(map(_is_name, value))


def _is_level(value: Any) -> bool:
    return type(value) is int and Autonomy.Off <= value <= Autonomy.Full


def _is_list_of(*checks: Callable[[Any], bool]) -> Callable[[Any], bool]:
    """For lists of lists, each with one item for each check."""

    def check(value: Any) -> bool:
        return isinstance(value, list) and all(
            isinstance(one, list)
            and len(one) == len(checks)
            and all(is_fit(item) for is_fit, item in zip(checks, one, strict=True))
            for one in value
        )

    return check


def _is_base64(value: Any) -> bool:
    try:
        base64.b64decode(value, validate=True)
    except (TypeError, ValueError):
        return False
    return isinstance(value, str)


def _is_object_with(parts: Mapping[str, Callable[[Any], bool]]) -> Callable[[Any], bool]:
    """For objects that have these parts, and perhaps others."""
    return lambda value: (
        isinstance(value, dict) and all(name in value and is_fit(value[name]) for name, is_fit in parts.items())
    )


_CHECKS: Final[Mapping[str, Callable[[Any], bool]]] = {
    'run': _is_name,
    'begin': _is_object_with(
        {
            'run': _is_name,
            'behavior': _is_name,
            'arguments': _is_list_of(_is_name, _is_text),
            'inputs': _is_list_of(_is_name, _is_name, _is_text, _is_base64),
            'by': _is_name,
            'autonomy': _is_level,
        }
    ),
    # What is shown of a run before it goes on; all of it is checked when it does.
    'position': _is_object_with(
        {
            'active': _are_paths,
            'coming': _are_paths,
            'levels': lambda value: (
                isinstance(value, dict) and _are_paths(value) and all(map(_is_level, value.values()))
            ),
            'locked': _are_paths,
            'breakpoints': _are_paths,
        }
    ),
    'end': _is_any_text,
    'autonomy': lambda value: value is None or _is_level(value),
    'commands': _is_list_of(
        _is_name,
        lambda code: type(code) is int and code in (CommandResult.APPLIED, CommandResult.REFUSED),
        _is_any_text,
    ),
}

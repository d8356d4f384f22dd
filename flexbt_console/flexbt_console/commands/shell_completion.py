# SPDX-License-Identifier: BSD-3-Clause
"""Completion of ``console`` in bash and zsh: what Tab makes of a line, from the registry and from the robot."""

from __future__ import annotations

import re
import shlex
from itertools import pairwise
from typing import Final, NamedTuple

from flexbt_console.mirror import View

from .command_line import COMMON_OPTIONS
from .completion import next_words
from .registry import COMMANDS, find
from .spec import CommandSpec

_SCRIPT: Final = """\
# Tab completes the words of console:   . <(console completion {shell})
_flexbt_console() {{
  local word
  COMPREPLY=()
  while IFS= read -r word; do
    COMPREPLY+=("$word")
  done < <(console completion {shell} --line "${{COMP_LINE:0:$COMP_POINT}}" 2>/dev/null)
}}
{prepare}complete -o nospace -o default -F _flexbt_console console
"""

_PREPARE_ZSH: Final = """\
autoload -U +X compinit && compinit
autoload -U +X bashcompinit && bashcompinit
"""

_CURSOR: Final = '\0'
"""Stands for the cursor: no shell can type it."""


class TypedLine(NamedTuple):
    """A line up to the cursor: the command, the words behind it, the word that is being typed as it will be, and as it
    is written, and how much of it stands before the quote that is open in it (None where none is); and the namespace
    that is named in the line."""

    spec: CommandSpec | None
    given: list[str]
    last: str
    written: str
    unquoted: str | None
    namespace: str

    @property
    def names_robot(self) -> bool:
        """Whether it is the name of a robot that is typed."""
        option = self.last.partition('=')[0] if '=' in self.last else ''.join(self.given[-1:])
        return option in ('--namespace', '--robot')


def completion_script(shell: str) -> str:
    """What a shell has to read."""
    return _SCRIPT.format(shell=shell, prepare=_PREPARE_ZSH if shell == 'zsh' else '')


def read_line(text: str) -> TypedLine | None:
    """What is typed of a line that begins with the name of the program; None where nothing of ours can follow."""
    for end in ('', '"', "'"):  # a quote may be open
        try:
            words = shlex.split(text + _CURSOR + end)
        except ValueError:
            continue
        break
    else:
        return None
    if not words or '--ros-args' in words[:-1]:
        return None
    *before, last = words[1:] or ['']
    name = next((number for number, word in enumerate(before) if _is_command(before, number)), None)
    written = re.split(r'(?<!\\)\s', text)[-1]
    namespaces = [after for word, after in pairwise(before) if word == '--namespace']
    namespaces += [word.partition('=')[2] for word in before if word.startswith('--namespace=')]
    spec = find(before[name]) if name is not None else None
    if name is not None and spec is None:
        return None
    given = before if name is None else before[:name] + before[name + 1 :]
    unquoted = _before_quote(text, end) if end else None
    return TypedLine(spec, given, last.removesuffix(_CURSOR), written, unquoted, namespaces[-1] if namespaces else '')


def shell_words(line: TypedLine, view: View, robots: tuple[str, ...] = ()) -> tuple[list[str], bool]:
    """The words that the one at the cursor may become, and whether more of them may be known to the robot."""
    spec = line.spec or CommandSpec('', '', COMMANDS[0].action)
    known = (*spec.options, *COMMON_OPTIONS)
    option, equals, value = line.last.partition('=')
    if equals and option.startswith('--'):
        found, asks = next_words(spec, [option], value, known, view, robots)
        words = [f'{option}={word}' for word in found]
    else:
        found, asks = next_words(spec, line.given, line.last, known, view, robots)
        words = list(found)
        if line.spec is None and not line.names_robot:
            words += [one.name for one in COMMANDS]
    fitting = [word for word in dict.fromkeys(words) if word.startswith(line.last) and word.isprintable()]
    return fitting, asks


def as_typed(words: list[str], line: TypedLine, shell: str) -> list[str]:
    """The words as a shell takes them. A blank ends a word that is whole; of what bash takes for several words, because
    of ``=`` or ``:`` in it, it wants the last one, and in a quote what is quoted."""
    if line.unquoted is not None:
        return [word[len(line.unquoted) :] for word in words] if shell == 'bash' else words
    quoted = [re.sub(r'([^\w@%+=:,./-])', r'\\\1', word) + ('' if word.endswith('=') else ' ') for word in words]
    breaks = max(line.written.rfind('='), line.written.rfind(':')) + 1 if shell == 'bash' else 0
    return [word[breaks:] for word in quoted]


def _before_quote(text: str, quote: str) -> str:
    """What of the last word, as it will be, stands before the quote that is open at the end."""
    while text:
        text = text[: text.rindex(quote)]
        try:
            return shlex.split(text + _CURSOR)[-1].removesuffix(_CURSOR)
        except ValueError:  # that quote was within the open one
            continue
    return ''


def _is_command(words: list[str], number: int) -> bool:
    """Whether that word is no option, and no value of one."""
    values = {option.name for option in COMMON_OPTIONS if option.value is not None}
    return not words[number].startswith('-') and (number == 0 or words[number - 1] not in values)

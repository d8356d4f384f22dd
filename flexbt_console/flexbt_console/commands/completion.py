# SPDX-License-Identifier: BSD-3-Clause
"""Completion of a line that is being typed, from the registry and the robot: in the console, in bash and in zsh."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

from flexbt_console.mirror.view import View

from .command_line import COMMON_OPTIONS
from .registry import COMMANDS, begun
from .spec import NO_COMMAND, CommandSpec, Option, Typed, short_answers

BUILT_IN = ('help', 'quit')
"""Commands of the prompt itself."""


def candidates(text: str, view: View) -> list[str]:
    """Words that complete the last word of ``text`` (the line up to the cursor), the likely ones first.

    Only plain printable words: text from the robot must not type control characters for the operator.
    """
    *before, last = text.split(' ')
    before = [word for word in before if word]
    fitting = [word for word in dict.fromkeys(_words(before, last, view)) if word.startswith(last)]
    return [word for word in fitting if word.isprintable()]


class Offer(NamedTuple):
    """A completion of a line, its description, and the reason why it would be refused ('' if it would not)."""

    line: str
    about: str = ''
    refusal: str = ''


def offers(text: str, view: View) -> list[Offer]:
    """Return the completions of a line: those of its last word, and while no command begins it, also each command
    of which words of its name, or of its description, begin with those of the line."""
    begun = text[: len(text) - len(text.rpartition(' ')[2])]
    specs = {spec.name: spec for spec in COMMANDS if spec.in_prompt}
    abouts = {} if begun else {spec.name: spec.summary for spec in specs.values()}
    words = text.lower().split()
    if words and words[0] in ('start', 'switch'):
        known = {f'{words[0]} {one.name}': Offer('', one.description, one.error) for one in view.behaviors or ()}
    else:
        known = {}
    found = []
    for word in candidates(text, view):
        line = begun + word
        found.append(known[line]._replace(line=line) if line in known else Offer(line, abouts.get(word, '')))
    if words and not (begun and words[0] in specs):
        lines = {offer.line for offer in found}
        for spec in specs.values():
            told = f' {spec.name} {spec.summary}'.lower()
            if spec.name not in lines and all(f' {word}' in told for word in words):
                found.append(Offer(spec.name, spec.summary))
    return found


def _words(before: list[str], last: str, view: View) -> Iterable[str]:
    names = [spec.name for spec in COMMANDS if spec.in_prompt]
    if not before:
        return [*_single(short_answers(Typed((), view))), *names, *BUILT_IN]
    if before[0] == 'help':
        return names
    spec, given = begun(before)
    if spec is None or not spec.in_prompt:
        return ()
    return [*_second_words(spec, given), *next_words(spec, list(given), last, spec.prompt_options, view)[0]]


def _second_words(spec: CommandSpec, given: Sequence[str]) -> list[str]:
    """Return the words that make the name of another command of this one."""
    return [] if given else [one.name.split()[1] for one in COMMANDS if one.name.startswith(f'{spec.name} ')]


def next_words(
    spec: CommandSpec, given: list[str], last: str, known: Iterable[Option], view: View, robots: tuple[str, ...] = ()
) -> tuple[Iterable[str], bool]:
    """Return the words that may come next after a command with these options, and whether the robot may know more."""
    options = {option.name: option for option in known}
    words: list[str] = []
    expecting = None
    for word in given:
        if expecting is not None:
            expecting = None
        elif word in options:
            expecting = options[word] if options[word].value is not None else None
        elif not word.startswith('--'):
            words.append(word)
    typed = Typed(spec.joined(words), view, robots)
    if expecting is not None:
        values = list(_single(expecting.values(typed))) if expecting.values is not None else []
        return values, expecting.values is not None and not values
    found: list[str] = []
    at = spec.arguments_at(len(typed.words))
    for argument in at:
        if argument.values is not None:
            found += argument.values(typed) if argument.spaced else _single(argument.values(typed))
    if spec.is_spaced and len(typed.words) == 1 and spec.arguments[0].values is not None:
        begun = f'{typed.words[0]} '
        found += [name.removeprefix(begun) for name in spec.arguments[0].values(typed) if name.startswith(begun)]
    if last.startswith('-'):
        return [*found, *options], False
    return found, not found and any(argument.values is not None for argument in at)


def _single(words: Iterable[str]) -> Iterable[str]:
    """Return the words that the shell reads as a single word."""
    return (word for word in words if ' ' not in word)


# Completion of ``console`` in bash and zsh: what Tab makes of a line, from the registry and from the robot.

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
"""Stand-in for the cursor: it cannot be typed in any shell."""


class ShellLine(NamedTuple):
    """A line up to the cursor: the command, the words behind it, the word that is being typed as it will be, and as it
    is written, and how much of it stands before the quote that is open in it (None where none is); and the namespace
    that is named in the line."""

    spec: CommandSpec
    given: list[str]
    last: str
    written: str
    unquoted: str | None
    namespace: str

    @property
    def names_robot(self) -> bool:
        """True if the name of a robot is being typed."""
        option = self.last.partition('=')[0] if '=' in self.last else ''.join(self.given[-1:])
        return option in ('--namespace', '--robot')


def completion_script(shell: str) -> str:
    """Return what a shell has to read."""
    return _SCRIPT.format(shell=shell, prepare=_PREPARE_ZSH if shell == 'zsh' else '')


def read_line(text: str) -> ShellLine | None:
    """Return what is typed of a line that begins with the name of the program; None where nothing of ours can
    follow."""
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
    spec, after = begun(before[name:]) if name is not None else (NO_COMMAND, ())
    if spec is None:
        return None
    given = before if name is None else [*before[:name], *after]
    unquoted = _before_quote(text, end) if end else None
    return ShellLine(spec, given, last.removesuffix(_CURSOR), written, unquoted, namespaces[-1] if namespaces else '')


def shell_words(line: ShellLine, view: View, robots: tuple[str, ...] = ()) -> tuple[list[str], bool]:
    """Return the completions of the word at the cursor, and whether the robot may know more of them."""
    spec, known = line.spec, (*line.spec.options, *COMMON_OPTIONS)
    option, equals, value = line.last.partition('=')
    if equals and option.startswith('--'):
        found, asks = next_words(spec, [option], value, known, view, robots)
        words = [f'{option}={word}' for word in found]
    else:
        found, asks = next_words(spec, line.given, line.last, known, view, robots)
        words = [*_second_words(spec, line.given), *found] if spec is not NO_COMMAND else list(found)
        if spec is NO_COMMAND and not line.names_robot:
            words += _single(one.name for one in COMMANDS)
    fitting = [word for word in dict.fromkeys(words) if word.startswith(line.last) and word.isprintable()]
    return fitting, asks


def as_typed(words: list[str], line: ShellLine, shell: str) -> list[str]:
    """Return the words as a shell takes them. A blank ends a word that is whole; of what bash takes for several words,
    because of ``=`` or ``:`` in it, it wants the last one, and in a quote what is quoted."""
    if line.unquoted is not None:
        return [word[len(line.unquoted) :] for word in words] if shell == 'bash' else words
    quoted = [re.sub(r'([^\w@%+=:,./-])', r'\\\1', word) + ('' if word.endswith('=') else ' ') for word in words]
    breaks = max(line.written.rfind('='), line.written.rfind(':')) + 1 if shell == 'bash' else 0
    return [word[breaks:] for word in quoted]


def _before_quote(text: str, quote: str) -> str:
    """Return the part of the last word, as it will be, before the quote that is open at the end."""
    while text:
        text = text[: text.rindex(quote)]
        try:
            return shlex.split(text + _CURSOR)[-1].removesuffix(_CURSOR)
        except ValueError:  # that quote was within the open one
            continue
    return ''


def _is_command(words: list[str], number: int) -> bool:
    """Return whether the word is neither an option nor the value of one."""
    values = {option.name for option in COMMON_OPTIONS if option.value is not None}
    return not words[number].startswith('-') and (number == 0 or words[number - 1] not in values)

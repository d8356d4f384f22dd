# SPDX-License-Identifier: BSD-3-Clause
"""What may come next on the line that is being typed, from the registry."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from flexbt_console.mirror import View

from .registry import COMMANDS, find
from .spec import CommandSpec, Option, Typed
from .words import short_answers

BUILT_IN = ('help', 'quit')
"""Commands of the prompt itself."""


def candidates(text: str, view: View) -> list[str]:
    """Words that complete the last word of ``text`` (the line up to the cursor), the likely ones first.

    Only plain printable words: what the robot sends must not be typed for the operator otherwise.
    """
    *before, last = text.split(' ')
    before = [word for word in before if word]
    fitting = [word for word in dict.fromkeys(_words(before, last, view)) if word.startswith(last)]
    return [word for word in fitting if word.isprintable()]


class Offer(NamedTuple):
    """What a line may become, what that does, and why it would be refused ('' when it would not)."""

    line: str
    about: str = ''
    refusal: str = ''


def offers(text: str, view: View) -> list[Offer]:
    """What a line may become: by words that complete it, and, while it begins with no command, also each command of
    which words of its name, or of what it does, begin with those of the line."""
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
    spec = find(before[0])
    return _after(spec, before[1:], last, view) if spec is not None and spec.in_prompt else ()


def _after(spec: CommandSpec, given: list[str], last: str, view: View) -> Iterable[str]:
    return next_words(spec, given, last, spec.prompt_options, view)[0]


def next_words(
    spec: CommandSpec, given: list[str], last: str, known: Iterable[Option], view: View, robots: tuple[str, ...] = ()
) -> tuple[Iterable[str], bool]:
    """The words that may come next behind a command with these options, and whether the robot may know some."""
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
    """Those that are one word when they are typed."""
    return (word for word in words if ' ' not in word)

# SPDX-License-Identifier: BSD-3-Clause
"""The files from which something is synthesized."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

from flexbt_formal.synthesis.inputs import (
    Interfaces,
    Mappings,
    Options,
    Problem,
    Request,
    hand_written,
    is_whole,
    read_capabilities,
    read_mappings,
    read_specification,
    translated,
)
from flexbt_tools.errors import UsageError
from flexbt_tools.text_files import read_text

MAX_BYTES: Final = 4_000_000
"""Of a file of a synthesis, at most."""

T = TypeVar('T')


@dataclass(frozen=True, slots=True)
class SynthesisFiles:
    """Names of files: capabilities, mappings (later ones count where several have an entry), specification.

    ``text`` are capabilities that are at hand, and how they are called; in place of a file of them.
    """

    capabilities: str | None
    mappings: Sequence[str] = ()
    specification: str | None = None
    text: tuple[str, str] | None = None


def read_problem(files: SynthesisFiles, request: Request, interfaces: Interfaces, options: Options) -> Problem:
    """What files and request ask for. A specification that is whole needs no capabilities.

    Raises:
        SynthesisError: with everything that is wrong in them, each with file and line.
        UsageError: a file cannot be read, or there is none.
    """
    given = None if files.specification is None else read(files.specification, read_specification)
    if files.capabilities is None and files.text is None:
        if given is None:
            raise UsageError('name a capability file, or a whole specification by --spec')
        return hand_written(given, request)
    mappings = _mappings(files.mappings)
    capabilities = (
        read(files.capabilities, lambda text, source: read_capabilities(text, source, mappings))
        if files.capabilities is not None
        else read_capabilities(*(files.text or ('', '')), mappings)
    )
    if given is not None and is_whole(given, capabilities):
        return hand_written(given, request, capabilities, interfaces)
    return translated(capabilities, interfaces, request, given, options)


def _mappings(names: Sequence[str]) -> Mappings:
    if not names:
        return Mappings(_USUAL, {'finished': 'finished'})
    mappings = Mappings()
    for name in names:
        mappings = mappings.updated(read(name, read_mappings))
    return mappings


_USUAL = {
    **dict.fromkeys(('done', 'finished', 'received', 'true'), 'completed'),
    **dict.fromkeys(
        ('aborted', 'canceled', 'data_error', 'empty', 'failed', 'false', 'no_connection', 'param_error', 'timeout'),
        'failure',
    ),
    'unavailable': 'failure',
}


def read(name: str, reader: Callable[[str, str], T]) -> T:
    """What a reader makes of a file. Raises UsageError when it cannot be read."""
    return reader(read_text(name, MAX_BYTES), name)

# SPDX-License-Identifier: BSD-3-Clause
"""The files from which something is synthesized."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from flexbt_core.synthesis.inputs import (
    Interfaces,
    Mappings,
    Options,
    Problem,
    Request,
    read_capabilities,
    read_mappings,
    read_specification,
    translated,
)
from flexbt_tools.errors import UsageError

_MAX_BYTES = 4_000_000

T = TypeVar('T')


@dataclass(frozen=True, slots=True)
class SynthesisFiles:
    """Names of files: capabilities, mappings (later ones count where several have an entry), specification."""

    capabilities: str
    mappings: Sequence[str] = ()
    specification: str | None = None


def read_problem(files: SynthesisFiles, request: Request, interfaces: Interfaces, options: Options) -> Problem:
    """What files and request ask for.

    Raises:
        SynthesisError: with everything that is wrong in them, each with file and line.
        UsageError: a file cannot be read.
    """
    mappings = Mappings(machine_outcomes={'finished': 'finished'}, state_outcomes=_USUAL)
    for name in files.mappings:
        mappings = (
            read(name, read_mappings)
            if mappings.state_outcomes is _USUAL
            else mappings.updated(read(name, read_mappings))
        )
    capabilities = read(files.capabilities, lambda text, source: read_capabilities(text, source, mappings))
    given = None if files.specification is None else read(files.specification, read_specification)
    return translated(capabilities, interfaces, request, given, options)


_USUAL = {
    **dict.fromkeys(('done', 'finished', 'received', 'true'), 'completed'),
    **dict.fromkeys(
        ('aborted', 'canceled', 'data_error', 'empty', 'failed', 'false', 'no_connection', 'param_error', 'timeout'),
        'failure',
    ),
    'unavailable': 'failure',
}


def read(name: str, reader: Callable[[str, str], T]) -> T:
    """What a reader makes of a file."""
    try:
        with Path(name).open('rb') as file:
            content = file.read(_MAX_BYTES + 1)
        if len(content) > _MAX_BYTES:
            raise UsageError(f'{name}: the file has more than {_MAX_BYTES} bytes')
        return reader(content.decode('utf-8'), name)
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f'{name}: {error}') from error

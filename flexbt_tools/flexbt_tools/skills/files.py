# SPDX-License-Identifier: BSD-3-Clause
"""Files of manifests on this computer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from flexbt_core.behavior_tree import LoadError
from flexbt_core.skills import SkillError, SkillLibrary, read_skills
from flexbt_core.values import TextFileError, read_text
from flexbt_tools.errors import RefusedError

_MOST_BYTES: Final = 4_000_000
"""As much as a scene of some thousand skills and objects needs; YAML is slow to read."""


def read_skill_files(files: Sequence[str], base: SkillLibrary) -> SkillLibrary:
    """What ``base`` has, and what the files add, one after the other.

    Raises:
        RefusedError: with all that is wrong with a file.
    """
    library = base
    for file in files:
        library = read_skills_of(file, library)
    return library


def read_skills_of(file: str, base: SkillLibrary) -> SkillLibrary:
    """What ``base`` has, and what one file adds. Raises RefusedError."""
    try:
        return read_skills(read_text(file, _MOST_BYTES), file, base)
    except TextFileError as error:
        raise RefusedError([LoadError(file, 1, 1, '', f'cannot be read: {error}')]) from error
    except SkillError as error:
        raise RefusedError([_located(file, problem) for problem in error.problems]) from error


def _located(file: str, problem: str) -> LoadError:
    """A problem that begins with file and line."""
    line, _, message = problem.removeprefix(f'{file}:').partition(': ')
    return LoadError(file, int(line), 1, '', message)

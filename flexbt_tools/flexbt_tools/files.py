# SPDX-License-Identifier: BSD-3-Clause
"""Reading and writing of whole files by commands: texts, and manifests of skills."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from flexbt_core.behavior_tree.model.errors import LoadError
from flexbt_core.skills.library import SkillLibrary
from flexbt_core.skills.literals import SkillError
from flexbt_core.skills.yaml_files import read_skills
from flexbt_core.values import text_files
from flexbt_core.values.text_files import TextFileError, read_text

from .errors import RefusedError, UsageError


def read_text_file(file: str, most: int) -> str:
    """Return the text (UTF-8) of a file of at most ``most`` bytes.

    Raises UsageError if the file cannot be read or is longer.
    """
    try:
        return text_files.read_text(file, most)
    except TextFileError as error:
        raise UsageError(f'{file}: cannot be read: {error}') from error


def write_text_file(file: str, text: str) -> None:
    """Write a whole file. Raises UsageError if that fails; an existing file then stays unchanged."""
    try:
        text_files.write_text(file, text)
    except OSError as error:
        raise UsageError(f'{file}: cannot be written: {error.strerror or error}') from error
    except ValueError as error:  # a name with NUL; a text that is not Unicode, as parts of it are names of files
        raise UsageError(f'{file}: cannot be written: {error}') from error


# Skill manifests on this computer.

_MOST_BYTES: Final = 4_000_000
"""Enough for a scene with some thousand skills and objects. The limit exists because YAML is slow to read."""


def read_skill_files(files: Sequence[str], base: SkillLibrary) -> SkillLibrary:
    """Return the library ``base`` with the skills of the files added, in order.

    Raises:
        RefusedError: a file cannot be read, or has errors; contains all problems of that file.
    """
    library = base
    for file in files:
        try:
            library = read_skills(read_text(file, _MOST_BYTES), file, library)
        except TextFileError as error:
            raise RefusedError([LoadError(file, 1, 1, '', f'cannot be read: {error}')]) from error
        except SkillError as error:
            raise RefusedError([_located(file, problem) for problem in error.problems]) from error
    return library


def _located(file: str, problem: str) -> LoadError:
    """Return a problem that begins with file and line."""
    line, _, message = problem.removeprefix(f'{file}:').partition(': ')
    return LoadError(file, int(line), 1, '', message)

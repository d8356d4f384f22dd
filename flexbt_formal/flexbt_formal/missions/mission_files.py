# SPDX-License-Identifier: BSD-3-Clause
"""Files of missions on this computer, with the files of manifests that they name."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Final

from flexbt_core.behavior_tree import LoadError
from flexbt_core.skills import SkillLibrary
from flexbt_core.values import excerpt
from flexbt_formal.planning import Mission, PlanningError, read_mission
from flexbt_tools.errors import RefusedError
from flexbt_tools.skills import read_skill_files
from flexbt_tools.text_files import read_text

_MOST_BYTES: Final = 1_000_000


def read_mission_file(file: str) -> Mission:
    """The mission of a file. Raises UsageError when it cannot be read, RefusedError with all that is wrong with it."""
    try:
        return read_mission(read_text(file, _MOST_BYTES), file)
    except PlanningError as error:
        raise RefusedError(mission_problems(file, Mission(), error)[0]) from error


def mission_skills(file: str, mission: Mission, base: SkillLibrary) -> SkillLibrary:
    """What ``base`` has, and what the files of manifests add, which are beside that of the mission.

    Raises:
        RefusedError: with all that is wrong with one of them; that it is missing, at the line that names it.
    """
    beside = [Path(file).parent / name for name in mission.skills]
    missing = [str(one) for one in beside if not one.exists()]
    if missing:
        line = mission.lines['skills']
        raise RefusedError(
            LoadError(file, line, 1, '', f'skills: there is no file {excerpt(one, 300)!r}') for one in missing
        )
    return read_skill_files([str(one) for one in beside], base)


def mission_problems(
    file: str, mission: Mission, error: Exception, given: Collection[str] = ()
) -> tuple[list[LoadError], list[str]]:
    """What is wrong with a mission: at the line that it names, or at that of the entry with which it begins; and what
    is wrong with the entries that are ``given`` in place of the file's."""
    located, others = [], []
    entries = {name: line for name, line in mission.lines.items() if name not in given}
    for problem in str(error).splitlines():
        line, separator, message = problem.removeprefix(f'{file}:').partition(': ')
        if not (separator and line.isdecimal()):
            message = problem.removeprefix('skills ')
            if message.startswith(tuple(given)):
                others.append(message)
                continue
            line = next((str(at) for name, at in entries.items() if message.startswith(name.removesuffix('s'))), '1')
        located.append(LoadError(file, int(line), 1, '', message))
    return located, others

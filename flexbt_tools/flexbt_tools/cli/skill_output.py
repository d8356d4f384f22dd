# SPDX-License-Identifier: BSD-3-Clause
"""How commands show skills: which of them, and as what."""

from __future__ import annotations

import argparse
import json

from flexbt_core.skills import SkillLibrary, skill_entry, write_skills
from flexbt_core.values import hint, lines, shown
from flexbt_tools.errors import UsageError
from flexbt_tools.skills import skill_lines

from . import arguments


def add_arguments(parser: argparse.ArgumentParser) -> argparse._MutuallyExclusiveGroup:
    """``options.skill``, ``options.yaml``, ``options.json``; gives the group of the forms."""
    parser.add_argument('--skill', metavar='NAME', action='append', default=[], help='only this one; repeatable')
    form = parser.add_mutually_exclusive_group()
    form.add_argument('--yaml', action='store_true', help='print a file of manifests')
    arguments.add_json(form)
    return form


def chosen(library: SkillLibrary, options: argparse.Namespace) -> SkillLibrary:
    """The library with the skills that are meant. Raises UsageError."""
    for name in options.skill:
        if name not in library.skills:
            raise UsageError(f'there is no skill {shown(name)}{hint(name, library.skills)}')
    skills = {name: one for name, one in library.skills.items() if not options.skill or name in options.skill}
    return SkillLibrary(skills, library.predicates, library.types, library.objects)


def show(library: SkillLibrary, options: argparse.Namespace) -> None:
    """Prints the skills in the form that is meant."""
    if options.yaml:
        print(write_skills(library), end='')
    elif options.json:
        print(json.dumps({name: skill_entry(skill) for name, skill in library.skills.items()}))
    else:
        for skill in library.skills.values():
            for line in skill_lines(skill):
                print(*lines(line), sep='\n')

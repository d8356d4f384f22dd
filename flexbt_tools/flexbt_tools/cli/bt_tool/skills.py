# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool skills``: what leaves need, what they bring about, and how they may fail."""

from __future__ import annotations

import argparse
import json

from flexbt_core.skills import SkillLibrary, skill_entry, write_skills
from flexbt_core.values import hint, lines
from flexbt_tools.cli import arguments
from flexbt_tools.errors import ExitCode, UsageError
from flexbt_tools.skills import skill_lines


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        'files', metavar='FILE', nargs='*', help='YAML file of manifests, which adds to what the classes declare'
    )
    parser.add_argument('--skill', metavar='NAME', action='append', default=[], help='only this one; repeatable')
    arguments.add_node_types(parser, allow_unknown=False)
    form = parser.add_mutually_exclusive_group()
    form.add_argument('--yaml', action='store_true', help='print a file of manifests')
    arguments.add_json(form)


def run(options: argparse.Namespace) -> ExitCode:
    known = arguments.registry(options, allow_unknown=False)
    library = _chosen(arguments.skill_library(options.files, known), options.skill)
    if options.yaml:
        print(write_skills(library), end='')
    elif options.json:
        print(json.dumps({name: skill_entry(skill) for name, skill in library.skills.items()}))
    else:
        for skill in library.skills.values():
            for line in skill_lines(skill):
                print(*lines(line), sep='\n')
    return ExitCode.OK


def _chosen(library: SkillLibrary, names: list[str]) -> SkillLibrary:
    for name in names:
        if name not in library.skills:
            raise UsageError(f'there is no skill {name!r:.80}{hint(name, library.skills)}')
    chosen = {name: skill for name, skill in library.skills.items() if not names or name in names}
    return SkillLibrary(chosen, library.predicates, library.types, library.objects)

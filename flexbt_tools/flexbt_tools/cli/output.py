# SPDX-License-Identifier: BSD-3-Clause
"""Output of findings, pictures and skills by commands: arguments, forms and exit codes."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from flexbt_common.errors import ResourceError
from flexbt_common.pictures.markup import fitted, svg
from flexbt_core.skills.library import SkillLibrary
from flexbt_core.skills.skill import LEVELS, Outcome, Skill
from flexbt_core.skills.yaml_files import skill_entry, write_skills
from flexbt_core.values.text import did_you_mean, escape_lines, pluralize, short_repr
from flexbt_tools.errors import ExitCode, UsageError
from flexbt_tools.files import write_text_file
from flexbt_tools.tree_checks.diagnostics import CheckRule, CheckSeverity

from . import arguments


class Reported(NamedTuple):
    """A finding in its reported form: a line of text, or a JSON object."""

    rule: CheckRule
    line: str
    document: Mapping[str, Any]


def add_report_arguments(parser: argparse.ArgumentParser, ignorable: Iterable[CheckRule]) -> None:
    """Add the options of a report: ``options.ignore``, ``options.remarks``, ``options.strict``, ``options.json``."""
    parser.add_argument(
        '--ignore',
        metavar='RULE',
        action='append',
        default=[],
        choices=[rule.name for rule in ignorable],
        help='skip this rule; repeatable: %(choices)s',
    )
    parser.add_argument('--remarks', action='store_true', help='also print remarks (info)')
    parser.add_argument('--strict', action='store_true', help='count warnings as errors in the exit code')
    arguments.add_json(parser)


def report_findings(options: argparse.Namespace, found: Iterable[Reported], noun: str, number: int) -> ExitCode:
    """Print the findings for ``number`` things called ``noun``: errors first, remarks only on request."""
    kept = [one for one in found if one.rule.name not in options.ignore]
    order = list(CheckSeverity)
    shown = sorted(kept, key=lambda one: order.index(one.rule.severity))
    counts = {severity: sum(one.rule.severity is severity for one in shown) for severity in CheckSeverity}
    if options.json:
        summary = {f'{noun}s': number, **{severity.value: count for severity, count in counts.items()}}
        print(json.dumps({'findings': [one.document for one in shown], 'summary': summary}))
    else:
        for one in shown:
            if options.remarks or one.rule.severity is not CheckSeverity.INFO:
                print(one.line)
        parts = [_counted(count, severity) for severity, count in counts.items() if count]
        more = '; --remarks prints the info' if counts[CheckSeverity.INFO] and not options.remarks else ''
        print(f'{pluralize(number, noun)}: {", ".join(parts) or "no problems found"}{more}', file=sys.stderr)
    bad = counts[CheckSeverity.ERROR] + (counts[CheckSeverity.WARNING] if options.strict else 0)
    return ExitCode.NEGATIVE if bad else ExitCode.OK


def _counted(count: int, severity: CheckSeverity) -> str:
    return f'{count} {severity.value}' if severity is CheckSeverity.INFO else pluralize(count, severity.value)


# Pictures: the file and the language of the output.

_FORMATS: Final = ('svg', 'dot', 'mermaid')
PICTURES: Final = {'.svg': 'svg', '.dot': 'dot', '.gv': 'dot', '.mmd': 'mermaid', '.mermaid': 'mermaid'}


def add_picture_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options for format and file of the picture."""
    parser.add_argument(
        '--format', choices=_FORMATS, help='default: by the name of the output file, or svg (needs Graphviz)'
    )
    parser.add_argument('-o', '--output', metavar='FILE', help='file to write (default: standard output)')


def output_picture(
    options: argparse.Namespace, dot: Callable[[], Iterator[str]], mermaid: Callable[[], Iterator[str]]
) -> None:
    """Write the picture that the options request, from its lines in a language. Raises UsageError."""
    try:
        chosen = options.format or _by_name(arguments.picture(*PICTURES)(options.output or ''))
    except argparse.ArgumentTypeError as error:
        raise UsageError(f'{error}; --format chooses one for any name') from None
    picture = _picture(chosen, dot, mermaid)
    if options.output is None:
        sys.stdout.write(picture)
    else:
        write_text_file(options.output, picture)


def write_picture_file(file: str, dot: Callable[[], Iterator[str]], mermaid: Callable[[], Iterator[str]]) -> None:
    """Write a picture in the language of the file extension, otherwise SVG. Raises UsageError."""
    write_text_file(file, _picture(_by_name(file), dot, mermaid))


def _by_name(file: str) -> str:
    return PICTURES.get(Path(file).suffix.lower(), 'svg')


def _picture(form: str, dot: Callable[[], Iterator[str]], mermaid: Callable[[], Iterator[str]]) -> str:
    text = '\n'.join(mermaid() if form == 'mermaid' else dot()) + '\n'
    try:
        return fitted(svg(text)) if form == 'svg' else text
    except ResourceError as error:
        raise UsageError(str(error)) from None


# Skills in commands: which ones to show, and in which form.


def add_skill_arguments(parser: argparse.ArgumentParser) -> argparse._MutuallyExclusiveGroup:
    """Add ``options.skill``, ``options.yaml`` and ``options.json``; return the group of the forms."""
    arguments.add_list(parser, '--skill', 'NAME', 'only this skill')
    form = parser.add_mutually_exclusive_group()
    form.add_argument('--yaml', action='store_true', help='print a file of manifests')
    arguments.add_json(form)
    return form


def chosen_skills(library: SkillLibrary, options: argparse.Namespace) -> SkillLibrary:
    """Return the library with the selected skills. Raises UsageError."""
    for name in options.skill:
        if name not in library.skills:
            raise UsageError(f'there is no skill {short_repr(name)}{did_you_mean(name, library.skills)}')
    skills = {name: one for name, one in library.skills.items() if not options.skill or name in options.skill}
    return SkillLibrary(skills, library.predicates, library.types, library.objects)


def print_skills(library: SkillLibrary, options: argparse.Namespace) -> None:
    """Print the skills in the selected form."""
    if options.yaml:
        print(write_skills(library), end='')
    elif options.json:
        print(json.dumps({name: skill_entry(skill) for name, skill in library.skills.items()}))
    else:
        for skill in library.skills.values():
            for line in skill_lines(skill):
                print(*escape_lines(line), sep='\n')


# Skills as text for people.


def skill_lines(skill: Skill) -> Iterator[str]:
    """Yield the lines of a skill: its name with parameters, and one line for each known property."""
    parameters = ', '.join(f'{name}: {kind}' for name, kind in skill.parameters.items())
    yield f'{skill.name}({parameters})' if parameters else skill.name
    told = {
        'needs': ', '.join(map(str, skill.preconditions)),
        'resources': ', '.join(skill.resources),
        'reads': ', '.join(skill.reads),
        'writes': ', '.join(skill.writes),
        'takes': _span(skill),
        'deadline': f'{skill.deadline:g} s' if skill.deadline is not None else '',
        'retries': f'{skill.retries}' if skill.retries is not None else '',
        'cost': f'{skill.cost:g}' if skill.cost != 1.0 else '',
        'cancel': 'what it has begun continues' if skill.ignores_cancel else '',
    }
    yield from (f'  {name}: {text}' for name, text in told.items() if text)
    for name, outcome in skill.outcomes.items():
        yield f'  {name}: {_outcome(outcome)}'


def _span(skill: Skill) -> str:
    least, most = skill.duration
    if most == 0.0:
        return 'no time'
    if most is None:
        return f'{least:g} s or more' if least else ''
    return f'{least:g} to {most:g} s'


def _outcome(outcome: Outcome) -> str:
    kind = outcome.kind.value.replace('_', ' ') if outcome.kind is not None else 'of no class'
    effects = f', then {", ".join(map(str, outcome.effects))}' if outcome.effects else ''
    return f'{kind}{effects}{f"; autonomy {LEVELS[outcome.autonomy]}" if outcome.autonomy is not None else ""}'

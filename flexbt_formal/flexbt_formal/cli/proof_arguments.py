# SPDX-License-Identifier: BSD-3-Clause
"""Arguments of the commands that prove, and the output of their results."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

from flexbt_core.behavior_tree.model.definition import TreeKey, TreeLibrary
from flexbt_core.behavior_tree.model.errors import TreeLoadError
from flexbt_core.behavior_tree.nodes.nav2.registration import NAV2_BRANCHES
from flexbt_core.monitors.requirement_text import (
    RequirementError,
    StatedRequirement,
    parse_requirement,
    read_requirements,
)
from flexbt_core.values.text import one_line
from flexbt_formal.exploration.explorer import DEFAULT_CONFIGURATIONS, DEFAULT_SECONDS, RestoreError
from flexbt_formal.exploration.model import Report
from flexbt_formal.proofs.counterexamples import DIAGRAMS, played
from flexbt_formal.proofs.proof_cache import ProofCache
from flexbt_formal.proofs.proof_report import (
    Compared,
    ProgressLine,
    comparison_as_json,
    comparison_lines,
    proof_findings,
    report_as_json,
    report_lines,
)
from flexbt_formal.proofs.saved_test import File, Replay, saved_test
from flexbt_tools.cli import arguments
from flexbt_tools.errors import ExitCode, RefusedError, UnfitError, UsageError
from flexbt_tools.files import read_text_file, write_text_file
from flexbt_tools.trees.outline import node_places

_MOST_BYTES: Final = 1_000_000


def add_count(parser: argparse.ArgumentParser, flag: str, default: int, what: str) -> None:
    """Add an option for a number of things that the adversary does; ``what`` describes them in the help."""
    help = f'{what}, 0 to 3 (default: {default})'
    parser.add_argument(flag, metavar='N', type=int, choices=range(4), default=default, help=help)


def add_limits(parser: argparse.ArgumentParser) -> None:
    """Add ``options.seconds``, ``options.situations``, ``options.save_test``, ``options.save_recording``,
    ``options.draw``, ``options.anew``, ``options.json``, ``options.quiet``."""
    seconds = 'stop after this processor time, and report what was explored'
    arguments.add_number(parser, '--seconds', 'S', DEFAULT_SECONDS, seconds)
    situations = 'stop at this number of situations'
    arguments.add_number(parser, '--situations', 'N', DEFAULT_CONFIGURATIONS, situations, _count)
    parser.add_argument('--save-test', metavar='FILE', help='write the counterexamples as a test for pytest')
    parser.add_argument(
        '--save-recording', metavar='FILE', help='write the counterexamples as a recording, for console replay'
    )
    parser.add_argument(
        '--draw',
        metavar='FILE',
        type=arguments.picture(*DIAGRAMS),
        help='draw the counterexamples as sequence diagrams, SVG or Mermaid (.mmd): FILE, FILE-2 ...',
    )
    parser.add_argument('--anew', action='store_true', help='explore again what is in the cache')
    parser.add_argument('--quiet', action='store_true', help='print no progress')
    arguments.add_json(parser)


def proof_cache(options: argparse.Namespace) -> ProofCache | None:
    """Return the cache of earlier proofs; None if the options disable it."""
    return None if options.anew else ProofCache()


def add_requirements(parser: argparse.ArgumentParser, what: str) -> None:
    """Add ``options.require`` and ``options.requirements``; ``what`` names the proved object in the help."""
    arguments.add_list(parser, '--require', 'TEXT', f'requirement of the {what}, such as "never /Drive > failed"')
    parser.add_argument(
        '--requirements', metavar='FILE', help='YAML file of requirements, by the names of behaviors and trees'
    )


def requirements(
    options: argparse.Namespace,
) -> tuple[list[StatedRequirement], dict[str, tuple[StatedRequirement, ...]]]:
    """Return the requirements of the options, and those of the requirements file, by name. Raises UsageError and
    UnfitError."""
    try:
        own = [parse_requirement(text, '--require') for text in options.require]
    except RequirementError as error:
        raise UsageError(str(error)) from None
    if options.requirements is None:
        return own, {}
    try:
        return own, read_requirements(read_text_file(options.requirements, _MOST_BYTES), options.requirements)
    except RequirementError as error:
        raise UnfitError(str(error)) from None


def warn_unused(options: argparse.Namespace, named: Iterable[str], proved: Collection[str]) -> None:
    """Warn about names in the requirements file that no proof uses."""
    unused = [name for name in named if name not in proved]
    if unused:
        print(f'{options.requirements}: not proved here: {one_line(", ".join(unused), 500)}', file=sys.stderr)


def _with_steps(report: Report) -> dict[str, Any]:
    """Return a report as plain data, with the steps of each counterexample for a player."""
    assert report.make is not None
    plain = report_as_json(report)
    for told, found in zip(plain['wrong'], report.counterexamples, strict=True):
        told['steps'] = played(report.make, found.moves)
    return plain


def _compared_with_steps(compared: Compared) -> dict[str, Any]:
    """Return a comparison as plain data, with the steps of the version now to each difference for a player."""
    plain = comparison_as_json(compared)
    for told, found in zip(plain['differences'], compared.comparison.differences, strict=True):
        assert compared.comparison.make is not None
        told['steps'] = played(compared.comparison.make, found.moves)
    return plain


@contextmanager
def proving(options: argparse.Namespace) -> Iterator[ProgressLine]:
    """Show the progress of proofs. Raises RefusedError for trees that cannot be built, UsageError for an engine that
    cannot be restored."""
    progress = ProgressLine(not options.quiet)
    try:
        yield progress
    except TreeLoadError as error:
        raise RefusedError(error.errors) from error
    except RestoreError as error:
        raise UsageError(str(error)) from error
    finally:
        progress.end()


def tell(
    options: argparse.Namespace,
    library: TreeLibrary,
    replays: Sequence[Replay],
    proofs: Sequence[tuple[TreeKey | None, Report]],
    compared: Sequence[Compared],
) -> ExitCode:
    """Print the results, write the requested test, diagrams and recording, and return the exit code.

    ``proofs`` are those of trees of the library, and of a machine (None).
    """
    reports = [report for _, report in proofs]
    if options.json:
        findings = (
            one for key, report in proofs for one in proof_findings(report, node_places(library, key) if key else {})
        )
        plain: dict[str, Any] = {'proofs': [_with_steps(report) for report in reports], 'findings': list(findings)}
        if compared:
            plain['comparisons'] = [_compared_with_steps(one) for one in compared]
        print(json.dumps(plain))
    else:
        lines = [line for report in reports for line in report_lines(report)]
        for line in [*lines, *(line for one in compared for line in comparison_lines(one))]:
            print(one_line(line, 2000))
    is_wrong = any(not report.holds for report in reports)
    if is_wrong:
        _save(options, replays, reports)
    if any(not (report.holds or report.is_dead_code) for report in reports) or any(not one.is_same for one in compared):
        return ExitCode.NEGATIVE
    if is_wrong:
        return ExitCode.UNREACHABLE
    followed = [report.is_complete for report in reports] + [one.comparison.is_complete for one in compared]
    return ExitCode.OK if all(followed) else ExitCode.UNFINISHED


def _save(options: argparse.Namespace, replays: Sequence[Replay], reports: Sequence[Report]) -> None:
    from flexbt_formal.proofs.counterexamples import draw_counterexamples, record_counterexamples  # rarely needed

    if options.draw is not None:
        files = draw_counterexamples(options.draw, reports)
        print(f'drawn in {", ".join(files)}', file=sys.stderr)
    if options.save_test is not None:
        write_text_file(options.save_test, saved_test(options.save_test, replays))
        print(f'the test is in {options.save_test}', file=sys.stderr)
    if options.save_recording is not None:
        record_counterexamples(options.save_recording, reports)
        print(f'the recording is in {options.save_recording}: console replay shows it', file=sys.stderr)


def node_settings(options: argparse.Namespace) -> dict[str, Any]:
    """Return the ``--given`` keys and the options of :func:`arguments.add_node_types`, for a saved test."""
    is_usual = options.nav2_branch == NAV2_BRANCHES[0]
    return {
        'given': options.given,
        'models': [File(file) for file in options.models],
        'nav2_branch': '' if is_usual else options.nav2_branch,
    }


def _count(text: str) -> int:
    if not text.isascii() or not text.isdigit() or not 0 < len(text) < 10 or int(text) < 1:
        raise argparse.ArgumentTypeError(f'{text!r} is not a whole number above 0')
    return int(text)

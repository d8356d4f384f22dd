# SPDX-License-Identifier: BSD-3-Clause
"""The command ``flexbt``: examine a robot, write a package for missions, propose a manifest of a robot's servers."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from rclpy.exceptions import InvalidNamespaceException
from rclpy.validate_namespace import validate_namespace

from flexbt_common.command_line import SuggestingArgumentParser, run_program
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.values.findings import finding_record
from flexbt_core.values.text import escape_lines, pluralize, short_repr

from .doctor import Finding, Level, RobotCheck, machine_findings
from .graph import observe
from .manifest import manifest_text, proposed_nodes
from .package_template import UnwritableError, write_package

SIGNS = {Level.OK: 'ok     ', Level.WARNING: 'WARNING', Level.ERROR: 'ERROR  '}


def main(words: Sequence[str] | None = None) -> int:
    """Run ``flexbt`` and return its exit code: 0 fine, 1 errors were found, 2 wrong usage."""
    return run_program('flexbt', lambda: _run(words))


def _run(words: Sequence[str] | None) -> int:
    parser = SuggestingArgumentParser(prog='flexbt', description=__doc__, allow_abbrev=False)
    commands = parser.add_subparsers(dest='command', required=True)
    doctor = commands.add_parser('doctor', help='report what is wrong with this computer and this robot')
    doctor.add_argument('--json', action='store_true', help='print the findings as JSON, one object per line')
    doctor.add_argument('--machine', action='store_true', help='check only this computer, and look for no robot')
    init = commands.add_parser('init', help='write a package: behavior, tree, leaves, tests, launch and systemd files')
    init.add_argument('name', help='name of the package, such as my_missions')
    init.add_argument('--directory', type=Path, default=Path(), help='where it is written (default: here)')
    manifest = commands.add_parser('manifest', help='propose node types for the servers of a running robot, as YAML')
    manifest.add_argument('--from-graph', action='store_true', required=True, help='look at the nodes that run now')
    manifest.add_argument('--file', type=Path, help='write this file, which must not exist; default: print')
    for one in (doctor, manifest):
        one.add_argument('--namespace', type=_namespace, default='', help='namespace of the robot, such as /robot1')
        one.add_argument('--seconds', type=_seconds, default=10.0, help='most time for nodes to be found (default 10)')
    options = parser.parse_args(words)
    try:
        return {'doctor': run_doctor, 'init': run_init, 'manifest': run_manifest}[options.command](options)
    except UnwritableError as error:
        print(*escape_lines(f'flexbt: {error}'), sep='\n', file=sys.stderr)
        return 2


def _namespace(text: str) -> str:
    name = f'/{text.strip("/")}'
    try:
        validate_namespace(name)
    except InvalidNamespaceException as error:
        raise argparse.ArgumentTypeError(f'{short_repr(text)} is not a namespace of ROS: {error}') from error
    return name.rstrip('/')


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.1 <= value <= 600.0:
        raise argparse.ArgumentTypeError(f'{short_repr(text)} is not a number between 0.1 and 600')
    return value


def run_doctor(options: argparse.Namespace) -> int:
    """Print the findings; return 1 if one of them is an error."""
    worst = 0
    for finding in _findings(options):
        if options.json:
            found = finding_record(finding.check, finding.level.value, finding.what, fix=finding.remedy)
            print(json.dumps(found), flush=True)
        else:
            print(*escape_lines(f'{SIGNS[finding.level]} {finding.check}: {finding.what}'), sep='\n', flush=True)
            if finding.remedy:
                print(*escape_lines(f'        -> {finding.remedy}'), sep='\n', flush=True)
        worst = max(worst, int(finding.level is Level.ERROR))
    return worst


def _findings(options: argparse.Namespace) -> Iterator[Finding]:
    here = list(machine_findings())
    yield from here
    # No node starts in a domain that cannot be.
    if not options.machine and not any(one.check == 'domain' and one.level is Level.ERROR for one in here):
        with NodeRuntime.open('flexbt_doctor', namespace=options.namespace or None) as runtime:
            yield from RobotCheck(runtime, options.namespace, options.seconds).findings()


def run_init(options: argparse.Namespace) -> int:
    """Write the package."""
    files = write_package(options.name, options.directory)
    print('\n'.join(map(str, files)))
    print(f'\nnext: colcon build --packages-select {options.name}; see {options.directory / options.name}/README.md')
    return 0


def run_manifest(options: argparse.Namespace) -> int:
    """Print or write the proposal; return 1 if there is no server."""
    with NodeRuntime.open('flexbt_manifest', args=()) as runtime:
        graph = observe(runtime, options.seconds)
    nodes = proposed_nodes(graph, options.namespace)
    if not nodes:
        found = pluralize(len(graph.nodes), 'other node')
        print(
            f'flexbt: no server was found in the namespace {options.namespace or "/"}, and {found}; '
            'is the robot started, and --namespace and ROS_DOMAIN_ID right? "flexbt doctor" tells more',
            file=sys.stderr,
        )
        return 1
    text = manifest_text(nodes)
    if options.file is None:
        print(text, end='')
        return 0
    try:
        with options.file.open('x', encoding='utf-8') as file:
            file.write(text)
    except OSError as error:
        raise UnwritableError(f'{options.file}: {error.strerror}; choose another file') from error
    return 0

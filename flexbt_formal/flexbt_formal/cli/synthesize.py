# SPDX-License-Identifier: BSD-3-Clause
"""``behavior_tool synthesize``: make a machine from capabilities and a request, or explain why there is none."""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path

from flexbt_core.values.findings import finding_record
from flexbt_core.values.text import escape_lines
from flexbt_formal.proofs.counterexamples import DIAGRAMS, draw_diagram
from flexbt_formal.proofs.sequence_picture import Arrow, Note, SequenceDiagram
from flexbt_formal.requests.synthesis import (
    MAX_BYTES,
    StateInterfaces,
    SynthesisFiles,
    explanation_lines,
    happening,
    read,
    read_problem,
    step_through,
)
from flexbt_formal.synthesis.capabilities import read_interfaces
from flexbt_formal.synthesis.errors import SynthesisError, SynthesisTimeout
from flexbt_formal.synthesis.explanation import Explanation
from flexbt_formal.synthesis.from_strategy import SynthesizedMachine
from flexbt_formal.synthesis.machine_text import machine_as_python, machine_as_yaml, state_instantiations
from flexbt_formal.synthesis.request_files import MachineRequest, as_structured_slugs, read_request
from flexbt_formal.synthesis.synthesis import Synthesis, synthesize, time_limited
from flexbt_formal.synthesis.translation import Liveness, Options, SynthesisProblem
from flexbt_onboard.behaviors.machine_behavior import state_modules
from flexbt_tools.cli import arguments
from flexbt_tools.errors import ExitCode, UnfitError, UsageError
from flexbt_tools.files import read_text_file, write_text_file

_DEFAULT_LIMIT = 60.0
_FORMS = ('yaml', 'python', 'flexbe')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        'file', metavar='FILE', nargs='?', help='capability file (YAML); not needed with a complete --spec'
    )
    asked = parser.add_argument_group('what is asked for')
    arguments.add_list(asked, '--goal', 'FORMULA', 'what the machine has to reach; with several, all of them')
    arguments.add_list(asked, '--initial', 'FORMULA', 'what holds at the start')
    arguments.add_list(asked, '--outcome', 'NAME', 'outcome of the machine')
    asked.add_argument('--request', metavar='FILE', help='request (YAML) with goals, initial_conditions, sm_outcomes')
    asked.add_argument('--spec', metavar='FILE', help='specification to add: YAML, or structuredslugs')
    world = parser.add_argument_group('states and the world')
    arguments.add_list(world, '--mappings', 'FILE', 'mappings of outcomes (default: the usual ones)')
    arguments.add_list(world, '--states', 'MODULE', 'module with more states')
    world.add_argument('--interfaces', metavar='FILE', help='outcomes and keys (YAML) of states that are not installed')
    liveness = (
        'fair: a capability that is retried completes at some time; adversarial: failing forever is success; '
        'fair-outcomes: as in flexbe_synthesis'
    )
    arguments.add_choice(world, '--liveness', Liveness, Liveness.FAIR.value, liveness)
    world.add_argument('--retries', metavar='N', type=int, help='retry a state N times, then give it up')
    world.add_argument('--pending', action='store_true', help="use flexbe_synthesis' flags for pending completions")
    world.add_argument('--parsed', action='store_true', help='use one integer for all activations')
    result = parser.add_argument_group('the answer')
    result.add_argument(
        '-o', '--output', metavar='FILE', help='file to write the machine to (default: standard output)'
    )
    forms = 'yaml; python: a behavior; flexbe: the fields of StateInstantiation[] as JSON'
    arguments.add_choice(result, '--form', _FORMS, _FORMS[0], forms)
    result.add_argument(
        '--draw',
        metavar='FILE',
        type=arguments.picture(*DIAGRAMS),
        help='if there is no machine, draw how the world prevents it: a sequence diagram, SVG or Mermaid (.mmd)',
    )
    result.add_argument('--certificate', metavar='FILE', help='file to write the strategy to, as JSON with its proof')
    result.add_argument('--specification', action='store_true', help='print the formulas (structuredslugs) and exit')
    result.add_argument(
        '--step', action='store_true', help='if there is no machine, play the machine yourself, step by step'
    )
    result.add_argument(
        '--time-limit', metavar='S', type=arguments.positive, help=f'seconds (default: {_DEFAULT_LIMIT:g})'
    )
    arguments.add_json(result)


def run(options: argparse.Namespace) -> ExitCode:
    try:
        return _answered(options)
    except SynthesisError as error:
        raise UnfitError(str(error)) from error


def _answered(options: argparse.Namespace) -> ExitCode:
    others = read(options.interfaces, read_interfaces) if options.interfaces else None
    interfaces = StateInterfaces([*state_modules(), *options.states], others)
    request = read(options.request, read_request) if options.request else MachineRequest()
    request = replace(
        request,
        goals=(*request.goals, *options.goal),
        initial_conditions=(*request.initial_conditions, *options.initial),
        outcomes=(*request.outcomes, *options.outcome),
        name=request.name or Path(options.file or options.spec or '').stem,
    )
    how = Options(Liveness(options.liveness), _retries(options.retries), options.pending, options.parsed)
    capabilities = (read_text_file(options.file, MAX_BYTES), options.file) if options.file else None
    files = SynthesisFiles(capabilities, options.mappings, options.spec)
    problem = read_problem(files, request, interfaces, how)
    if options.specification:
        print('\n'.join(as_structured_slugs(problem.specification)))
        return ExitCode.OK
    limit = options.time_limit or request.timeout or _DEFAULT_LIMIT
    began = time.monotonic()
    try:
        answer = _solved(problem, limit)
    except SynthesisTimeout as error:
        if options.json:
            finding = finding_record('time-limit', 'error', str(error))
            print(json.dumps({'realizable': None, 'findings': [finding]}))
        print(*escape_lines(str(error)), sep='\n', file=sys.stderr)
        return ExitCode.UNFINISHED
    return _told(options, answer, interfaces, time.monotonic() - began)


def _retries(number: int | None) -> int | None:
    if number is not None and not 0 <= number <= 1000:
        raise UsageError(f'--retries {number}: write a number from 0 to 1000')
    return number


def _solved(problem: SynthesisProblem, limit: float) -> Synthesis:
    """Return the answer; on a terminal, show the progress until then."""
    try:
        return synthesize(problem, time_limited(limit, '--time-limit allows more', _show))
    finally:
        if sys.stderr.isatty():
            print('\r\x1b[K', end='', file=sys.stderr)


def _show(doing: str, seconds: float) -> None:
    if sys.stderr.isatty():
        print(f'\r\x1b[K{seconds:5.1f} s  {doing}', end='', file=sys.stderr, flush=True)


def _told(options: argparse.Namespace, answer: Synthesis, interfaces: StateInterfaces, seconds: float) -> ExitCode:
    if answer.explanation is not None:
        return _refused(options, answer, answer.explanation, seconds)
    assert answer.machine is not None and answer.strategy is not None
    text = _text(options.form, answer.machine, interfaces)
    if options.certificate:
        write_text_file(options.certificate, json.dumps(answer.strategy.to_json()) + '\n')
    if options.output:
        write_text_file(options.output, text)
    if options.json:
        print(
            json.dumps(
                {
                    'realizable': True,
                    'machine': text,
                    'notes': answer.machine.notes,
                    'seconds': round(seconds, 3),
                    'figures': answer.figures,
                    'findings': [],
                }
            )
        )
    elif not options.output:
        print(text, end='')
    for note in answer.machine.notes:
        print(f'note: {note}', file=sys.stderr)
    return ExitCode.OK


def _text(form: str, machine: SynthesizedMachine, interfaces: StateInterfaces) -> str:
    if form == 'python':
        return machine_as_python(machine, interfaces.module_of)
    if form == 'flexbe':
        return json.dumps(state_instantiations(machine), indent=1) + '\n'
    return machine_as_yaml(machine)


def _refused(options: argparse.Namespace, answer: Synthesis, explanation: Explanation, seconds: float) -> ExitCode:
    if options.draw:
        asked = ', '.join(answer.problem.request.goals) or 'the specification'
        draw_diagram(options.draw, counterstrategy_diagram(f'No machine can do that: {asked}', explanation))
    if options.json:
        fix = '; '.join(explanation.remedies)
        findings = [finding_record('unrealizable', 'error', demand, fix=fix) for demand in explanation.conflict]
        plain = {'realizable': False, 'seconds': round(seconds, 3), 'explanation': explanation.to_json()}
        print(json.dumps({**plain, 'findings': findings}))
        return ExitCode.NEGATIVE
    for line in explanation_lines(explanation):
        print(line)
    if options.step and explanation.play is not None:
        print()
        step_through(explanation.play, answer.problem)
    return ExitCode.NEGATIVE


# How the environment prevents a goal, as a sequence diagram.

_MACHINE, _WORLD = 'any machine', 'the world'


def counterstrategy_diagram(title: str, explanation: Explanation) -> SequenceDiagram:
    """Return a diagram of the events of an explanation; without events, of the goals that never become possible."""
    steps: list[Arrow | Note] = [Note(_MACHINE, ['These demands conflict:', *explanation.conflict])]
    for step in explanation.steps:
        steps.append(Arrow(_WORLD, _MACHINE, happening(step)))
        others = len(step.choices) - 1
        if step.chosen:
            steps.append(Arrow(_MACHINE, _WORLD, step.chosen))
        if others > 0:
            steps.append(Note(_MACHINE, ['or, in vain as well:', *(one for one in step.choices if one != step.chosen)]))
    end = [*explanation.never, *explanation.stuck]
    if explanation.steps and not explanation.stuck:
        end.append('… and so on forever; no other answer helps')
    steps.append(Note(_MACHINE, [f'No machine can do that: {explanation.kind.value}', *end], is_wrong=True))
    return SequenceDiagram(title, [_MACHINE, _WORLD], steps)

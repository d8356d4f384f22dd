# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``run_report``, which reports the metrics of a run in the event log as text, JSON or SVG."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from flexbt_common.command_line import SuggestingArgumentParser, is_full, run_program
from flexbt_common.files import USER_DIRECTORY, home_path
from flexbt_common.pictures.time_line import Bar, Look, time_line
from flexbt_core.values.text import one_line
from flexbt_core.values.text_files import file_problem, write_text

from .event_log import newest_log, rotated
from .run_metrics import ROOT, RunMetrics, metrics_of, read_events
from .run_spans import SpanError, ended_runs, send_spans, spans_of, traces_address

MOST_WAITING: Final = 100
"""Maximum number of runs that wait for a collector; the oldest are left out."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the report. Return 0, or 1 if the run does not exist or is ambiguous, or 2 if a file cannot be read."""
    return run_program('run_report', lambda: _report(arguments))


def _report(arguments: Sequence[str] | None) -> int:
    options = _parser().parse_args(arguments)
    if options.follow and not options.otlp:
        print('run_report: --follow needs --otlp', file=sys.stderr)
        return 2
    try:
        runs = metrics_of(read_events(_files(options.files)), wall=options.wall or bool(options.otlp))
        chosen = [run for run in runs if run.run.startswith(options.run)] if options.run else runs[-1:]
        if options.list:
            print('\n'.join(_summary(run) for run in runs) or 'no runs')
        elif options.follow:
            _send_as_they_end(options.otlp, _files(options.files)[-1])
        elif len(chosen) != 1:
            what = f'{len(chosen)} runs begin with {options.run!r}' if options.run else 'the event log has no run'
            print(one_line(f'run_report: {what}; --list shows them'), file=sys.stderr)
            return 1
        elif options.otlp:
            send_spans(options.otlp, spans_of(chosen[0]))
        elif options.svg:
            write_text(options.svg, timeline(chosen[0]))
            print(options.svg)
        elif options.json:
            print(json.dumps(as_json(chosen[0]), allow_nan=False))
        else:
            print('\n'.join(as_text(chosen[0])))
    except SpanError as error:
        print(one_line(f'run_report: {error}'), file=sys.stderr)
        return 1
    except OSError as error:
        if isinstance(error, BrokenPipeError) or is_full(error):
            raise
        print(one_line(f'run_report: {file_problem(error)}'), file=sys.stderr)
        return 2
    return 0


def _send_as_they_end(url: str, file: Path) -> None:
    """Send each run that ends from now on. One that a collector does not take is sent again with the next one, unless
    it never takes it."""
    waiting: deque[dict[str, Any]] = deque(maxlen=MOST_WAITING)
    for run in ended_runs(file):
        waiting.append(spans_of(run))
        while waiting:
            try:
                send_spans(url, waiting[0])
            except SpanError as error:
                what = 'a run is left out' if error.is_final else f'{len(waiting)} runs wait for it'
                print(one_line(f'run_report: {error}; {what}'), file=sys.stderr, flush=True)
                if not error.is_final:
                    break
            waiting.popleft()


def as_json(run: RunMetrics) -> dict[str, object]:
    """Return the metrics of a run, with its visits, waits and commands, for JSON. Times are in seconds."""
    shown = dataclasses.asdict(run)
    del shown['end']
    shown['visits'].sort(key=lambda visit: visit['begin'])
    return {
        **shown,
        'duration': run.duration,
        'waiting': run.waiting,
        'wait_causes': run.wait_causes(),
        'commands': run.commands(),
        'states': [dataclasses.asdict(one) for one in run.paths()],
    }


def as_text(run: RunMetrics) -> list[str]:
    """Return the metrics of a run as lines of text."""
    ended = one_line(run.outcome or 'no end') + (f' ({one_line(run.message)})' if run.message else '')
    share = 100.0 * run.waiting / run.duration if run.duration else 0.0
    shown = [
        f'{one_line(run.behavior)}: {ended}',
        f'run {one_line(run.run)}, started by {one_line(run.by) or "?"}, {run.duration:.1f} s',
        f'waiting for the operator {run.waiting:.1f} s ({share:.0f} %), decisions {len(run.waits)}, '
        f'faults {run.faults}',
        'of it (wall time): ' + ', '.join(f'{cause} {seconds:.1f} s' for cause, seconds in run.wait_causes().items()),
        *(f"the computer's clock was set by {by:+.1f} s, which no time here has" for by in run.clock_set),
        '',
        f'{"state":40} {"visits":>6} {"total s":>9} {"longest s":>9} {"waiting s":>9}  outcomes',
    ]
    for one in run.paths():
        outcomes = ' '.join(f'{one_line(name)}:{number}' for name, number in one.outcomes.items())
        shown.append(
            f'{one_line(one.path):40} {one.visits:6} {one.total:9.2f} {one.longest:9.2f} {one.waiting:9.2f}  {outcomes}'
        )
    commands = ', '.join(f'{one_line(name)} {number}' for name, number in run.commands().items())
    shown += ['', f'commands: {commands or "none"}']
    for given in run.interventions:
        what = one_line(f'{given.operator}: {" ".join(filter(None, [given.command, given.text]))} ({given.effect})')
        shown.append(f'  {given.time - run.begin:9.2f} s  {what}')
    if run.contradictions:
        shown += ['', 'not as the skills of the states say:']
    shown += [
        f'  {told.time - run.begin:9.2f} s  {one_line(told.path)}: {one_line(told.text)}' for told in run.contradictions
    ]
    return shown


def _summary(run: RunMetrics) -> str:
    ended = one_line(run.outcome) or 'no end'
    return f'{one_line(run.run)}  {run.duration:9.1f} s  {one_line(run.behavior)}: {ended}'


def _files(given: Sequence[str]) -> list[Path]:
    """Return the files of an event log, including rotated ones, oldest first.

    Raises:
        FileNotFoundError: a directory contains no event log.
    """
    if len(given) > 1:
        return [Path(name) for name in given]
    first = Path(given[0]) if given else home_path(USER_DIRECTORY)
    if not given or first.is_dir():
        newest = newest_log(first)
        if newest is None:
            raise FileNotFoundError(f'{first}: has no event log')
        first = newest
    number = 0
    while rotated(first, number + 1).exists():
        number += 1
    return [rotated(first, age) for age in range(number, -1, -1)]


def _parser() -> argparse.ArgumentParser:
    parser = SuggestingArgumentParser(
        prog='run_report', description='Figures of a run from the event log of its executive: the last run, or --run.'
    )
    parser.add_argument(
        'files',
        nargs='*',
        metavar='FILE',
        help=f'event log of an executive, with those that were rotated; or a directory (default: {USER_DIRECTORY}), '
        'for the one below it to which something was added last; or several files, the oldest first',
    )
    parser.add_argument('--run', metavar='ID', help='the run whose identifier begins so')
    parser.add_argument('--list', action='store_true', help='list the runs')
    parser.add_argument('--json', action='store_true', help='print JSON')
    parser.add_argument('--svg', metavar='FILE', help='write a picture of the timeline')
    parser.add_argument('--wall', action='store_true', help="wall time instead of the node's clock")
    parser.add_argument(
        '--otlp', metavar='URL', type=traces_address, help='send it to a collector of OpenTelemetry (OTLP over HTTP)'
    )
    parser.add_argument('--follow', action='store_true', help='with --otlp: each run that ends from now on')
    return parser


_LOOKS: Final = {
    'machine': Look('#c9d6e8', '#3a4a61', 'machine'),
    'state': Look('#4c78a8', '#6fa0d6', 'state'),
    'forced': Look('#b279a2', '#d09bc0', 'left by force'),
    'open': Look('#9a9a9a', '#777', 'not left by an outcome'),
    'wait': Look('#f2a13e', '#f2a13e', 'waits for the operator'),
    'who': Look('#c0392b', '#ff8a80', 'command of an operator'),
    'refused': Look('#c0392b', '#ff8a80', 'refused command', is_dashed=True),
}


def timeline(metrics: RunMetrics) -> str:
    """Return the timeline of a run as an SVG document: a row for each state and machine, a bar for each visit and each
    wait, and a line for each command of an operator."""
    paths = [one.path for one in metrics.paths()]
    machines = {path for path in paths for other in paths if other != path and other.startswith(path.rstrip('/') + '/')}
    labels = [path if path == ROOT else '\u2003' * (path.count('/') - 1) + path.rsplit('/', 1)[-1] for path in paths]
    bars = []
    for visit in metrics.visits:
        if visit.path in paths:
            forced = 'forced' if visit.reason == 'forced' else 'state'
            kind = 'machine' if visit.path in machines else forced if visit.outcome else 'open'
            told = f'{visit.path}: {visit.outcome or "not left by an outcome"}, {visit.end - visit.begin:.3f} s'
            bars.append(Bar(paths.index(visit.path), visit.begin, visit.end, kind, told))
    for wait in metrics.waits:
        if wait.path in paths:
            told = f'{wait.path} waited for the operator, {wait.end - wait.begin:.1f} s: {wait.outcome or wait.kind}'
            bars.append(Bar(paths.index(wait.path), wait.begin, wait.end, 'wait', told, 8))
    for one in metrics.interventions:
        told = f'{one.operator}: {one.command} {one.text} ({one.effect})'
        bars.append(Bar(None, one.time, one.time, 'who' if one.effect == 'applied' else 'refused', told))
    title = f'{metrics.behavior}: {metrics.outcome or "no end"} after {metrics.duration:.1f} s'
    below = f'run {metrics.run}, waiting for the operator {metrics.waiting:.1f} s'
    span = metrics.begin, metrics.begin + metrics.duration
    return time_line([title, below], list(zip(labels, paths, strict=True)), bars, _LOOKS, span, metrics.begin)


if __name__ == '__main__':
    sys.exit(main())

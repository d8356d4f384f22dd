# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``run_report``: figures of a run from the event log of its executive, as text, JSON, or a picture."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from flexbt_common.cli import (
    USER_DIRECTORY,
    HintingArgumentParser,
    abandon_stdout,
    home_path,
    make_streams_safe,
    report_full_output,
)
from flexbt_core.values import one_line, write_text

from .event_log import newest_log, rotated
from .run_metrics import RunMetrics, metrics_of, read_events
from .run_timeline import timeline


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the report; 0 when there is one, 1 when there is no such run, 2 for a file that cannot be read."""
    make_streams_safe()
    options = _parser().parse_args(arguments)
    try:
        runs = metrics_of(read_events(_files(options.files)), wall=options.wall)
        chosen = [run for run in runs if run.run.startswith(options.run)] if options.run else runs[-1:]
        if options.list:
            print('\n'.join(_summary(run) for run in runs) or 'no runs')
        elif len(chosen) != 1:
            what = f'{len(chosen)} runs begin with {options.run!r}' if options.run else 'the event log has no run'
            print(one_line(f'run_report: {what}; --list shows them'), file=sys.stderr)
            return 1
        elif options.svg:
            write_text(options.svg, timeline(chosen[0]))
            print(options.svg)
        elif options.json:
            print(json.dumps(as_json(chosen[0]), allow_nan=False))
        else:
            print('\n'.join(as_text(chosen[0])))
        sys.stdout.flush()
    except BrokenPipeError:
        abandon_stdout()
    except OSError as error:
        if not report_full_output('run_report', error):
            print(one_line(f'run_report: {error}'), file=sys.stderr)
        return 2
    return 0


def as_json(run: RunMetrics) -> dict[str, object]:
    """The figures and what they are made of, for programs. Times in seconds."""
    return {
        'run': run.run,
        'behavior': run.behavior,
        'by': run.by,
        'begin': run.begin,
        'duration': run.duration,
        'waiting': run.waiting,
        'wait_causes': run.wait_causes(),
        'outcome': run.outcome,
        'message': run.message,
        'faults': run.faults,
        'commands': run.commands(),
        'states': [dataclasses.asdict(one) for one in run.paths()],
        'visits': [dataclasses.asdict(one) for one in sorted(run.visits, key=lambda visit: visit.begin)],
        'waits': [dataclasses.asdict(one) for one in run.waits],
        'clock_set': run.clock_set,
        'contradictions': [dataclasses.asdict(one) for one in run.contradictions],
        'interventions': [dataclasses.asdict(one) for one in run.interventions],
    }


def as_text(run: RunMetrics) -> list[str]:
    """The figures for a person."""
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
    shown += ['', 'commands: ' + (', '.join(f'{name} {number}' for name, number in run.commands().items()) or 'none')]
    for given in run.interventions:
        what = ' '.join(filter(None, [given.command, one_line(given.text)]))
        shown.append(f'  {given.time - run.begin:9.2f} s  {one_line(given.operator)}: {what} ({given.effect})')
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
    """The files of an event log, the oldest first: those that were rotated belong to it.

    Raises FileNotFoundError when a directory has none.
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
    parser = HintingArgumentParser(
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
    return parser


if __name__ == '__main__':
    sys.exit(main())

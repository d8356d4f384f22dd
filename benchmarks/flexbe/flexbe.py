# SPDX-License-Identifier: BSD-3-Clause
"""FlexBT beside FlexBE 2.3.3, in turns: the same behavior, the same operator, the same action server.

1. From an operator's command, which forces an outcome, to the entry of the next state.
2. From the end of a goal at its action server to the entry of the next state. FlexBE's state looks for the result at
   its rate. FlexBT's is woken; or a leaf of a tree calls the action, and the result comes back by the BT server; or it
   is FlexBE's state, run by FlexBT.
3. Processor time of the executive while one state is active and waits.
4. The engines alone: a transition 4 levels deep. FlexBE publishes and logs each transition when it is supervised, and
   not otherwise; FlexBT's engine never does, its host does.

Every engine is a process of its own; the states themselves say when they are entered, on the system's monotonic clock.
The operator and the server take times that are spread evenly over at least one period of FlexBE's states. A ratio is
of the medians of one round; given are its median over the rounds and its range, and the ratio of the 99th percentiles
of all rounds. A result that never comes, because the library has lost the server's answer to the goal, is counted; the
operator forces the transition then.

Usage: python3 benchmarks flexbe [--flexbe DIRECTORY] [--rounds N] [--samples N] [--output FILE.json]

DIRECTORY is where FlexBE 2.3.3 is installed, with a setup.bash; benchmarks/README.md says what it needs. Without it,
FlexBT is measured alone.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree  # of an installed package
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final

from _figures import install_behavior, write_figures
from _flexbe_engine import SUBJECTS
from _flexbe_native import TREE_XML
from _flexbe_stamp import ADDRESS
from domain_coordinator import domain_id

from flexbt_common.discovery import only_this_computer
from flexbt_testing.system.processes import executable

HERE: Final = Path(__file__).resolve().parent
PACKAGE: Final = 'flexbe_probe_behaviors'
ENGINE_ROUNDS: Final = 10
QUIET: Final = ('--ros-args', '--log-level', 'warn')
OWN: Final = ('-p', 'peers:=[""]', '-p', 'event_log_directory:=""')

PACKAGE_XML: Final = f"""<package format="3"><name>{PACKAGE}</name><version>0.0.0</version>
<description>Benchmark</description><maintainer email="nobody@example.org">Nobody</maintainer>
<license>BSD-3-Clause</license>
<export><flexbe_behaviors/><build_type>ament_python</build_type></export></package>
"""
MANIFEST: Final = f"""<behavior name="FlexBE probe"><executable package_path="{PACKAGE}.probe_sm" class="FlexbeProbe"/>
<params><param type="numeric" name="rate" default="10.0" label="" hint=""/></params></behavior>
"""


def variants(onboard: int, flexbe: int | None) -> list[dict[str, Any]]:
    """Return what is measured. ``pause``: limits of the time that the operator and the server take, s."""

    def variant(name: str, engine: str, process: int, pause: tuple[float, float], behavior: str, **given: str) -> Any:
        return {
            'name': name,
            'engine': engine,
            'process': process,
            'pause': pause,
            'behavior': behavior,
            'arguments': given,
        }

    rows = [
        variant('FlexBT', 'FlexBT', onboard, (0.03, 0.06), 'Native probe'),
        variant('FlexBT, by a tree', 'FlexBT', onboard, (0.03, 0.06), 'Native probe', through_tree='true'),
        variant("FlexBT, FlexBE's states", 'FlexBT', onboard, (0.03, 0.06), 'FlexBE probe', rate='10.0'),
    ]
    if flexbe is not None:
        # A state that is entered again before its period is over is not executed at once: that is no latency.
        rows += [
            variant('FlexBE, 10 Hz', 'FlexBE', flexbe, (0.1, 0.2), 'FlexBE probe', rate='10.0'),
            variant('FlexBE, 100 Hz', 'FlexBE', flexbe, (0.03, 0.06), 'FlexBE probe', rate='100.0'),
        ]
    return rows


def install_behaviors(directory: Path) -> None:
    """Make the behaviors known to the processes that are started from now on: both engines', and the tree."""
    install_behavior(directory, HERE / '_flexbe_native.py', 'FlexbeNative')
    source = directory / PACKAGE / 'probe_sm.py'
    for file, text in {
        directory / f'share/{PACKAGE}/package.xml': PACKAGE_XML,
        directory / f'share/{PACKAGE}/config/probe.xml': TREE_XML,
        directory / f'share/ament_index/resource_index/packages/{PACKAGE}': '',
        directory / f'lib/{PACKAGE}/manifest/probe.xml': MANIFEST,
        source.with_name('__init__.py'): '',
        source: (HERE / '_flexbe_behavior.py').read_text(encoding='utf-8'),
        directory / '_flexbe_stamp.py': (HERE / '_flexbe_stamp.py').read_text(encoding='utf-8'),
    }.items():
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    os.environ['AMENT_PREFIX_PATH'] = f'{directory}{os.pathsep}{os.environ.get("AMENT_PREFIX_PATH", "")}'


def sourced(directory: Path) -> dict[str, str]:
    """Return the environment with FlexBE's packages on top.

    Raises:
        SystemExit: they are not there, or of another version.
    """
    if not (directory / 'setup.bash').is_file():
        raise SystemExit(f'{directory} has no setup.bash; --flexbe wants the directory that FlexBE is installed in')
    script = '. "$1/setup.bash" > /dev/null && exec env -0'
    given = subprocess.run(['bash', '-c', script, 'bash', str(directory)], capture_output=True, text=True, check=True)
    environment = dict(line.split('=', 1) for line in given.stdout.split('\0') if line)
    for prefix in environment['AMENT_PREFIX_PATH'].split(os.pathsep):
        manifest = Path(prefix, 'share', 'flexbe_onboard', 'package.xml')
        if manifest.is_file():
            version = ElementTree.parse(manifest).findtext('version', '')  # noqa: S314
            if version.startswith('2.'):
                return environment
            raise SystemExit(f'{prefix}: FlexBE {version}; the benchmark speaks the operator link of 2.3.3')
    raise SystemExit(f'{directory}: flexbe_onboard is not installed there; benchmarks/README.md says what is needed')


@contextmanager
def running(command: Sequence[str], environment: Mapping[str, str]) -> Iterator[int]:
    """Provide a process, while it is needed: its id."""
    process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL)
    try:
        yield process.pid
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def engines(environments: Mapping[str, Mapping[str, str]]) -> dict[str, list[float]]:
    """Microseconds of a transition, a sample for each round."""
    samples: dict[str, list[float]] = {}
    support = str(HERE.parent / 'support')
    with ExitStack() as stack:
        workers = {
            engine: stack.enter_context(
                subprocess.Popen(
                    [sys.executable, str(HERE / '_flexbe_engine.py'), engine],
                    env={**environment, 'PYTHONPATH': f'{support}{os.pathsep}{environment.get("PYTHONPATH", "")}'},
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                    text=True,
                )
            )
            for engine, environment in environments.items()
        }
        for _ in range(ENGINE_ROUNDS):
            for engine, worker in workers.items():
                assert worker.stdin is not None and worker.stdout is not None
                for subject in SUBJECTS[engine]:
                    print(subject, file=worker.stdin, flush=True)
                    samples.setdefault(f'{engine}, {subject}', []).append(float(worker.stdout.readline()))
    return samples


def latencies(arguments: argparse.Namespace, environments: Mapping[str, Mapping[str, str]], directory: Path) -> Any:
    """Return what the probe has measured: for each variant its blocks."""
    own, theirs = environments['FlexBT'], environments.get('FlexBE')
    specification, output = directory / 'specification.json', directory / 'blocks.json'
    preload = ['-p', f'preload:=["{PACKAGE}/config/probe.xml"]']
    with ExitStack() as stack:
        stack.enter_context(running([executable('bt_server'), *QUIET, *preload], own))
        onboard = stack.enter_context(running([executable('onboard_executive'), *QUIET, *OWN], own))
        flexbe = None
        if theirs is not None:
            flexbe = stack.enter_context(running([sys.executable, str(HERE / '_flexbe_onboard.py'), *QUIET], theirs))
        specification.write_text(
            json.dumps(
                {
                    'rounds': arguments.rounds,
                    'samples': arguments.samples,
                    'flexbe': theirs and (f'{PACKAGE}.probe_sm', str(directory / PACKAGE / 'probe_sm.py')),
                    'variants': variants(onboard, flexbe),
                }
            )
        )
        probe = [sys.executable, str(HERE / '_flexbe_probe.py'), str(specification), str(output)]
        if subprocess.run(probe, env=theirs or own).returncode:
            raise SystemExit('the benchmark failed')
    return json.loads(output.read_text())


def summary(rounds: Sequence[Sequence[float]]) -> dict[str, float]:
    """Median, 90th and 99th percentile and maximum of all rounds."""
    values = [value for one in rounds for value in one]
    cuts = statistics.quantiles(values, n=100, method='inclusive')
    return {'median': statistics.median(values), 'p90': cuts[89], 'p99': cuts[98], 'max': max(values)}


def ratios(theirs: Sequence[Sequence[float]], ours: Sequence[Sequence[float]]) -> dict[str, float]:
    """Return how many times as much theirs is: by the medians of the rounds, and by the 99th percentiles of all of
    them."""
    values = [statistics.median(a) / statistics.median(b) for a, b in zip(theirs, ours, strict=True)]
    p99 = summary(theirs)['p99'] / summary(ours)['p99']
    return {'median': statistics.median(values), 'least': min(values), 'most': max(values), 'p99': p99}


def compared(rows: Mapping[str, Sequence[Sequence[float]]]) -> dict[str, Any]:
    """Return a figure of all variants, and each of FlexBE's against each of ours."""
    return {
        'figures': {name: summary(rounds) for name, rounds in rows.items()},
        'ratios': {
            f'{theirs} / {ours}': ratios(rows[theirs], rows[ours])
            for theirs in rows
            for ours in rows
            if theirs.startswith('FlexBE') and ours.startswith('FlexBT')
        },
    }


def show(results: Mapping[str, Any]) -> None:
    """Print all figures."""
    for what, result in results.items():
        print(f'\n{what:52}{"median":>9}{"p90":>9}{"p99":>9}{"max":>9}')
        for name, row in result['figures'].items():
            print(f'  {name:50}' + ''.join(f'{row[column]:9.2f}' for column in ('median', 'p90', 'p99', 'max')))
        for name, row in result['ratios'].items():
            spread = f'{row["least"]:.1f} to {row["most"]:.1f}'
            print(f'  {name:50}{row["median"]:8.1f}x{"":9}{row["p99"]:8.1f}x   {spread}')


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--flexbe', type=Path, help='where FlexBE 2.3.3 is installed')
    parser.add_argument('--rounds', type=int, default=6)
    parser.add_argument('--samples', type=int, default=30, help='of each latency, in each round')
    parser.add_argument('--output', type=Path, default=Path('out/flexbe.json'))
    arguments = parser.parse_args()
    with domain_id() as domain, tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        os.environ.update(
            {
                'ROS_DOMAIN_ID': str(domain),
                'ROS_LOG_DIR': name,
                ADDRESS: str(directory / 'entries'),
            }
        )
        only_this_computer()
        install_behaviors(directory)
        environments = {'FlexBT': dict(os.environ)}
        if arguments.flexbe is not None:
            environments['FlexBE'] = sourced(arguments.flexbe.resolve())
        else:
            print('FlexBT alone; with --flexbe, FlexBE is measured beside it (benchmarks/README.md)')
        alone = engines(environments)
        blocks = latencies(arguments, environments, directory)
    units = {'command to effect': 'ms', 'result to transition': 'ms', 'at rest': '% of a core'}
    results = {
        f'{what} ({unit})': compared({name: [one[what] for one in rounds] for name, rounds in blocks.items()})
        for what, unit in units.items()
    }
    results['engine alone, a transition (us)'] = compared(
        {name: [[one] for one in rows] for name, rows in alone.items()}
    )
    show(results)
    lost = {name: sum(one['lost'] for one in rounds) for name, rounds in blocks.items()}
    print('\nresults that never came: ' + ', '.join(f'{name}: {count}' for name, count in lost.items()))
    write_figures(arguments.output, {**results, 'results that never came': lost})
    return 0


if __name__ == '__main__':
    sys.exit(main())

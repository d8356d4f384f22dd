# SPDX-License-Identifier: BSD-3-Clause
"""Change the product at random places and report the changes that no test notices (mutation testing, by mutmut).

``make mutants AREA=nodes MINUTES=20`` first runs the area's tests once, to find which of them reach which function.
Then it tries mutants, drawn by ``SEED``, until the time is up. It prints each survivor as a diff, and the share that
the tests notice. The exit code is 1 when less than 95 % are noticed. Everything is done in ``out/mutants``.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).resolve().parents[1]
REQUIREMENTS: Final = ROOT / 'tools' / 'requirements-mutants.txt'
PACKAGES: Final = ROOT / '.venv' / 'mutants'
OUTPUT: Final = ROOT / 'out' / 'mutants'
GOAL: Final = 0.95
"""The share of mutants that tests have to notice."""
BATCH: Final = 40
"""Mutants that are tried before the time is looked at."""
NOTICED: Final = frozenset((1, 3, 24, 36, 152, 255, -9, -11, -24))
"""Exit codes that mean that a test failed, crashed or did not end; 0 is a survivor, 33 a mutant that no test
reaches."""


class Area(NamedTuple):
    """Files that are mutated, and the tests that have to notice it; both are relative to the package."""

    package: str
    files: tuple[str, ...]
    tests: tuple[str, ...]


TREES: Final = 'behavior_tree'
MACHINES: Final = 'state_machine'
AREAS: Final = {
    'model': Area('flexbt_core', (f'{TREES}/model/*', f'{MACHINES}/model/*'), (f'test/{TREES}', f'test/{MACHINES}')),
    'engine': Area('flexbt_core', (f'{TREES}/engine/*', f'{MACHINES}/engine/*'), (f'test/{TREES}', f'test/{MACHINES}')),
    'nodes': Area('flexbt_core', (f'{TREES}/nodes/*',), (f'test/{TREES}',)),
    'commands': Area('flexbt_onboard', ('commands/*',), ('test/commands',)),
    'stop': Area('flexbt_onboard', ('runs/stop_enforcer.py', 'runs/motion_stop.py'), ('test/runs',)),
}


def install() -> None:
    """Install the pinned packages into a directory of their own, unless they are installed."""
    stamp = PACKAGES / 'stamp'
    wanted = f'{hashlib.sha256(REQUIREMENTS.read_bytes()).hexdigest()} {sys.version}'
    if stamp.exists() and stamp.read_text(encoding='utf-8') == wanted:
        return
    shutil.rmtree(PACKAGES, ignore_errors=True)
    pip = [sys.executable, '-m', 'pip', 'install', '--quiet', '--disable-pip-version-check', '--no-input', '--no-deps']
    subprocess.run([*pip, '--target', PACKAGES, '--requirement', REQUIREMENTS], check=True)
    stamp.write_text(wanted, encoding='utf-8')


def prepare(area: Area) -> Path:
    """Copy the package into the output directory, with mutmut's settings; return the copy."""
    copy = OUTPUT / area.package
    shutil.rmtree(OUTPUT, ignore_errors=True)
    shutil.copytree(ROOT / area.package, copy, ignore=shutil.ignore_patterns('__pycache__'))
    files = '\n    '.join(f'{area.package}/{file}' for file in area.files)
    tests = '\n    '.join(area.tests)
    (copy / 'setup.cfg').write_text(
        f'[mutmut]\nsource_paths = {area.package}\nonly_mutate =\n    {files}\n'
        f'pytest_add_cli_args_test_selection =\n    {tests}\nprocess_isolation = forkserver\n',
        encoding='utf-8',
    )
    return copy


def mutmut(copy: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run mutmut in the copy and return what it printed."""
    search = os.pathsep.join(filter(None, [str(PACKAGES), os.environ.get('PYTHONPATH')]))
    environment = os.environ | {'PYTHONPATH': search, 'FLEXBT_ACCELERATION': '0'}
    command = [sys.executable, '-m', 'mutmut', *arguments]
    return subprocess.run(command, cwd=copy, env=environment, capture_output=True, text=True, check=False)


def outcomes(copy: Path) -> dict[str, int | None]:
    """Return the exit code of the tests by mutant, None for one that was not tried."""
    found: dict[str, int | None] = {}
    for file in sorted((copy / 'mutants').rglob('*.meta')):
        found |= json.loads(file.read_text(encoding='utf-8'))['exit_code_by_key']
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument('--area', choices=AREAS, default='nodes')
    parser.add_argument('--minutes', type=float, default=20.0)
    parser.add_argument('--seed', type=int, default=0)
    options = parser.parse_args()
    install()
    copy = prepare(AREAS[options.area])
    first = mutmut(
        copy, 'run', '--max-children', '2', 'none.of.them'
    )  # writes the mutants, and which test reaches which
    names = sorted(outcomes(copy))
    if not names:
        print(first.stdout[-2000:], first.stderr[-2000:], file=sys.stderr)
        return 1
    random.Random(options.seed).shuffle(names)
    tried: list[str] = []
    deadline = time.monotonic() + 60 * options.minutes
    while len(tried) < len(names) and time.monotonic() < deadline:
        batch = names[len(tried) : len(tried) + BATCH]
        mutmut(copy, 'run', '--max-children', '2', *batch)
        tried += batch
    codes = outcomes(copy)
    survivors = [name for name in tried if codes[name] is not None and codes[name] not in NOTICED]
    noticed = sum(codes[name] in NOTICED for name in tried)
    for name in survivors:
        print(mutmut(copy, 'show', name).stdout)
    share = noticed / max(1, noticed + len(survivors))
    print(
        f'{options.area}: {len(tried)} of {len(names)} mutants tried, {noticed} noticed ({share:.1%}), '
        f'seed {options.seed}'
    )
    return 0 if share >= GOAL else 1


if __name__ == '__main__':
    sys.exit(main())

# SPDX-License-Identifier: BSD-3-Clause
"""Runs files with tests of FlexBE's: ``python3 -m flexbt_testing.flexbe FILE.test ...``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from flexbt_testing.nodes.state_bench import StateBench

from .state_test_file import StateTestError, read_state_test
from .state_test_run import SECONDS, run_state_test


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Run FlexBE's tests of states and behaviors.")
    parser.add_argument('files', nargs='+', type=Path, metavar='FILE.test')
    parser.add_argument('--timeout', type=float, default=SECONDS, help='seconds for each (default %(default)g)')
    given = parser.parse_args(arguments)
    failed = 0
    for file in given.files:
        try:
            with StateBench() as bench:
                problems = run_state_test(read_state_test(file), bench, given.timeout)
        except StateTestError as error:
            problems = [str(error).removeprefix(f'{file}: ')]
        failed += bool(problems)
        print(f'{"FAILED" if problems else "passed"}  {file}')
        for problem in problems:
            print('\n'.join(f'        {line}' for line in problem.splitlines()))
    print(f'{len(given.files) - failed} of {len(given.files)} passed')
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())

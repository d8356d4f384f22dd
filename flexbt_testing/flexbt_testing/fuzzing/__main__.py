# SPDX-License-Identifier: BSD-3-Clause
"""``python3 -m flexbt_testing.fuzzing [TARGET ...] [--seconds S] [--seed N]``: fuzz, and print the results.

The targets share the seconds. After a defect it prints the traceback, writes the text to a file in the current
directory, and exits with code 1.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import resource
import sys
import time
import traceback
from pathlib import Path

from domain_coordinator import domain_id

from flexbt_common.discovery import only_this_computer

from .fuzzer import Fuzzer
from .targets import TARGETS


def main() -> int:
    parser = argparse.ArgumentParser(prog='fuzzing', description=__doc__)
    parser.add_argument('targets', nargs='*', metavar='TARGET', help=f'one of {", ".join(TARGETS)} (default: all)')
    parser.add_argument('--seconds', type=float, default=60.0, help='for all targets together (default: 60)')
    parser.add_argument('--seed', type=int, default=None, help='another one gives other texts (default: the time)')
    options = parser.parse_args()
    if unknown := set(options.targets) - TARGETS.keys():
        parser.error(f'no such target: {", ".join(sorted(unknown))}; there are {", ".join(TARGETS)}')
    names = options.targets or list(TARGETS)
    seed = time.time_ns() if options.seed is None else options.seed
    found = False
    for name in names:
        with contextlib.closing(TARGETS[name]()) as target:
            fuzzer = Fuzzer(name, target, seed)
            try:
                fuzzer.run(options.seconds / len(names), Path.cwd())
            except Exception:
                found = True
                traceback.print_exc()
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000
        print(f'{name}: seed {seed}, {dict(fuzzer.counts)}, slowest {fuzzer.slowest:.2f} s, at most {memory:.0f} MB')
    return 1 if found else 0


if __name__ == '__main__':
    with domain_id() as domain:  # a domain that no robot uses
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        only_this_computer()
        sys.exit(main())

# SPDX-License-Identifier: BSD-3-Clause
"""What a transition of a state machine costs: the engine alone, without ROS.

Shapes: states in a ring in the root machine, and in a machine 4 levels deep; machines nested 4 deep that are entered
and ended all the time. Each state declares a userdata key of each kind, each outcome the autonomy that it requires.

Ways: 'chained' transitions follow each other in one step of the engine; 'woken' ones happen each in a step of its own,
after a wake-up; a 'confirmed' one waits for the operator, and happens when it is confirmed. What counts is the time of
the thread on the processor, so that what else the machine does matters little.

Usage: python3 benchmarks hfsm_transitions [--rounds N] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import gc
import statistics
import sys
from pathlib import Path
from typing import Any, Final

from _figures import write_figures
from _hfsm_subjects import SHAPES, WAYS, Subject

TARGET: Final = 15.0
"""Most that a transition of a state may cost, chained or woken, microseconds."""


def measure(rounds: int) -> list[dict[str, Any]]:
    """Microseconds of a transition: the median of the rounds, and the least."""
    subjects = {(shape, way): Subject(shape, way) for shape in SHAPES for way in WAYS}
    samples: dict[tuple[str, str], list[float]] = {key: [] for key in subjects}
    gc.collect()
    for _ in range(rounds):
        for key, subject in subjects.items():
            samples[key].append(subject.sample())
    return [
        {'shape': shape, 'way': way, 'median, us': statistics.median(values), 'least, us': min(values)}
        for (shape, way), values in samples.items()
    ]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--rounds', type=int, default=15)
    parser.add_argument('--output', type=Path, default=Path('out/hfsm_transitions.json'))
    arguments = parser.parse_args()
    rows = measure(arguments.rounds)
    print(f'{"microseconds of a transition":36}{"median":>9}{"least":>9}')
    for row in rows:
        print(f'{row["shape"] + ", " + row["way"]:36}{row["median, us"]:9.2f}{row["least, us"]:9.2f}')
    print(f'target: at most {TARGET:g} us 4 levels deep')
    write_figures(arguments.output, {'rows': rows, 'target, us': TARGET})
    return 0


if __name__ == '__main__':
    sys.exit(main())

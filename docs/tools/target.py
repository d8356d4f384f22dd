# SPDX-License-Identifier: BSD-3-Clause
"""The command-line argument of the programs of this directory: the output path."""

from __future__ import annotations

import argparse
from pathlib import Path


def target(what: str | None, default: Path) -> Path:
    """Return the path on the command line, or ``default``; ``what`` is the text of ``--help``."""
    parser = argparse.ArgumentParser(description=what, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('path', nargs='?', type=Path, default=default, help='output path (default: %(default)s)')
    path: Path = parser.parse_args().path
    return path

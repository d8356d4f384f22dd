# SPDX-License-Identifier: BSD-3-Clause
"""Entry of the tooling behind the Makefile; see cli.py. Started by tools/workspace.sh."""

import sys
from pathlib import Path

sys.path[0] = str(Path(__file__).resolve().parents[1])  # where the package is; Python puts the directory itself there

from workspace.cli import main  # noqa: E402

sys.exit(main())

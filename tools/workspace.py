# SPDX-License-Identifier: BSD-3-Clause
"""Entry of the tooling behind the Makefile; see flexbt_tools/cli.py. Started by workspace.sh."""

import sys

from flexbt_tools.cli import main

sys.exit(main())

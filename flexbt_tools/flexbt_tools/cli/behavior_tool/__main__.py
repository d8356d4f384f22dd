# SPDX-License-Identifier: BSD-3-Clause
"""``python3 -m flexbt_tools.cli.behavior_tool``, where the package is not installed as an executable."""

import sys

from . import main

sys.exit(main())

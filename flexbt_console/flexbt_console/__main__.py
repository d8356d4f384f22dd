# SPDX-License-Identifier: BSD-3-Clause
"""``python3 -m flexbt_console``, where the package is not installed as an executable."""

import sys

from flexbt_console.ui.console import main

sys.exit(main())

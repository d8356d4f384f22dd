# SPDX-License-Identifier: BSD-3-Clause
"""Where the figures of a benchmark go."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any


def write_figures(file: Path, figures: Any) -> None:
    """Write figures as JSON; directories that are missing are made."""
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(figures, indent=2) + '\n')

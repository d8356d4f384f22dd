# SPDX-License-Identifier: BSD-3-Clause
"""Files of what proofs have found."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from flexbt_common.pictures import SequenceDiagram, sequence_as_mermaid, sequence_as_svg
from flexbt_formal.exploration import Counterexample, Report
from flexbt_tools.errors import UsageError
from flexbt_tools.text_files import write_text

from .counterexample_diagram import counterexample_diagram

_MERMAID: Final = ('.mmd', '.mermaid')


def draw_diagram(file: str, diagram: SequenceDiagram) -> None:
    """Write a diagram: SVG, or in Mermaid's language when the file is called so (.mmd). Raises UsageError."""
    is_mermaid = Path(file).suffix.lower() in _MERMAID
    write_text(file, '\n'.join(sequence_as_mermaid(diagram)) + '\n' if is_mermaid else sequence_as_svg(diagram))


def draw_counterexamples(file: str, reports: Sequence[Report]) -> list[str]:
    """Write a diagram for each; the files: FILE, and with a number before the suffix where there are several.

    Raises UsageError.
    """
    found = _found(reports)
    path = Path(file)
    files = [
        file if number == 1 else str(path.with_name(f'{path.stem}-{number}{path.suffix}'))
        for number in range(1, len(found) + 1)
    ]
    for one, (report, counterexample) in zip(files, found, strict=True):
        draw_diagram(one, counterexample_diagram(report, counterexample))
    return files


def record_counterexamples(file: str, reports: Sequence[Report]) -> None:
    """Write all of them into one recording. Raises UsageError, also when there is such a file."""
    from .recording import record  # it loads ROS, and MCAP

    try:
        record(Path(file), _found(reports))
    except OSError as error:
        raise UsageError(f'{file}: cannot be written: {error.strerror or error}') from error


def _found(reports: Sequence[Report]) -> list[tuple[Report, Counterexample]]:
    return [(report, one) for report in reports for one in report.counterexamples]

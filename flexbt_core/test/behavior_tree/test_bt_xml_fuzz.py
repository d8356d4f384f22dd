# SPDX-License-Identifier: BSD-3-Clause
"""A slice of the fuzzer of the XML reader; ``bt_fuzz_xml.py`` goes on for as long as one likes."""

from __future__ import annotations

import os
from pathlib import Path

from flexbt_testing.behavior_trees.fuzz_xml import Fuzzer, fuzz

SECONDS = float(os.environ.get('FLEXBT_FUZZ_SECONDS', '5'))


def test_damaged_files_are_refused_with_places_or_are_trees(tmp_path: Path) -> None:
    fuzzer: Fuzzer = fuzz(SECONDS, 0, tmp_path)
    assert fuzzer.counts['rounds'] > 100 * SECONDS
    assert min(fuzzer.counts['refused'], fuzzer.counts['read'], fuzzer.counts['ticked']) > 0, fuzzer.counts

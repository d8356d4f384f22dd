# SPDX-License-Identifier: BSD-3-Clause
"""A slice of `make fuzz`: what once was a defect, what did harm to others, and damaged texts for some seconds."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

import pytest

from flexbt_testing.fuzzing.fuzzer import CORPUS, Fuzzer, Target
from flexbt_testing.fuzzing.targets import TARGETS

SECONDS = float(os.environ.get('FLEXBT_FUZZ_SECONDS', '2'))


@pytest.mark.parametrize('name', TARGETS)
def test_damaged_texts_are_refused_or_read(name: str, tmp_path: Path) -> None:
    with contextlib.closing(TARGETS[name]()) as target:
        fuzzer = Fuzzer(name, target, 0)
        fuzzer.run(SECONDS, tmp_path)
    assert fuzzer.counts['rounds'] > 0
    assert fuzzer.counts['refused'] > 0 and fuzzer.counts['read'] > 0, fuzzer.counts


def test_each_corpus_is_of_a_target() -> None:
    assert {directory.name for directory in CORPUS.iterdir()} <= TARGETS.keys()


def test_a_text_that_is_a_defect_is_kept_in_a_file(tmp_path: Path) -> None:
    class Careless(Target):
        words = ('a',)

        def seeds(self) -> list[str]:
            return ['bad']

        def read(self, data: bytes, counts: object) -> None:
            raise KeyError(data.decode())

    with pytest.raises(KeyError, match='bad') as caught:
        Fuzzer('careless', Careless(), 0).run(1.0, tmp_path)
    (file,) = tmp_path.iterdir()
    assert file.read_bytes() == b'bad'
    assert str(file) in caught.value.__notes__[0]

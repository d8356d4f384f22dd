# SPDX-License-Identifier: BSD-3-Clause
"""Random gestures of the studio on each file of a folder: trees (XML), machines (YAML) and behaviors (Python).

After each gesture the text must parse, differ only where it was meant, and be the one before after the inverse. Then a
copy of each file is opened, folded, edited, undone and saved, and must have the same bytes. The files are taken in
turns, some gestures each, until each has its number. What fails is printed with file and seed.

Usage: python3 benchmarks random_gestures FOLDER [--count N] [--only TEXT] [--seed N]
"""

from __future__ import annotations

import argparse
import collections
import itertools
import random
import sys
import tempfile
import time
import traceback
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from flexbt_studio.documents.project import Project, document_for
from flexbt_studio.documents.text import inverse
from flexbt_studio.errors import GestureError, StudioError

sys.path.insert(0, str(Path(__file__).parents[2] / 'flexbt_studio' / 'test' / 'documents'))

import test_python_document as python_gestures
import test_yaml_document as yaml_gestures
import xml_gestures

TURN: Final = 25
SEQUENCE: Final = 5
"""Gestures on a file before the next file has its turn, and those of them that follow each other in one text."""
SHOWN: Final = 1500
"""Characters of a failure that are printed, at most."""


def main() -> int:
    """Run, print failures and sums, and return 1 if there was a failure."""
    parser = argparse.ArgumentParser('random_gestures', description=__doc__.split('\n')[0])
    parser.add_argument('folder', type=Path)
    parser.add_argument('--count', type=int, default=1000, help='gestures for each file (default: %(default)s)')
    parser.add_argument('--only', default='', help='only files whose path has this text')
    parser.add_argument('--seed', type=int, default=0, help='seed of the first turn')
    options = parser.parse_args()
    texts = dict(documents(options.folder, options.only))
    print(f'{len(texts)} files', flush=True)
    done: collections.Counter[str] = collections.Counter()
    refused: collections.Counter[str] = collections.Counter()
    failed: collections.Counter[str] = collections.Counter()
    for file in texts:
        _try(failed, file, 0, lambda name=file: round_trip(options.folder, name))
    begin = time.monotonic()
    for turn in range(options.seed, options.seed + -(-options.count // TURN)):
        for file, text in texts.items():
            seed = turn + zlib.crc32(file.encode()) % 10**6  # each file has other gestures
            _try(failed, file, seed, lambda name=file, text=text, seed=seed: gestures(name, text, seed, done, refused))
        minutes = (time.monotonic() - begin) / 60
        print(
            f'turn {turn}: {done.total()} gestures, {refused.total()} refused, {failed.total()} failures in'
            f' {len(failed)} files, {minutes:.1f} min',
            flush=True,
        )
    print('done:', dict(sorted(done.items())))
    print('refused:', dict(sorted(refused.items())))
    return 1 if failed else 0


def documents(folder: Path, only: str) -> Iterator[tuple[str, str]]:
    """Yield the files of a folder that the studio opens without a problem, with their texts as they are."""
    for one in Project(folder).files():
        text = (folder / one['file']).read_bytes().decode('utf-8', 'replace')
        if only in one['file'] and not document_for(one['file'], text).problems:
            yield one['file'], text


def gestures(
    file: str, text: str, seed: int, done: collections.Counter[str], refused: collections.Counter[str]
) -> None:
    """Do one turn of gestures on a text."""
    if file.endswith('.xml'):
        for part in range(TURN // SEQUENCE):  # from the beginning: what has lost its nodes refuses most gestures
            trial = xml_gestures.Trial(text, TURN * seed + part)
            try:
                trial.run(SEQUENCE)
            finally:
                done.update(trial.done)
                refused.update(trial.refused)
    elif file.endswith('.py'):
        for name, after in itertools.islice(python_gestures.trials(text, seed), TURN):
            (refused if after is None else done)[name] += 1
    else:
        chance = random.Random(seed)
        for number in range(TURN):
            made = yaml_gestures.Gestures(text, TURN * seed + number).all()
            name, arguments, expected = chance.choice(list(made))
            try:
                text = yaml_gestures.check(text, name, arguments, expected)
                done[name] += 1
            except GestureError:
                refused[name] += 1


def round_trip(folder: Path, file: str) -> None:
    """Open a copy of a file, look at all of it, move what can be moved, undo, and save: its bytes must be the same."""
    with tempfile.TemporaryDirectory() as place:
        copy = Path(place) / file
        copy.parent.mkdir(parents=True, exist_ok=True)
        before = (folder / file).read_bytes()
        copy.write_bytes(before)
        project = Project(place)
        opened = project.open(file)
        for name, arguments in moves(opened.document.view()):
            text = opened.document.text
            try:
                edits = project.gesture(file, opened.version, name, arguments)
            except GestureError:
                continue
            project.edit(file, opened.version, edits)
            project.edit(file, opened.version, inverse(text, edits))
            break
        try:
            project.save(file, opened.version)
        except StudioError as error:
            raise AssertionError(f'it cannot be saved: {error}') from error
        assert copy.read_bytes() == before, 'its bytes are others'


def moves(view: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield gestures that move a node or state."""
    for node in view.get('nodes', ()):
        if node['parent'] is not None:
            yield 'move', {'node': node['path'], 'parent': node['parent'], 'index': 0}
    for state in view.get('states', ()):
        if state['parent'] is not None:
            yield 'set_initial', {'state': state['path']}


def _try(failed: collections.Counter[str], file: str, seed: int, doing: Any) -> None:
    try:
        doing()
    except Exception as error:
        failed[file] += 1
        if failed[file] > 2:
            return
        last = traceback.extract_tb(error.__traceback__)[-1]
        print(f'FAILED {file} seed {seed} at {Path(last.filename).name}:{last.lineno}: {error!s:.{SHOWN}}', flush=True)


if __name__ == '__main__':
    raise SystemExit(main())

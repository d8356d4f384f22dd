# SPDX-License-Identifier: BSD-3-Clause
"""A cache of proofs of trees: a complete proof is reused until one of its inputs changes.

The key of a proof is a digest of its inputs: the texts of all files, the sources of the engine and of the packages of
every node class, the ports of the nodes, and the arguments of the proof. So nobody needs to clear the cache by hand.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import cache
from hashlib import blake2b
from pathlib import Path
from types import ModuleType
from typing import Final

from flexbt_common.files import home_directory
from flexbt_core.behavior_tree.model.definition import TreeKey, TreeLibrary
from flexbt_core.behavior_tree.model.ports import Port
from flexbt_formal.exploration.leaf_models import leaf_model
from flexbt_formal.exploration.model import Report, System

from .proof_report import report_as_json, report_of

_MOST: Final = 200
"""Maximum number of proofs in the cache; the oldest is deleted first."""
NOTE: Final = 'found before, and nothing on which it depends has changed since; --anew follows it again'


class ProofCache:
    """A cache of proofs in a folder."""

    def __init__(self, folder: Path | None = None) -> None:
        """Use ``folder``, by default the cache of the user below ``XDG_CACHE_HOME`` or ``~/.cache``.

        Without a home directory nothing is kept: among temporary files, others could write proofs.
        """
        cached = os.environ.get('XDG_CACHE_HOME') or Path(home_directory() or os.devnull, '.cache')
        self._folder = folder or Path(cached) / 'flexbt' / 'proofs'

    def get(self, digest: str, make: Callable[[], System]) -> Report | None:
        """Return the proof with this digest, for the system that ``make`` returns; None if it is missing or
        unreadable."""
        try:
            plain = json.loads((self._folder / f'{digest}.json').read_text(encoding='utf-8'))
            return report_of(plain, make)
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def put(self, digest: str, report: Report) -> None:
        """Store a proof. If that fails, the next call explores the tree again."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile('w', dir=self._folder, suffix='.new', delete=False) as file:
                json.dump(report_as_json(report), file)
            Path(file.name).replace(self._folder / f'{digest}.json')
            proofs = sorted(self._folder.iterdir(), key=lambda one: one.stat().st_mtime)
            for old in proofs[:-_MOST]:
                old.unlink()
        except OSError:
            return


def digest_of(library: TreeLibrary, key: TreeKey, asked: Iterable[str]) -> str:
    """Return a digest of everything that the proof of a tree depends on."""
    digest = blake2b(digest_size=16)
    for text in (_engine(), *key, *asked, *_texts(library)):
        data = text.encode('utf-8', 'surrogatepass')
        digest.update(len(data).to_bytes(8, 'big') + data)
    return digest.hexdigest()


def _texts(library: TreeLibrary) -> Iterator[str]:
    classes: set[type] = set()
    for document in library.documents.values():
        yield document.file
        yield repr(sorted(document.scripts.enums.items()))
        for tree in document.trees.values():
            yield tree.source.text
            for node in tree.nodes():
                model = leaf_model(node)
                yield f'{node.manifest.id} {replace(model, resources=frozenset())} {sorted(model.resources)}'
                yield from (_port_text(name, port) for name, port in node.manifest.ports.items())
                classes.add(node.manifest.node_class)
    packages: set[str] = set()
    for kind in sorted(classes, key=lambda one: (one.__module__, one.__qualname__)):
        for base in kind.__mro__:
            yield f'{base.__module__}.{base.__qualname__}'
            packages.add(base.__module__.partition('.')[0])
    for package in sorted(packages):
        yield f'{package} {_sources(sys.modules.get(package))}'


def _port_text(name: str, port: Port) -> str:
    """Return what a proof depends on of a port. A file of models or the branch of Nav2 may change it, not its class."""
    kinds = [None if kind is None else kind.name for kind in (port.type, port.literal)]
    return f'{name} {port.direction.value} {kinds} {port.default!r} {port.required} {port.declares}'


def _engine() -> str:
    """Return a digest of the sources of the engines."""
    return ' '.join(_sources(sys.modules.get(package)) for package in ('flexbt_core', 'flexbt_formal', 'flexbt_tools'))


@cache
def _sources(package: ModuleType | None) -> str:
    """Return a digest of the sources of a package, or of a module that is in none. A built-in one has none."""
    digest = blake2b(digest_size=16)
    files = [file for folder in getattr(package, '__path__', ()) for file in sorted(Path(folder).rglob('*.py'))]
    for file in files or filter(None, [getattr(package, '__file__', None)]):
        digest.update(str(file).encode() + Path(file).read_bytes())
    return digest.hexdigest()

# SPDX-License-Identifier: BSD-3-Clause
"""The paths of the workspace, and stamps: small JSON files that record what was done last, from which inputs."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_NAME = re.compile(r'<name>\s*([^<\s]+)\s*</name>')
_BUILD_TYPE = re.compile(r'<build_type>\s*([^<\s]+)\s*</build_type>')


@dataclass(frozen=True)
class Package:
    """A ROS package of the workspace."""

    name: str
    path: Path
    build_type: str

    @property
    def is_python(self) -> bool:
        return self.build_type == 'ament_python'

    @property
    def modules(self) -> Path:
        """The directory of its Python package."""
        return self.path / self.name

    def test_modules(self) -> list[Path]:
        return sorted((self.path / 'test').rglob('test_*.py'))


@dataclass(frozen=True)
class Layout:
    """The directories of the workspace at `root`. What it makes itself is below `spaces`, by default at the root."""

    root: Path
    spaces: str = ''

    @classmethod
    def of_this_file(cls) -> Layout:
        return cls(Path(__file__).resolve().parents[2])

    @property
    def tools(self) -> Path:
        return self.root / 'tools'

    @property
    def interface_tools(self) -> Path:
        """What interface packages are built with on the wheels."""
        return self.tools / 'interfaces'

    @property
    def venv(self) -> Path:
        return self.root / self.spaces / '.venv'

    @property
    def build(self) -> Path:
        return self.root / self.spaces / 'build'

    @property
    def install(self) -> Path:
        return self.root / self.spaces / 'install'

    @property
    def log(self) -> Path:
        return self.root / self.spaces / 'log'

    @property
    def out(self) -> Path:
        return self.root / self.spaces / 'out'

    @property
    def benchmarks(self) -> Path:
        return self.root / 'benchmarks'

    def packages(self) -> list[Package]:
        """Return the ROS packages, by name: the directories directly below the root that have a package.xml."""
        return _packages_in(self.root)

    def stand_ins(self, prefixes: Iterable[Path]) -> list[Package]:
        """Return those packages in underlay/, interfaces of others, that are installed under none of the prefixes.

        A plain `colcon build` never sees them.
        """
        shares = [prefix / 'share' for prefix in prefixes]
        return [
            package
            for package in _packages_in(self.root / 'underlay')
            if not any((share / package.name / 'package.xml').exists() for share in shares)
        ]


def _packages_in(directory: Path) -> list[Package]:
    found = []
    for manifest in sorted(directory.glob('*/package.xml')):
        text = manifest.read_text(encoding='utf-8')
        name = _NAME.search(text)
        build_type = _BUILD_TYPE.search(text)
        if name and not (manifest.parent / 'COLCON_IGNORE').exists():
            found.append(Package(name[1], manifest.parent, build_type[1] if build_type else 'ament_cmake'))
    return found


# What was done last, in small JSON files in the directories that it made; and hashes of what it was made from.
#
# A directory without a stamp is not to be relied on: the stamp is written last and removed first.

STAMP = 'flexbt-stamp.json'


def read_stamp(file: Path) -> dict[str, Any]:
    """Return the content of `file`; empty when there is none, or it is damaged."""
    try:
        content = json.loads(file.read_text(encoding='utf-8'))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def write_stamp(file: Path, content: dict[str, Any]) -> None:
    """Replace `file` at once, so that an interruption leaves the old or the new one."""
    file.parent.mkdir(parents=True, exist_ok=True)
    fresh = file.with_name(file.name + '.new')
    fresh.write_text(json.dumps(content, indent=1, sort_keys=True) + '\n', encoding='utf-8')
    fresh.replace(file)


def remove(path: Path) -> None:
    """Remove a directory, a file or a link, if there is one; the stamp first, in case of an interruption."""
    if path.is_dir() and not path.is_symlink():
        (path / STAMP).unlink(missing_ok=True)
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def hash_of(files: Iterable[Path], root: Path, *, names_only: Iterable[Path] = ()) -> str:
    """Return a hash of the names (below `root`) and contents of `files`, and of the names alone of `names_only`."""
    digest = hashlib.sha256()
    for file in sorted(files):
        digest.update(f'{file.relative_to(root)}\0'.encode())
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    for file in sorted(names_only):
        digest.update(f'{file.relative_to(root)}\0'.encode())
    return digest.hexdigest()

# SPDX-License-Identifier: BSD-3-Clause
"""Pinned packages in a directory of their own, for programs whose needs do not fit the virtual environment."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path


def environment_with(requirements: Path, directory: Path) -> dict[str, str]:
    """Return the environment in which the pinned packages can be imported; install them first unless they are there."""
    stamp = directory / 'stamp'
    wanted = f'{hashlib.sha256(requirements.read_bytes()).hexdigest()} {sys.version}'
    if not stamp.exists() or stamp.read_text(encoding='utf-8') != wanted:
        print(f'installing {requirements.name} into {directory}', flush=True)
        shutil.rmtree(directory, ignore_errors=True)
        quiet = ['--quiet', '--disable-pip-version-check', '--no-input', '--no-deps']
        places = ['--target', str(directory), '--requirement', str(requirements)]
        subprocess.run([sys.executable, '-m', 'pip', 'install', *quiet, *places], check=True)
        stamp.write_text(wanted, encoding='utf-8')
    search = os.pathsep.join(filter(None, [str(directory), os.environ.get('PYTHONPATH')]))
    return os.environ | {'PYTHONPATH': search}

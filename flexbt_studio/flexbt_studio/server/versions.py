# SPDX-License-Identifier: BSD-3-Clause
"""Earlier versions of files, from git. Nothing of a repository is executed: no hook, filter, monitor, pager or program
of its configuration, and nothing is fetched.
"""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path
from typing import Final

from flexbt_core.values.text import one_line, short_repr
from flexbt_studio.documents.project import MOST_BYTES
from flexbt_studio.errors import StudioError

from .page_text import shown

GIT_SECONDS: Final = 20.0
"""Time for git to answer, s."""
MOST_REVISIONS: Final = 200
_SETTINGS: Final = (
    *('core.fsmonitor=false', 'core.hooksPath=/dev/null', 'core.pager=cat', 'core.quotePath=false'),
    *('diff.external=', 'log.showSignature=false', 'protocol.allow=never', 'safe.bareRepository=explicit'),
)
_ENVIRONMENT: Final = {
    'GIT_ALLOW_PROTOCOL': 'none',
    'GIT_NO_LAZY_FETCH': '1',
    'GIT_OPTIONAL_LOCKS': '0',
    'GIT_TERMINAL_PROMPT': '0',
    'LC_ALL': 'C.UTF-8',
}
_LOG: Final = ('log', '--follow', '-c', '-z', '--no-textconv', '--no-ext-diff', '--no-show-signature', '--name-only')
"""Also merges in which the file is another one than in each branch (``-c``), and names as they are (``-z``)."""
_FORMAT: Final = '--format=%x00%H%x1f%aI%x1f%an%x1f%s'
_REVISION: Final = re.compile(r'[0-9a-f]{40}(?:[0-9a-f]{24})?')


def revisions(file: Path) -> list[dict[str, str]]:
    """Return the revisions of a file, the newest first: ``revision``, ``time``, ``author``, ``subject``, and its
    ``name`` in the repository then.

    Raises:
        StudioError: it is in no git repository, or has no revision there.
    """
    folder = next(one for one in file.parents if one.is_dir())
    out = _git(folder, *_LOG, f'-n{MOST_REVISIONS}', _FORMAT, '--', str(file.relative_to(folder)))
    found: list[dict[str, str]] = []
    for part in filter(None, out.decode('utf-8', 'replace').split('\0')):
        if '\x1f' in part:
            found.append(dict(zip(('revision', 'time', 'author', 'subject'), part.split('\x1f', 3), strict=False)))
        else:
            found[-1].setdefault('name', part.removeprefix('\n'))
    if not found:
        raise StudioError(f'{file.name} has no revision in git yet; compare it with the disk, or commit it')
    return found


def text_at(file: Path, revision: str, name: str) -> str:
    """Return the text of a file at a revision, where it had this name. Raises StudioError."""
    if not _REVISION.fullmatch(revision) or '\0' in name or Path(name).suffix != file.suffix:
        raise StudioError(f'{short_repr(revision)} is no revision; choose one of the list')
    folder = next(one for one in file.parents if one.is_dir())
    if int(_git(folder, 'cat-file', '-s', f'{revision}:{name}')) > MOST_BYTES:
        raise StudioError(f'{name} has more than {MOST_BYTES} bytes at {revision[:10]}')
    content = _git(folder, 'cat-file', 'blob', f'{revision}:{name}')
    try:
        return shown(content.decode('utf-8-sig'))
    except UnicodeDecodeError as error:
        raise StudioError(f'{name} is no text in UTF-8 at {revision[:10]}') from error


def _git(folder: Path, *words: str) -> bytes:
    settings = [word for one in _SETTINGS for word in ('-c', one)]
    command = ['git', '--no-pager', '--no-replace-objects', '--literal-pathspecs', *settings, *words]
    environment = {key: value for key, value in os.environ.items() if not key.startswith('GIT_')} | _ENVIRONMENT
    try:
        done = subprocess.run(  # noqa: S603
            command, stdin=subprocess.DEVNULL, capture_output=True, timeout=GIT_SECONDS, cwd=folder, env=environment
        )
    except FileNotFoundError as error:
        raise StudioError('git is not installed; only the version on disk can be compared') from error
    except subprocess.TimeoutExpired as error:
        raise StudioError(f'git gave no answer within {GIT_SECONDS:g} s') from error
    except OSError as error:
        raise StudioError(f'git cannot be run: {error}') from error
    if done.returncode:
        told = done.stderr.decode('utf-8', 'replace').strip()
        if 'not a git repository' in told:
            raise StudioError(f'{folder.name} is in no git repository; only the version on disk can be compared')
        raise StudioError(f'git: {one_line(told)[:400]}')
    return done.stdout

# SPDX-License-Identifier: BSD-3-Clause
"""The users of the page and of the HTTP interface: names, roles, and hashes of their tokens, in a YAML file.

    ann: {role: operator, token: 'sha256:…'}

A token is made of 192 random bits, never chosen by a person: so a plain hash of it cannot be guessed from.
"""

from __future__ import annotations

import hashlib
import logging
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import yaml

from flexbt_console.commands.spec import Role
from flexbt_console.errors import UsageError
from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_core.values.text_files import read_text, version_of, write_text
from flexbt_core.values.yaml_data import load_yaml

NAME: Final = re.compile(r'[A-Za-z0-9_.@-]{1,64}')
MOST_USERS: Final = 1000
_BYTES: Final = 1_000_000
_PREFIX: Final = 'sha256:'
_LOGGER: Final = logging.getLogger(__name__)


@dataclass(frozen=True)
class User:
    """A person or a program; ``token`` is the hash of its token."""

    name: str
    role: Role
    token: str = ''


class Users:
    """The users of a file. It is read again when it has changed; while it has mistakes, the users before count.

    Raises:
        UsageError: the file has mistakes, or no user.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._version = version_of(file)
        self._users = read_users(file)
        if not self._users:
            raise UsageError(f'{file} has no user; "console users" adds one')

    def with_token(self, token: str) -> User | None:
        """Return the user with a token."""
        return self._newest().get(token_hash(token))  # of a hash, time tells nothing

    def has(self, user: User) -> bool:
        """Return whether a user has the token and the role still."""
        return self._newest().get(user.token) == user

    def _newest(self) -> Mapping[str, User]:
        version = version_of(self._file)
        if version != self._version:
            self._version = version
            try:
                self._users = read_users(self._file)
            except UsageError as error:
                _LOGGER.warning('%s; the users before count', error)
        return self._users


def token_hash(token: str) -> str:
    """Return what stands in the file for a token."""
    return _PREFIX + hashlib.sha256(token.encode(errors='replace')).hexdigest()


def read_users(file: Path) -> dict[str, User]:
    """Return the users by the hashes of their tokens.

    Raises:
        UsageError: the file cannot be read, can be written by others, or is not written as it has to be.
    """
    try:
        if file.stat().st_mode & 0o022:
            raise UsageError(f'{file}: others can change who may do what; chmod go-w {file}')
        known = load_yaml(read_text(file, _BYTES))
    except OSError as error:
        raise UsageError(f'{file}: cannot be read: {error}') from None
    except ValueError as error:
        raise UsageError(f'{file}: {error}') from None
    if not isinstance(known, dict) or len(known) > MOST_USERS:
        raise UsageError(f'{file}: has to have an entry for each user, at most {MOST_USERS}; "console users" adds them')
    users: dict[str, User] = {}
    for name, entry in known.items():
        where = f'{file}: {short_repr(name)}'
        if not isinstance(name, str) or not NAME.fullmatch(name):
            raise UsageError(f'{where}: a name has letters, digits, and . _ @ -, at most 64')
        if not isinstance(entry, dict) or entry.keys() != {'role', 'token'}:
            raise UsageError(f'{where}: has to have role and token')
        token = str(entry['token'])
        if not re.fullmatch(rf'{_PREFIX}[0-9a-f]{{64}}', token) or token in users:
            raise UsageError(f'{where}: token has to be {_PREFIX} and the hash of a token of its own')
        users[token] = User(name, role_of(str(entry['role']), where), token)
    return users


def role_of(text: str, where: str = 'role') -> Role:
    """Return the role with this name. Raises UsageError."""
    names = [role.name.lower() for role in Role]
    if text not in names:
        near = did_you_mean(text, names)
        raise UsageError(f'{where}: there is no role {short_repr(text)}; known: {", ".join(names)}{near}')
    return Role[text.upper()]


def write_users(file: Path, users: Iterable[User]) -> None:
    """Replace the file. Raises UsageError if it cannot be written."""
    entries = {user.name: {'role': user.role.name.lower(), 'token': user.token} for user in users}
    try:
        is_new = not file.exists()
        write_text(file, yaml.safe_dump(entries, sort_keys=True))
        if is_new:
            file.chmod(0o600)
    except OSError as error:
        raise UsageError(f'{file}: cannot be written: {error}') from None

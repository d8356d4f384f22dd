# SPDX-License-Identifier: BSD-3-Clause
"""Makes the generators of rosidl do the same work once instead of many times; what they generate stays the same.

Python imports a module of this name when it starts; this one is on its path while the interfaces are built on the
wheels, and is for the generators only. For each interface package there are six of them, each a program that

- parses every .idl file, with a grammar that takes 0.1 s for a file: here the first keeps what it has parsed beside the
  file, for the others;
- scans the templates of EmPy, and compiles the expressions in them, anew for every interface and again for every
  message in it: here once.
"""

from __future__ import annotations

import functools
import hashlib
import os
import pickle
import sys
from types import CodeType
from typing import Any


def _remember_parsed_files() -> None:
    import rosidl_parser.parser as rosidl

    parse = rosidl.parse_idl_file

    def parse_idl_file(locator: Any, png_file: str | None = None) -> Any:
        path = locator.get_absolute_path()
        digest = hashlib.sha256(path.read_bytes()).digest()
        kept = path.with_name(f'{path.name}.parsed')
        try:
            of, parsed = pickle.loads(kept.read_bytes())  # noqa: S301  # our own file, in the build directory
        except (OSError, EOFError, ValueError, pickle.PickleError):
            of, parsed = b'', None
        if of != digest:
            parsed = parse(locator, png_file)
            fresh = kept.with_name(f'{kept.name}.{os.getpid()}')  # two generators run at the same time
            fresh.write_bytes(pickle.dumps((digest, parsed)))
            fresh.replace(kept)
        return parsed

    rosidl.parse_idl_file = parse_idl_file


def _remember_scanned_templates() -> None:
    import em

    @functools.cache
    def tokens(prefix: str, template: str) -> list[Any]:
        try:
            return list(iter(em.Scanner(prefix, template).one, None))
        except em.TransientParseError:  # the last token wants an end, which EmPy too gives it so
            return list(iter(em.Scanner(prefix, f'{template}{prefix}\n').one, None))

    def parse(interpreter: Any, scanner: Any, locals: dict[str, Any] | None = None) -> None:
        for token in tokens(scanner.prefix, scanner.buffer):
            token.run(interpreter, locals)

    @functools.cache
    def compiled(source: str, mode: str) -> CodeType:
        return compile(source, '<template>', mode, dont_inherit=True)

    em.Interpreter.parse = parse
    em.eval = lambda source, *scopes: eval(compiled(source.lstrip(' \t'), 'eval'), *scopes)  # noqa: S307
    em._exec = lambda source, *scopes: exec(compiled(source, 'exec'), *scopes)  # noqa: S102


if '--generator-arguments-file' in sys.orig_argv:
    _remember_parsed_files()
    _remember_scanned_templates()

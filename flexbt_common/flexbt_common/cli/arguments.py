# SPDX-License-Identifier: BSD-3-Clause
"""A parser of command lines that says what may have been meant by a word that it does not know."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from typing import Any, Final, NoReturn

from flexbt_core.values import hint

_OPTION: Final = re.compile(r'(?<![\w-])--[a-z][\w-]*')
_CHOICE: Final = re.compile(r"invalid choice: '(.*)' \(choose from (.*)\)", re.DOTALL)


class HintingArgumentParser(argparse.ArgumentParser):
    """As that of argparse; those of its sub-commands do the same."""

    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> tuple[Any, list[str]]:  # type: ignore[override]
        """As in the base, but nothing may be left."""
        found, left = super().parse_known_args(args, namespace)
        if left:
            near = hint(left[0].partition('=')[0], _OPTION.findall(self.format_help()), '')
            self.error(f'unrecognized arguments: {" ".join(left)}{near}')
        return found, left

    def error(self, message: str) -> NoReturn:
        """As in the base."""
        if choice := _CHOICE.search(message):
            message += hint(choice[1], re.findall(r"[^\s,']+", choice[2]), '')
        super().error(message)

# SPDX-License-Identifier: BSD-3-Clause
"""Changes of the product that the invariants have to find: ``make nemesis MUTANTS=1``. ``mutations.yaml`` has them.

An invariant that finds none of them may be too weak to find anything.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import CodeType
from typing import Any, Final

import yaml


@dataclass(frozen=True)
class Mutation:
    """A change of the text of a function, ``module:Class.function``: of ``old`` to ``new``.

    With ``old`` '', ``new`` is what the function begins with. ``besides``: other mutations, which are made as well:
    what they remove would do the same job.
    """

    name: str
    where: str
    new: str
    old: str = ''
    besides: tuple[str, ...] = ()

    def apply(self) -> None:
        """Change the function in this process, in all objects that have it, too.

        Raises:
            LookupError: there is no such function, or ``old`` is not in it exactly once.
        """
        for name in self.besides:
            next(one for one in MUTATIONS if one.name == name).apply()
        function = self._function()
        code = function.__code__
        path = Path(code.co_filename)
        lines = path.read_text().splitlines(keepends=True)
        own, begin = inspect.getsourcelines(code)
        lines[begin - 1 : begin - 1 + len(own)] = self._changed(own)
        function.__code__ = next(
            one
            for one in _codes(compile(''.join(lines), str(path), 'exec', dont_inherit=True))
            if one.co_qualname == code.co_qualname and one.co_firstlineno == code.co_firstlineno
        )

    def _function(self) -> Any:
        module, _, path = self.where.partition(':')
        found: Any = importlib.import_module(module)
        for name in path.split('.'):
            if name not in vars(found):
                raise LookupError(f'{self.name}: {module} has no {path}; change mutations.yaml')
            found = vars(found)[name]
        return getattr(found, 'fget', None) or inspect.unwrap(getattr(found, '__func__', found))

    def _changed(self, own: list[str]) -> list[str]:
        text = ''.join(own)
        if self.old:
            if text.count(self.old) != 1:
                raise LookupError(f'{self.name}: {self.where} has {self.old!r} {text.count(self.old)} times, not once')
            return [text.replace(self.old, self.new)]
        definition: Any = ast.parse(textwrap.dedent(text)).body[0]
        first = definition.body[0].lineno - 1
        indent = own[first][: len(own[first]) - len(own[first].lstrip())]
        if ast.get_docstring(definition) is not None:  # it may span lines
            first = definition.body[0].end_lineno
        return [*own[:first], textwrap.indent(f'{self.new}\n', indent), *own[first:]]


def _codes(code: CodeType) -> Iterator[CodeType]:
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield inner
            yield from _codes(inner)


MUTATIONS: Final = tuple(
    Mutation(**{**one, 'besides': tuple(one.get('besides', ()))})
    for one in yaml.safe_load(Path(__file__).with_name('mutations.yaml').read_text())
)

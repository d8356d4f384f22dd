# SPDX-License-Identifier: BSD-3-Clause
"""Random trees as in ``nodes`` that also have scripts: as nodes, and as pre- and post-conditions.

The scripts mean the same in 4.8.2, the version of the wheel, as in 4.10, whose grammar the engine has: every operator
has its parentheses, and ``true`` stands only where it does not matter whether it is an integer or a double. Some of
them fail when they run. Left out is what the engine does differently on purpose: numbers that grow out of the type of
their entry.
"""

from __future__ import annotations

from typing import Any

from .basic import BOOLEANS, INTEGERS, REALS, TEXTS
from .nodes import _NodesGenerator

NEW = ('u', 'v', 'w')
"""Entries that only scripts make."""


class _ScriptsGenerator(_NodesGenerator):
    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self._scripts = self._random.choice((0.1, 0.3, 0.5))
        self._conditional = self._random.choice((0.0, 0.1, 0.25, 0.5))

    # -- expressions -----------------------------------------------------------------------------------------------

    def _number(self, depth: int = 0) -> str:
        pick = self._random.choice
        chance = self._random.random()
        if depth > 2 or chance < 0.3:
            return pick((*INTEGERS, *INTEGERS, *REALS, *BOOLEANS))
        if chance < 0.5:
            return pick(('0', '1', '2', '5', '0.5', '2.25', '0x1F', '1e2'))
        if chance < 0.58:
            return f'({pick("-!")}({self._number(depth + 1)}))'
        if chance < 0.66:
            return f'({self._truth(depth + 1)} ? {self._number(depth + 1)} : {self._number(depth + 1)})'
        if chance < 0.7:
            return f'({pick(("", "~"))}({pick(INTEGERS)}) {pick("&|^")} {pick((*INTEGERS, "6", "d"))})'
        if chance < 0.71:
            return self._new()
        return f'({self._number(depth + 1)} {pick("++-**/")} {self._number(depth + 1)})'

    def _new(self) -> str:
        """An entry that scripts have to make first. It may be missing, which is an error."""
        return self._random.choice(NEW) if self._random.random() < 0.2 else 'd'

    def _text(self, depth: int = 0) -> str:
        pick = self._random.choice
        chance = self._random.random()
        if depth > 2 or chance < 0.5:
            return pick((*TEXTS, "'x'", "'foo'", "''", "'7'"))
        if chance < 0.6:
            return f'({self._truth(depth + 1)} ? {self._text(depth + 1)} : {self._text(depth + 1)})'
        # Not a number with something behind it, which a Switch of 4.8.2 takes for that number.
        return f"(('x' .. {self._text(depth + 1)}) .. {pick((self._text(depth + 1), *INTEGERS, '2', '0.5'))})"

    def _truth(self, depth: int = 0) -> str:
        pick = self._random.choice
        chance = self._random.random()
        relation = pick(('==', '!=', '<', '>', '<=', '>='))
        if depth > 2 or chance < 0.35:
            return f'({self._number(2)} {relation} {self._number(2)})'
        if chance < 0.5:
            return f'({pick(TEXTS)} {relation} {self._text(2)})'
        if chance < 0.53:
            text = pick(('2', '2.5', '-1e1', 'true'))
            return f"({pick(INTEGERS)} {relation} '{text}')"
        if chance < 0.63:
            return pick(('true', 'false', *('k', '1', '0', '0.5') * 4, 'a'))
        if chance < 0.7:
            return f'({self._number(3)} {relation} {self._number(3)} {pick("<>")} {self._number(3)})'
        if chance < 0.78:
            return f'(!{self._truth(depth + 1)})' if depth < 2 else f'(!({self._number(2)}))'
        return f'({self._truth(depth + 1)} {pick(("&&", "||"))} {self._truth(depth + 1)})'

    def _statement(self) -> str:
        pick = self._random.choice
        write = pick((':=', '='))
        match pick('nnnnnnrrrttbbuuu') if self._random.random() < 0.97 else 'x':
            case 'n':
                key = pick(INTEGERS)
                return pick(
                    (
                        f'{key} {write} {self._random.randint(0, 5)}',
                        f'{key} {pick(("+=", "-="))} {pick((1, 2))}',
                        f'{key} *= {pick(("0", "1", "(-1)"))}',
                        f'{key} {write} ({pick(INTEGERS)} - {pick((1, 2))})',
                        f'{key} {write} (!({self._truth(2)}))' if not self._gaps else f'{key} -= 1',
                    )
                )
            case 'r':
                return f'{pick(REALS)} {pick((write, write, "+=", "-=", "*=", "/="))} {self._number(1)}'
            case 't':
                return f'{pick(TEXTS)} {pick((write, write, "+="))} {self._text(1)}'
            case 'b':
                return f'{pick(BOOLEANS)} {write} {pick((f"(!({self._truth(2)}))", "(!k)", "1"))}'
            case 'u':
                return f'{pick(NEW)} := {pick((self._number(1), self._random.randint(0, 9)))}'
            case _:
                # What may fail.
                wrong = 's = 1', 'd = s', 'a += s', 'u *= t', 'w = 1'
                return pick((f'{pick(INTEGERS)} = ({pick(INTEGERS)} / 2)', *wrong))

    def _script(self) -> str:
        return '; '.join(self._statement() for _ in range(self._random.choice((1, 1, 2, 3))))

    # -- where they are --------------------------------------------------------------------------------------------

    def _conditions(self) -> list[tuple[str, str]]:
        if self._random.random() >= self._conditional:
            return []
        found = [
            (attribute, self._truth(1))
            for attribute in ('_failureIf', '_successIf', '_skipIf', '_while')
            if self._random.random() < 0.3
        ]
        return found + [
            (attribute, self._statement())
            for attribute in ('_onSuccess', '_onFailure', '_onHalted', '_post')
            if self._random.random() < 0.3
        ]

    def _leaf(self) -> str:
        if self._random.random() >= self._scripts:
            return super()._leaf()
        if self._random.random() < 0.6:
            return self._element('Script', 'Action', [('code', self._script())])
        return self._element('ScriptCondition', 'Condition', [('code', self._truth())])

    def _decorator(self, depth: int) -> str:
        if self._random.random() >= self._scripts * 0.5:
            return super()._decorator(depth)
        attributes = [('if', self._truth())]
        if self._random.random() < 0.6:
            attributes.append(('else', self._random.choice(('FAILURE', 'SUCCESS', 'SKIPPED', 'RUNNING'))))
        return self._element('Precondition', 'Decorator', attributes, self._children(1, depth))


def make_case(seed: int) -> dict[str, Any]:
    """The case of this number."""
    return _ScriptsGenerator(seed).case()

# SPDX-License-Identifier: BSD-3-Clause
"""The operators of scripts on values, by the rules of BehaviorTree.CPP 4.10.

A value is the content of a blackboard entry: a number (int, float, bool), a text, another object, or EMPTY when the
entry was declared but never written. All arithmetic is that of doubles, and its results are floats. Every function
raises ConversionError for operations that the language does not allow.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from typing import Any, Final

from flexbt_core.behavior_tree.model.blackboard import EMPTY, Blackboard, Entry
from flexbt_core.behavior_tree.model.errors import ConversionError
from flexbt_core.behavior_tree.model.ports import BOOL, DOUBLE, INT64, STRING, UINT64, cast, fits
from flexbt_core.values.text import short_repr

MAX_TEXT: Final = 100_000
"""Maximum number of characters of a text that an operator makes. A loop could double a text until memory runs out."""

MAX_TEXTS: Final = 10_000_000
"""Characters of all texts on a blackboard, for an assignment of a text that is larger than SMALL_TEXT."""

SMALL_TEXT: Final = 10_000
"""Texts of more characters are checked against MAX_TEXTS."""

Value = Any
Operation = Callable[[Value, Value], Value]

_NUMBERS: Final = (float, int)
_SMALL: Final = 2**30
SAME_NUMBER: Final = 2.0**-23
"""Numbers that differ by no more are equal: the resolution of a C++ float."""


def kind_of(value: Value) -> str:
    """Return a description of the value, for errors."""
    if value is EMPTY:
        return 'an entry that was never written'
    if isinstance(value, str):
        return f'the text {short_repr(value)}'
    if isinstance(value, int | float):
        return f'the number {value}'
    return f'a value of type {type(value).__name__}'


def _refused(reason: str, value: Value) -> ConversionError:
    return ConversionError(reason, is_absent=value is EMPTY)


def is_number(value: Value) -> bool:
    return isinstance(value, _NUMBERS)


def real(value: Value) -> float:
    """Return a number as double. Raises ConversionError for an integer that no double represents exactly."""
    if value.__class__ is float:
        return value
    if value.__class__ is int and -_SMALL <= value <= _SMALL:
        return float(value)
    if not is_number(value):
        raise _refused(f'{kind_of(value)} is not a number', value)
    number: float = cast(value, DOUBLE)
    return number


def integer(value: Value) -> int:
    """Return a number that is a 64-bit integer. Raises ConversionError for any other."""
    if value.__class__ is int and -_SMALL <= value <= _SMALL:
        return int(value)
    number: int = cast(value, INT64)
    return number


def truth(value: Value) -> bool:
    """Return a number as condition: 0 and 1 of the integers, and every double that is not negative."""
    if value.__class__ is float and value >= 0.0:
        return bool(value)
    if not is_number(value):
        raise _refused(f'{kind_of(value)} is neither true nor false; compare it with something', value)
    result: bool = cast(value, BOOL)
    return result


def number_of_text(text: str, enums: Mapping[str, int]) -> float:
    """Return ``true``, ``false``, the value of an enum constant, or the number that the text begins with."""
    if text == 'true':
        return 1.0
    if text == 'false':
        return 0.0
    constant = enums.get(text)
    return float(constant) if constant is not None else DOUBLE.parse(text)


# -- operators on one value --------------------------------------------------------------------------------------------


def _one_number(value: Value, symbol: str) -> float:
    if not is_number(value):
        raise _refused(f'operator [{symbol}] needs a number, not {kind_of(value)}', value)
    return real(value)


def negate(value: Value) -> float:
    return -_one_number(value, '-')


def complement(value: Value) -> float:
    number = _one_number(value, '~')
    if not -(2.0**63) <= number < 2.0**63:
        raise ConversionError(f'operator [~] needs a number that fits into 64 bits, not {number}')
    return float(~int(number))


def invert(value: Value) -> float:
    return 0.0 if _one_number(value, '!') else 1.0


UNARY: Final[Mapping[str, Callable[[Value], Value]]] = {'-': negate, '~': complement, '!': invert}


# -- operators on two values -------------------------------------------------------------------------------------------


def _mismatch(left: Value, right: Value, symbol: str) -> ConversionError:
    for side, value in (('left', left), ('right', right)):
        if value is EMPTY:
            return _refused(f'the {side} operand of [{symbol}] is {kind_of(value)}', value)
    hint = '; join texts with numbers by ..' if symbol == '+' else ''
    return ConversionError(f'operator [{symbol}] does not apply to {kind_of(left)} and {kind_of(right)}{hint}')


def divide(left: float, right: float) -> float:
    """Return the quotient of IEEE 754: infinite, or not a number, when the divisor is zero."""
    if right:
        return left / right
    if not left or math.isnan(left):
        return math.nan
    return math.copysign(math.inf, left) * math.copysign(1.0, right)


ARITHMETIC: Final[Mapping[str, Callable[[float, float], float]]] = {
    '+': operator.add,
    '-': operator.sub,
    '*': operator.mul,
    '/': divide,
}


def _arithmetic(symbol: str) -> Operation:
    compute = ARITHMETIC[symbol]

    def operate(left: Value, right: Value) -> Value:
        if is_number(left) and is_number(right):
            return compute(real(left), real(right))
        if symbol == '+' and isinstance(left, str) and isinstance(right, str):
            return _joined(symbol, left, right)
        raise _mismatch(left, right, symbol)

    return operate


def _of_numbers(symbol: str, compute: Operation, convert: Callable[[Value], Value], wanted: str) -> Operation:
    """Return an operation on two numbers, for which ``convert`` makes integers or truth values of them."""

    def operate(left: Value, right: Value) -> float:
        if not (is_number(left) and is_number(right)):
            raise _mismatch(left, right, symbol)
        real(left), real(right)
        try:
            return float(compute(convert(left), convert(right)))
        except ConversionError as error:
            raise ConversionError(f'operator [{symbol}] needs {wanted}: {error}') from None

    return operate


def join(left: Value, right: Value) -> Value:
    """Return two texts, or a text and a number, joined. Two numbers give EMPTY, as in BehaviorTree.CPP."""
    if is_number(left) and is_number(right):
        real(left), real(right)
        return EMPTY
    if not all(is_number(value) or isinstance(value, str) for value in (left, right)):
        raise _mismatch(left, right, '..')
    return _joined('..', text_of(left), text_of(right))


def _joined(symbol: str, left: str, right: str) -> str:
    length = len(left) + len(right)
    if length > MAX_TEXT:
        raise ConversionError(
            f'operator [{symbol}] would make a text of {length} characters; at most {MAX_TEXT} are made'
        )
    return left + right


def text_of(value: Value) -> str:
    """Return a number or text as text: reals with six decimals."""
    text: str = cast(value, STRING)
    return text


BINARY: Final[Mapping[str, Operation]] = {
    **{symbol: _arithmetic(symbol) for symbol in ARITHMETIC},
    '..': join,
    '&': _of_numbers('&', operator.and_, integer, 'integers'),
    '|': _of_numbers('|', operator.or_, integer, 'integers'),
    '^': _of_numbers('^', operator.xor, integer, 'integers'),
    '&&': _of_numbers('&&', operator.and_, truth, 'truth values'),
    '||': _of_numbers('||', operator.or_, truth, 'truth values'),
}


# Each comparison negates its opposite, so that NaN gives the same result as in BehaviorTree.CPP.
_COMPARE: Final[Mapping[str, Callable[[Any, Any], bool]]] = {
    '<': lambda left, right: not left >= right,
    '>': lambda left, right: not left <= right,
    '<=': lambda left, right: not left > right,
    '>=': lambda left, right: not left < right,
}


def compare(symbol: str, left: Value, right: Value, enums: Mapping[str, int]) -> bool:
    """Return whether ``left symbol right`` holds. A text compared with a number is converted to a number."""
    left_text, right_text = isinstance(left, str), isinstance(right, str)
    if not (left_text or is_number(left)) or not (right_text or is_number(right)):
        raise _mismatch(left, right, symbol)
    if left_text and right_text:
        if symbol in ('==', '!='):
            return (left == right) is (symbol == '==')
        return _COMPARE[symbol](left, right)
    left = number_of_text(left, enums) if left_text else real(left)
    right = number_of_text(right, enums) if right_text else real(right)
    if symbol in ('==', '!='):
        return (abs(left - right) <= SAME_NUMBER) is (symbol == '==')
    return _COMPARE[symbol](left, right)


def choose(value: Value) -> bool:
    """Return whether the condition of ``a ? b : c`` holds: any number but 0. A text is converted to a number."""
    if isinstance(value, str):
        return DOUBLE.parse(value) != 0.0
    return real(value) != 0.0


def check_room(board: Blackboard, text: str) -> None:
    """Check that a large text to be assigned keeps all texts of the blackboard within MAX_TEXTS.

    Raises ConversionError if it does not.
    """
    values = [*board.snapshot().values(), *(board.root.snapshot().values() if board.root is not board else ()), text]
    length = sum(map(len, {id(value): value for value in values if isinstance(value, str)}.values()))
    if length > MAX_TEXTS:
        raise ConversionError(
            f'the texts of the blackboard would have {length} characters; a script makes no more than {MAX_TEXTS}'
        )


# -- assignment --------------------------------------------------------------------------------------------------------


def assigned(entry: Entry, symbol: str, value: Value, enums: Mapping[str, int]) -> Value:
    """Return the new value of ``entry`` after ``entry symbol value``, in the form that fits the entry."""
    if value is EMPTY:
        raise _refused(f'the right operand of [{symbol}] is {kind_of(value)}', value)
    if symbol in (':=', '='):
        return _fitted(entry, value, enums)
    if entry.value is EMPTY:
        raise _refused(f'the left operand of [{symbol}] is {kind_of(entry.value)}', entry.value)
    return _copied(entry, BINARY[symbol[0]](entry.value, value))


def _fitted(entry: Entry, value: Value, enums: Mapping[str, int]) -> Value:
    current, kind = entry.value, entry.type
    if current is EMPTY and kind is None:
        return value
    if isinstance(value, str) and not isinstance(current, str):
        if kind is not None and kind.from_text is not None:
            return kind.parse(value)
        if is_number(current):
            return number_of_text(value, enums)
        name = kind.name if kind is not None else type(current).__name__
        raise ConversionError(f'{kind_of(value)} cannot be converted to {name}, the type of the entry')
    return _copied(entry, value)


class OutOfBounds(int):
    """An integer that a script assigned to an entry whose type is too narrow for it.

    Readers detect it by its class, including those that skip the conversion of an ``int``.
    """


def _copied(entry: Entry, value: Value) -> Value:
    """Return ``value`` as the kind of number that the entry holds."""
    current, kind = entry.value, entry.type
    if current.__class__ is value.__class__ is float:
        return value
    if is_number(value):
        if current.__class__ is float:
            return real(value)
        if is_number(current) or (current is EMPTY and isinstance(value, int)):
            is_wide = kind is UINT64 or (kind is None and isinstance(value, int) and value > 0)
            number: int = cast(value, UINT64 if is_wide else INT64)
            if kind is not None and kind.category == 'integer' and not fits(number, kind):
                return OutOfBounds(number)
            return bool(number) if current.__class__ is bool and number in (0, 1) else number
    both_text = isinstance(current, str) and isinstance(value, str)
    if current is EMPTY or both_text or type(current) is type(value):
        return value
    raise ConversionError(f'{kind_of(value)} cannot be assigned to an entry that holds {kind_of(current)}')

# SPDX-License-Identifier: BSD-3-Clause
"""In-process calls of ``bt_tool`` and other commands, and documents for them: stock, broken and hostile trees."""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from flexbt_tools.cli.behavior_tool import main as behavior_main
from flexbt_tools.cli.bt_tool import main

_SHARED_DATA = Path(os.environ.get('FLEXBT_SHARED_DATA', Path(__file__).resolve().parents[4] / 'shared/data'))
STOCK_TREES = sorted((_SHARED_DATA / 'nav2/jazzy_trees').glob('*.xml'))
"""Trees of Nav2, if they are available."""


class Done(NamedTuple):
    """The result of a command."""

    code: int
    out: str
    err: str


def called(main: Callable[[Sequence[str]], int], words: Sequence[str]) -> Done:
    """Run the main function of a command, and capture the standard streams."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = main(words)
        except SystemExit as exit:  # raised by argparse
            assert isinstance(exit.code, int)
            code = exit.code
    return Done(code, out.getvalue(), err.getvalue())


def tool(*words: str) -> Done:
    """Run ``bt_tool``."""
    return called(main, words)


def document(*trees: str, main: str | None = 'Main') -> str:
    """Return a file with one tree on each line. Each begins with its ID: ``Main: <AlwaysSuccess/>``."""
    head = '<root BTCPP_format="4"' + (f' main_tree_to_execute="{main}">' if main else '>')
    parts = [tree.partition(':') for tree in trees]
    bodies = [f'<BehaviorTree ID="{id}">{body.strip()}</BehaviorTree>' for id, _, body in parts]
    return '\n'.join([head, *bodies, '</root>'])


def without_marks(text: str) -> tuple[str, list[str]]:
    """Return a text without its ``^`` marks, and the marked places as ``line:column``."""
    places = []
    while (position := text.find('^')) >= 0:
        line = text.count('\n', 0, position) + 1
        places.append(f'{line}:{position - text.rfind(chr(10), 0, position)}')
        text = text[:position] + text[position + 1 :]
    return text, places


def behavior_tool(*words: str) -> Done:
    """Run ``behavior_tool``."""
    return called(behavior_main, words)


# Broken or malicious documents: the content, and words that the first error must contain.

TREE = document(
    'Main: <Sequence name="é"><AlwaysSuccess/><SubTree ID="Sub" a="{b}"/></Sequence>', 'Sub: <AlwaysSuccess/>'
)


def _entities(declarations: str, use: str = '&a;', system: str = '') -> bytes:
    head = f'<?xml version="1.0" encoding="utf-8"?>\n<!DOCTYPE root {system}[{declarations}]>\n'
    return (head + TREE.replace('name="é"', f'name="{use}"')).encode()


def _body(xml: str) -> bytes:
    return document(f'Main: {xml}').encode()


_LAUGHS = '<!ENTITY a0 "ha">' + ''.join(f'<!ENTITY a{n} "{f"&a{n - 1};" * 10}">' for n in range(1, 30))
_TEXT = TREE.encode()

CORPUS: dict[str, tuple[bytes, str]] = {
    'entities that expand': (_entities(_LAUGHS, '&a29;'), 'DOCTYPE'),
    'a long entity used often': (_entities(f'<!ENTITY a "{"x" * 50_000}">', '&a;' * 5000), 'DOCTYPE'),
    'entities in a circle': (_entities('<!ENTITY a "&b;"><!ENTITY b "&a;">'), 'DOCTYPE'),
    'an external entity': (_entities('<!ENTITY a SYSTEM "file:///etc/passwd">'), 'DOCTYPE'),
    'an external entity of the network': (_entities('<!ENTITY a SYSTEM "http://127.0.0.1:9/x">'), 'DOCTYPE'),
    'a parameter entity': (_entities('<!ENTITY % a SYSTEM "file:///etc/passwd"> %a;', ''), 'DOCTYPE'),
    'an external DTD': (_entities('', '', 'SYSTEM "file:///etc/passwd" '), 'DOCTYPE'),
    'a DOCTYPE within': (TREE.replace('<Sequence', '<!DOCTYPE x><Sequence').encode(), 'DOCTYPE'),
    'a DOCTYPE in other letters': (b'<!doctype root>' + _TEXT, 'DOCTYPE'),
    'UTF-16 with BOM': (TREE.encode('utf-16'), 'UTF-8'),
    'UTF-16 without BOM': (TREE.encode('utf-16-be'), 'not'),
    'UTF-32': (TREE.encode('utf-32'), 'UTF-8'),
    'Latin-1': (TREE.encode('latin-1'), '0xe9 is not UTF-8'),
    'an overlong encoding': (_TEXT.replace(b'"{b}"', b'"\xc0\xaf"'), '0xc0 is not UTF-8'),
    'a surrogate in UTF-8': (_TEXT.replace(b'"{b}"', b'"\xed\xa0\x80"'), 'is not UTF-8'),
    'two BOMs': (b'\xef\xbb\xbf' * 3 + _TEXT, 'outside of the root'),
    'NUL': (_TEXT.replace(b'Sub"', b'Sub\0"'), 'U+0000'),
    'NUL at the end': (_TEXT + b'\0', 'U+0000'),
    'a control character': (_TEXT.replace(b'Sub"', b'Sub\x1b"'), 'U+001B'),
    'no character at all': (_TEXT.replace(b'{b}', '\uffff'.encode()), 'U+FFFF'),
    'only zeros': (bytes(1_000_000), 'U+0000'),
    'nothing': (b'', 'no element'),
    'only spaces': (b' \n\t ' * 1000, 'no element'),
    'only a BOM': (b'\xef\xbb\xbf', 'no element'),
    'not XML': (b'{"trees": []}', 'outside of the root'),
    'a picture': (b'\x89PNG\r\n\x1a\n' + bytes(range(256)), 'is not UTF-8'),
    'an attribute twice': (_body('<AlwaysSuccess name="a" name="b"/>'), 'given twice'),
    'an attribute twice in the root': (b'<root BTCPP_format="4" BTCPP_format="3"/>', 'given twice'),
    '20,000 attributes': (_body('<AlwaysSuccess ' + ' '.join(f'a{n}="x"' for n in range(20_000)) + '/>'), 'a0'),
    'a value of 1 MB': (_body(f'<Delay delay_msec="{"1" * 1_000_000}"><AlwaysSuccess/></Delay>'), "can't convert"),
    'a name of 1 MB': (_body(f'<{"N" * 1_000_000}/>'), 'not registered'),
    'depth 257': (_body('<Inverter>' * 256 + '<AlwaysSuccess/>' + '</Inverter>' * 256), '256 deep'),
    'depth 90,000': (_body('<Inverter>' * 90_000), '256 deep'),
    'elements that never end': (b'<root>' + b'<a ' * 300_000, 'unexpected'),
    'crossed elements': (_body('<Sequence><Inverter></Sequence></Inverter>'), 'does not close <Inverter>'),
    'a tree within itself': (_body('<SubTree ID="Main"/>'), 'recursion'),
    'a tree within a tree within itself': (
        document('Main: <SubTree ID="B"/>', 'B: <Inverter><SubTree ID="Main"/></Inverter>').encode(), 'recursion',
    ),
    'a million nodes in 40 trees': (
        document(
            'Main: <SubTree ID="T0"/>',
            *(f'T{n}: <Sequence><SubTree ID="T{n + 1}"/><SubTree ID="T{n + 1}"/></Sequence>' for n in range(40)),
            'T40: <AlwaysSuccess/>',
        ).encode(),
        'the limit is 65535',
    ),
    '66,000 nodes': (_body('<Sequence>' + '<AlwaysSuccess/>' * 66_000 + '</Sequence>'), 'the limit'),
    'a path for an ID': (TREE.replace('ID="Sub"', 'ID="../Sub"').encode(), "'.'"),
    'a file for a node': (_body('<Action ID="../../etc/passwd"/>'), 'not registered'),
    'a module for a node': (_body('<os.system name="rm"/>'), 'not registered'),
    'an unknown node': (_body('<Nope/>'), 'not registered'),
    'a missing port': (_body('<Repeat><AlwaysSuccess/></Repeat>'), 'num_cycles'),
    'a script of parentheses': (_body(f'<Script code="a := {"(" * 50_000}1{")" * 50_000}"/>'), ''),
    'a script that is not closed': (_body(f'<Script code="a := {"(" * 50_000}"/>'), ''),
    'a script of signs': (_body(f'<Script code="a := {"-" * 50_001}x"/>'), ''),
    'a script of questions': (_body(f'<Script code="a := {"1 ? " * 25_000}1{" : 1" * 25_000}"/>'), ''),
    'a number too large': (_body('<Repeat num_cycles="99999999999999999999"><AlwaysSuccess/></Repeat>'), 'num_cycles'),
    'a comment that never ends': (_TEXT + b'<!-- ' * 100_000, 'never closed'),
    'CDATA that never ends': (_TEXT.replace(b'</root>', b'<![CDATA[' + b']' * 500_000), 'never closed'),
    'something after the end': (_TEXT + b'<!-- fine --> and more', 'outside of the root'),
}  # fmt: skip
"""Hostile documents, each with words of its error.

A document without words ('') may also be accepted, within the same limits of time and memory.
"""

ACCEPTED: dict[str, bytes] = {
    'a BOM': b'\xef\xbb\xbf' + _TEXT,
    'CR LF': TREE.replace('\n', '\r\n').encode(),
    'another encoding declared': b'<?xml version="1.0" encoding="ISO-8859-1"?>' + _TEXT,
    'entities that nobody declared': _TEXT.replace(b'{b}', b'&nothing; &#99999999; &#xD800; &'),
    'a long comment': _TEXT + b'<!--' + b'-' * 800_000 + b'-->',
    'a script of many statements': _body('<Script code="' + 'a := 1; ' * 2_000 + '"/>'),
}

BROKEN_IN_MANY_PLACES = document(
    'Main: <Sequence>',
    *(f'T{n}: <Nope{n}/><Delay delay_msec="x{n}"><AlwaysSuccess bad="1"/></Delay>' for n in range(50)),
    main=None,
).replace('<Sequence></BehaviorTree>', '<Sequence/></BehaviorTree>')
"""An error in the second line; then four in each of 50 lines: two children, an unknown node, port and value."""

# SPDX-License-Identifier: BSD-3-Clause
"""Random trees of all nodes and scripted leaves, by number, for the comparison with BehaviorTree.CPP.

One generator makes a fixed corpus, another makes trees with more scripts. The same seed always gives the same tree.

The trees avoid cases in which the library is not deterministic or its versions differ: timers that fire, text that
looks like a number on the ports of a sub-tree or for a Switch, and a child of SkipUnlessUpdated or WaitValueUpdate that
is not done in one tick. They also avoid the deliberate differences of this engine.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import Any

from flexbt_core.values.text import xml_attribute

Attributes = list[tuple[str, str]]

INTEGERS, REALS, TEXTS, BOOLEANS = ('a', 'b', 'c'), ('d', 'e'), ('s', 't'), ('k',)
GROUPS = (INTEGERS, REALS, TEXTS, BOOLEANS)
KEYS = tuple(key for group in GROUPS for key in group)


CONTROLS = (
    *('Sequence',) * 4,
    *('Fallback',) * 4,
    *('ReactiveSequence',) * 3,
    *('ReactiveFallback',) * 3,
    *('SequenceWithMemory',) * 3,
    *('Parallel',) * 3,
    *('ParallelAll',) * 2,
    *('IfThenElse',) * 2,
    *('WhileDoElse',) * 2,
    *('Switch',) * 2,
    *('AsyncSequence',) * 2,
    *('AsyncFallback',) * 2,
)
DECORATORS = (
    *('Inverter',) * 3,
    *('ForceSuccess',) * 2,
    *('ForceFailure',) * 2,
    *('Repeat',) * 3,
    *('RetryUntilSuccessful',) * 3,
    *('RunOnce',) * 2,
    *('Precondition',) * 3,
    *('Deco',) * 3,
    *('Loop',) * 2,
    'SkipUnlessUpdated',
    'WaitValueUpdate',
)
TIMED = (*('Timeout',) * 4, *('Delay',) * 2)
LOOPS = (
    ('LoopInt', '1;2;3', '{c}'),
    ('LoopInt', '5', '{c}'),
    ('LoopDouble', '0.5;2', '{e}'),
    ('LoopString', 'x;foo', '{t}'),
    ('LoopBool', 'true;false;1', '{k}'),
    ('LoopInt', '', '{c}'),
)


class _Generator:
    """The corpus: the nodes and scripts on which the versions 4.8.2 and 4.10 of the library agree.

    Both versions ran it without a difference. Therefore the order of its random choices is fixed: do not add or remove
    any.
    """

    if_empty: tuple[str, ...] = ('SUCCESS', 'FAILURE', 'SKIPPED')
    then_skip: tuple[str, ...] = ('true', 'false')
    """Values of the ports of loops and of RunOnce."""

    def __init__(self, seed: int) -> None:
        # A separate generator for each seed makes cases independent of the order in which they are made.
        self._random = random.Random(f'btcpp-wheel-{seed}')
        pick, chance = self._random.choice, self._random.random
        self._count = 0
        self._budget = self._random.randint(4, 32)
        self._drain = chance() < 0.2
        self._conditional = pick((0.0, 0.08, 0.2, 0.35))
        self._scripts = pick((0.0, 0.1, 0.3))
        self._skipping = pick((0.0, 0.0, 0.1, 0.3))
        self._running = pick((0.1, 0.3, 0.5))
        self._timers = chance() < 0.15
        self._trees: list[tuple[str, str]] = []
        self._ids: list[str] = []
        self._building = False
        self._in_reactive_sequence = False

    def case(self) -> dict[str, Any]:
        pick, chance = self._random.choice, self._random.random
        body = self._node(0)
        trees = [('Main', body), *self._trees]
        if chance() < 0.5:
            trees.reverse()
        xml = ''.join(f'<BehaviorTree ID="{id}">{body}</BehaviorTree>' for id, body in trees)
        ops: list[list[Any]] = []
        for _ in range(self._random.randint(3, 9)):
            what = chance()
            if what < 0.1 and ops:
                ops.append(['halt'])
            elif what < 0.25:
                ops.append(['set', *self._assignment(pick(KEYS))])
            ops.append(['once' if self._drain else 'tick'])
        board: dict[str, Any] = {key: self._random.randint(0, 3) for key in INTEGERS}
        board |= {'d': pick((0.5, 1.0, 2.25)), 'e': 0.0, 's': pick(('x', 'foo', 'y')), 't': 'y', 'k': chance() < 0.5}
        document = f'<root BTCPP_format="4" main_tree_to_execute="Main">{xml}</root>'
        return {'xml': document, 'bb': board, 'ops': ops}

    def _assignment(self, key: str) -> tuple[str, str, Any]:
        pick = self._random.choice
        if key in INTEGERS:
            return key, 'i', self._random.randint(0, 5)
        if key in REALS:
            return key, 'd', pick((0.5, 1.0, 3.75))
        if key in TEXTS:
            return key, 's', pick(('x', 'foo', 'y'))
        return key, 'b', self._random.random() < 0.5

    # -- scripts ---------------------------------------------------------------------------------------------------

    def _number(self, depth: int = 0) -> str:
        pick, chance = self._random.choice, self._random.random
        what = chance()
        if depth > 2 or what < 0.45:
            return str(self._random.randint(0, 6)) if chance() < 0.6 else pick(INTEGERS + REALS)
        if what < 0.55:
            return f'{self._random.randint(0, 4)}.{pick((0, 25, 5, 75))}'
        if what < 0.62:
            return f'(-{pick(("1", "2", "a", "d"))})'
        if what < 0.68:
            return f'({self._truth(depth + 1)} ? {self._number(depth + 1)} : {self._number(depth + 1)})'
        operator = pick('++--**/' if chance() < 0.2 else '++--**+')
        return f'({self._number(depth + 1)} {operator} {self._number(depth + 1)})'

    def _text(self) -> str:
        pick = self._random.choice
        what = self._random.random()
        if what < 0.5:
            return f"'{pick(('x', 'y', 'foo', ''))}'"
        return pick(TEXTS) if what < 0.8 else f"({pick(TEXTS)} .. '{pick('xy')}')"

    def _truth(self, depth: int = 0) -> str:
        pick = self._random.choice
        what = self._random.random()
        if depth > 2 or what < 0.5:
            return f'({self._number(2)} {pick(("==", "!=", "<", ">", "<=", ">="))} {self._number(2)})'
        if what < 0.62:
            return f'({pick(TEXTS)} {pick(("==", "!="))} {self._text()})'
        if what < 0.7:
            return pick(('true', 'false', 'k', '1', '0'))
        if what < 0.78:
            return f'(!{self._truth(3)})'
        if what < 0.82:
            return f'({self._number(3)} < {self._number(3)} < {self._number(3)})'
        return f'({self._truth(depth + 1)} {pick(("&&", "||"))} {self._truth(depth + 1)})'

    def _statement(self) -> str:
        pick = self._random.choice
        what = self._random.random()
        if what < 0.25:
            return f'{pick(INTEGERS)} {pick(("=", ":="))} {self._random.randint(0, 5)}'
        if what < 0.4:
            return f'{pick(INTEGERS)} += {self._random.randint(1, 2)}'
        if what < 0.5:
            return f'{pick(INTEGERS)} {pick(("-=", "*="))} {self._random.randint(1, 2)}'
        if what < 0.65:
            return f'{pick(REALS)} = {self._number(1)}'
        if what < 0.75:
            return f'{pick(TEXTS)} {pick(("=", ":=", "+="))} {self._text()}'
        if what < 0.85:
            return f'{pick(BOOLEANS)} = {self._truth(2)}'
        if what < 0.95:
            return f'u{self._random.randint(0, 2)} := {self._number(1)}'
        # It fails if the number is not an integer.
        return f'{pick(INTEGERS)} = {self._number(1)}'

    def _script(self) -> str:
        return '; '.join(self._statement() for _ in range(self._random.choice((1, 1, 1, 2, 3))))

    # -- elements --------------------------------------------------------------------------------------------------

    def _attributes(self, ports: Sequence[tuple[str, str]] = (), named: bool | None = None) -> Attributes:
        chance = self._random.random
        self._count += 1
        named = named if named is not None else chance() < 0.92
        attributes = [('name', f'n{self._count}')] if named else []
        attributes += ports
        if chance() < self._conditional:
            for key in ('_failureIf', '_successIf', '_skipIf', '_while'):
                if chance() < 0.3:
                    attributes.append((key, self._truth(1)))
            for key in ('_onSuccess', '_onFailure', '_onHalted', '_post'):
                if chance() < 0.3:
                    attributes.append((key, self._statement()))
        self._random.shuffle(attributes)
        return attributes

    def _element(self, tag: str, kind: str, attributes: Attributes, children: str = '') -> str:
        compact = self._in_reactive_sequence or self._random.random() < 0.93
        head, attributes = (tag, attributes) if compact else (kind, [('ID', tag), *attributes])
        text = f'<{head}' + ''.join(f' {name}={xml_attribute(value)}' for name, value in attributes)
        return f'{text}>{children}</{head}>' if children else f'{text}/>'

    def _letters(self, may_run: bool) -> str:
        letters = ''
        for _ in range(self._random.choice((1, 1, 2, 3, 4))):
            what = self._random.random()
            if may_run and what < self._running:
                letters += 'R'
            elif what > 1.0 - self._skipping * 0.5:
                letters += 'K'
            else:
                letters += self._random.choice('SSF')
        return letters + 'I' if self._random.random() < 0.004 else letters

    def _accesses(self) -> Attributes:
        """Return the attributes for what a leaf writes and reads."""
        pick, chance = self._random.choice, self._random.random
        attributes: Attributes = []
        if chance() <= 0.12:
            attributes.append(('_write', ';'.join(self._write() for _ in range(pick((1, 1, 2))))))
        if chance() <= 0.1:
            attributes.append(('_read', ';'.join(self._random.sample(KEYS, 2))))
        return attributes

    def _write(self) -> str:
        pick = self._random.choice
        what = self._random.random()
        if what < 0.5:
            return f'{pick(INTEGERS)}:i:{self._random.randint(0, 5)}'
        if what < 0.7:
            return f'{pick((*REALS, "a"))}:d:{pick(("0.5", "2.0", "3.25"))}'
        if what < 0.9:
            return f'{pick((*TEXTS, "a", "d"))}:s:{pick(("x", "7", "foo"))}'
        return f'{pick((*BOOLEANS, "a"))}:b:1'

    # -- nodes -----------------------------------------------------------------------------------------------------

    def _node(self, depth: int) -> str:
        self._budget -= 1
        if self._budget <= 0 or depth > 6:
            return self._leaf()
        what = self._random.random()
        if depth > 0 and what < 0.4:
            return self._leaf()
        if what < 0.74:
            return self._control(depth)
        if what < 0.94 or depth > 4:
            return self._decorator(depth)
        return self._subtree(depth)

    def _children(self, least: int, most: int, depth: int, reactive_sequence: bool = False) -> str:
        count = self._random.randint(least, most)
        outer, self._in_reactive_sequence = self._in_reactive_sequence, reactive_sequence
        text = ''.join(self._node(depth + 1) for _ in range(count))
        self._in_reactive_sequence = outer
        return text

    def _leaf(self) -> str:
        chance = self._random.random
        if chance() < self._scripts * 0.6:
            return self._blackboard_leaf()
        what = chance()
        if what < 0.06:
            return self._element('AlwaysSuccess', 'Action', self._attributes())
        if what < 0.11:
            return self._element('AlwaysFailure', 'Action', self._attributes())
        if self._timers and what < 0.2:
            return self._element('Sleep', 'Action', self._attributes([('msec', '0')]))
        accesses = self._accesses()
        if what < 0.8:
            tag = 'Act' if what < 0.6 else 'Sync'
            script = ('_script', self._letters(tag == 'Act'))
            return self._element(tag, 'Action', self._attributes([script, *accesses], named=True))
        script = ('_script', self._letters(False))
        return self._element('Cond', 'Condition', self._attributes([script, *accesses], named=True))

    def _blackboard_leaf(self) -> str:
        pick = self._random.choice
        what = self._random.random()
        if what < 0.4:
            return self._element('Script', 'Action', self._attributes([('code', self._script())]))
        if what < 0.7:
            return self._element('ScriptCondition', 'Condition', self._attributes([('code', self._truth())]))
        if what < 0.78:
            key = pick(INTEGERS)
            value = pick((str(self._random.randint(0, 9)), f'{{{pick(INTEGERS)}}}'))
        elif what < 0.84:
            key = pick(TEXTS)
            value = pick(('hello', '', f'{{{pick(TEXTS)}}}'))
        elif what < 0.92:
            entry = pick(('{%s}', '%s')) % pick(KEYS)
            return self._element('WasEntryUpdated', 'Action', self._attributes([('entry', entry)]))
        else:
            keys = ('u0', 'u1', pick(KEYS)) if self._random.random() < 0.3 else ('u0', 'u1')
            return self._element('UnsetBlackboard', 'Action', self._attributes([('key', pick(keys))]))
        return self._element('SetBlackboard', 'Action', self._attributes([('value', value), ('output_key', key)]))

    def _control(self, depth: int) -> str:
        pick, chance, number = self._random.choice, self._random.random, self._random.randint
        tag = pick(CONTROLS)
        if self._in_reactive_sequence and tag == 'AsyncSequence':
            tag = 'AsyncFallback'
        ports: Attributes = []
        least, most = 1, 4
        if tag == 'Switch':
            count = number(2, 6) if chance() < 0.3 else number(2, 3)
            tag = f'Switch{count}'
            chance()
            ports.append(('variable', pick(('{s}', '{t}', '{s}', '1', '2', 'foo'))))
            for place in range(1, count + 1):
                if chance() < 0.95:
                    ports.append((f'case_{place}', pick(('0', '1', '2', '3', 'foo', 'x', 'y', '{t}'))))
            if chance() >= 0.97:
                del ports[0]
        elif tag in ('IfThenElse', 'WhileDoElse'):
            least, most = 2 if chance() < 0.99 else 1, 3
        elif tag == 'Parallel':
            least = most = number(1, 4)
            for port, counts in (('success_count', (-2, -1, 1)), ('failure_count', (-1, 1))):
                if chance() < 0.6:
                    ports.append((port, str(pick((*counts, most, max(1, most - 1), number(0, most))))))
            if chance() < 0.01:
                ports = [('success_count', '{a}')]
        elif tag == 'ParallelAll':
            least = most = number(1, 4)
            if chance() < 0.5:
                ports.append(('max_failures', str(pick((-1, 0, 1, most)))))
        attributes = self._attributes(ports)
        if tag.startswith('Switch'):
            # Sometimes without the default, which is an error when the node is ticked.
            least = most = count + 1 if chance() < 0.985 else count
        children = self._children(least, most, depth, tag == 'ReactiveSequence')
        return self._element(tag, 'Control', attributes, children)

    def _decorator(self, depth: int) -> str:
        pick, chance = self._random.choice, self._random.random
        endless = () if self._drain else ('KeepRunningUntilFailure',) * 2
        tag = pick((*DECORATORS, *endless, *(TIMED if self._timers else ())))
        ports: Attributes = []
        child = ''
        match tag:
            case 'Repeat':
                cycles = ('1', '2', '3', '0', '2') if self._drain else ('1', '2', '3', '0', '-1', '{a}')
                ports = [('num_cycles', pick(cycles))]
            case 'RetryUntilSuccessful':
                attempts = ('1', '2', '3', '0', '2') if self._drain else ('1', '2', '3', '0', '-1', '{b}')
                ports = [('num_attempts', pick(attempts))]
            case 'RunOnce':
                ports = [('then_skip', pick(self.then_skip))] if chance() < 0.6 else []
            case 'Precondition':
                ports = [('if', self._truth(1))]
                if chance() < 0.6:
                    ports.append(('else', pick(('FAILURE', 'SUCCESS', 'SKIPPED', 'RUNNING'))))
            case 'Deco':
                pairs = [f'{letter}>{pick("SSFFRK")}' for letter in 'SFRK' if chance() < 0.3]
                ports = [('_map', ' '.join(pairs))] if pairs else []
            case 'Loop':
                tag, queue, value = pick(LOOPS)
                ports = [('queue', queue), ('value', value)]
                if chance() < 0.5:
                    ports.append(('if_empty', pick(self.if_empty)))
            case 'SkipUnlessUpdated' | 'WaitValueUpdate':
                ports = [('entry', f'{{{pick(KEYS)}}}')]
                outer, self._skipping = self._skipping, 0.0
                script = ('_script', self._letters(False))
                child = self._element('Sync', 'Action', self._attributes([script], named=True))
                self._skipping = outer
            case 'Timeout':
                ports = [('msec', pick(('0', '100000')))]
            case 'Delay':
                ports = [('delay_msec', '100000')]
        attributes = self._attributes(ports, named=True if tag == 'Deco' else None)
        return self._element(tag, 'Decorator', attributes, child or self._children(1, 1, depth))

    def _subtree(self, depth: int) -> str:
        pick, chance = self._random.choice, self._random.random
        if self._ids and chance() < 0.25 and not self._building:
            id = pick(self._ids)
        else:
            id = f'T{len(self._ids) + 1}'
            self._ids.append(id)
            outer = self._in_reactive_sequence, self._building
            self._in_reactive_sequence, self._building = False, True
            body = self._node(depth + 1)
            self._in_reactive_sequence, self._building = outer
            self._trees.append((id, body))
        ports: Attributes = []
        mode = chance()
        if mode < 0.55:
            for group in GROUPS:
                for key in group:
                    what = chance()
                    if what < 0.7:
                        ports.append((key, f'{{{pick(group)}}}'))
                    elif what < 0.85:
                        ports.append((key, '{=}'))
                    elif what < 0.95 and group is TEXTS:
                        ports.append((key, pick(('foo', 'x', 'hello world'))))
                    else:
                        ports.append((key, f'{{{key}}}'))
        elif mode < 0.9:
            ports.append(('_autoremap', pick(('true', '1'))))
            if chance() < 0.4:
                ports.append((pick(INTEGERS), f'{{{pick(INTEGERS)}}}'))
            if chance() < 0.2:
                ports.append((pick(TEXTS), 'foo'))
        else:
            ports = [(key, '{=}') for key in self._random.sample(KEYS, 3)]
        attributes = [('ID', id), *self._attributes(named=chance() < 0.8), *ports]
        return '<SubTree' + ''.join(f' {name}={xml_attribute(value)}' for name, value in attributes) + '/>'


def wheel_case(seed: int) -> dict[str, Any]:
    """Return the case of the corpus with this number."""
    return _Generator(seed).case()


NEW = ('u', 'v', 'w')
"""Entries that only scripts create."""


class _ScriptGenerator(_Generator):
    """Trees with all kinds of scripts, including scripts that fail, and with missing entries.

    Add new nodes here, because the corpus must not change.

    The scripts mean the same in 4.8.2 as in 4.10, whose grammar the engine follows: every operator has parentheses, and
    ``true`` occurs only where integer and double make no difference. Excluded is one deliberate difference of the
    engine: numbers that outgrow the type of their entry.
    """

    if_empty = ('SUCCESS', 'FAILURE', 'SKIPPED', 'RUNNING')
    then_skip = ('true', 'false', '{k}')

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self._random = random.Random(f'flexbt {seed}')
        pick = self._random.choice
        self._scripts = pick((0.1, 0.3, 0.5))
        self._conditional = pick((0.0, 0.1, 0.25, 0.5))
        # Some entries are missing at first, or removed.
        self._gaps = pick((True, False))

    def case(self) -> dict[str, Any]:
        case = super().case()
        if self._gaps:
            for key in KEYS:
                if self._random.random() < 0.05:
                    del case['bb'][key]
            if self._random.random() < 0.15:
                case['ops'].insert(self._random.randrange(len(case['ops'])), ['unset', self._random.choice(KEYS)])
        return case

    def _assignment(self, key: str) -> tuple[str, str, Any]:
        """Return a value of the kind of ``key``, for that entry or for one of another kind."""
        pick = self._random.choice
        # In the library, an entry that was only declared keeps a number of the other kind unchanged. Here the number
        # gets the declared type. So cases with gaps keep the kinds apart.
        if key in INTEGERS:
            return key if self._gaps else pick((*INTEGERS, *INTEGERS, 'd')), 'i', self._random.randint(0, 5)
        if key in REALS:
            return key if self._gaps else pick((*REALS, *REALS, 'a')), 'd', pick((0.5, 2.0, 3.25))
        if key in TEXTS:
            return pick((*TEXTS, *TEXTS, 'a', 'd')), 's', pick(('x', '7', 'foo'))
        key = pick(('k', 'k', 'a'))
        # For an entry of integers the library rejects false but accepts true; this engine accepts both.
        return key, 'b', True if key == 'a' else pick((True, False))

    def _write(self) -> str:
        key, kind, value = self._assignment(self._random.choice(KEYS))
        return f'{key}:{kind}:{int(value) if isinstance(value, bool) else value}'

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
        """Return an entry that scripts must create first. It may be missing, which is an error."""
        return self._random.choice(NEW) if self._random.random() < 0.2 else 'd'

    def _text(self, depth: int = 0) -> str:
        pick = self._random.choice
        chance = self._random.random()
        if depth > 2 or chance < 0.5:
            return pick((*TEXTS, "'x'", "'foo'", "''", "'7'"))
        if chance < 0.6:
            return f'({self._truth(depth + 1)} ? {self._text(depth + 1)} : {self._text(depth + 1)})'
        # Avoid a number followed by other text: a Switch of 4.8.2 reads it as that number.
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
                # Statements that may fail.
                wrong = 's = 1', 'd = s', 'a += s', 'u *= t', 'w = 1'
                return pick((f'{pick(INTEGERS)} = ({pick(INTEGERS)} / 2)', *wrong))

    def _script(self) -> str:
        return '; '.join(self._statement() for _ in range(self._random.choice((1, 1, 2, 3))))

    # -- nodes -----------------------------------------------------------------------------------------------------

    def _blackboard_leaf(self) -> str:
        pick, chance = self._random.choice, self._random.random
        if chance() < 0.6:
            return super()._blackboard_leaf()
        if self._gaps and chance() < 0.3:
            return self._element('UnsetBlackboard', 'Action', self._attributes([('key', pick(KEYS))]))
        group = pick((INTEGERS, INTEGERS, REALS, BOOLEANS, TEXTS))
        value = f'{{{pick(group)}}}'
        if chance() < 0.5:
            value = 'foo' if group is TEXTS else '0.5' if group is REALS else '1'
        ports = [('value', value), ('output_key', pick(group))]
        return self._element('SetBlackboard', 'Action', self._attributes(ports))


def script_case(seed: int) -> dict[str, Any]:
    """Return the case with more scripts and this number."""
    return _ScriptGenerator(seed).case()

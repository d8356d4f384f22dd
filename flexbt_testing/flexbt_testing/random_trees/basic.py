# SPDX-License-Identifier: BSD-3-Clause
"""Random trees with scripted leaves (see ``scripted_nodes``), for the comparison with BehaviorTree.CPP.

The same seed always gives the same tree.

Left out is what the library itself does not do the same way twice or in two of its versions (timers that fire, text
that looks like a number on the ports of a sub-tree), and what this engine does differently on purpose.
"""

from __future__ import annotations

import random
from typing import Any

from flexbt_core.values import xml_attribute

INTEGERS, REALS, TEXTS, BOOLEANS = ('a', 'b', 'c'), ('d', 'e'), ('s', 't'), ('k',)
GROUPS = (INTEGERS, REALS, TEXTS, BOOLEANS)
KEYS = tuple(key for group in GROUPS for key in group)

CONTROLS = (
    *('Sequence',) * 4,
    *('Fallback',) * 4,
    *('ReactiveSequence',) * 3,
    *('ReactiveFallback',) * 3,
    *('SequenceWithMemory',) * 3,
    *('Parallel',) * 4,
    *('AsyncSequence',) * 2,
    *('AsyncFallback',) * 2,
)
DECORATORS = (
    *('Inverter',) * 3,
    *('ForceSuccess',) * 2,
    *('ForceFailure',) * 2,
    *('Repeat',) * 3,
    *('RetryUntilSuccessful',) * 3,
    *('KeepRunningUntilFailure',) * 2,
    *('Deco',) * 3,
    *('Timeout',) * 2,
    'Delay',
)


class _Generator:
    def __init__(self, seed: int) -> None:
        # A generator of its own for each seed: cases do not depend on the order in which they are made.
        self._random = random.Random(f'flexbt {seed}')
        pick = self._random.choice
        self._budget = self._random.randint(3, 30)
        self._drain = self._random.random() < 0.25
        self._running = pick((0.1, 0.3, 0.5))
        self._skipping = pick((0.0, 0.0, 0.1, 0.3))
        self._conditional = 0.0
        self._blackboard = pick((0.0, 0.1, 0.4))
        # Entries that are missing at first, or removed.
        self._gaps = pick((True, False))
        self._names = 0
        self._trees: list[tuple[str, str]] = []
        self._building = False
        self._in_reactive_sequence = False

    def case(self) -> dict[str, Any]:
        pick = self._random.choice
        trees = [('Main', self._node(0)), *self._trees]
        self._random.shuffle(trees)
        xml = ''.join(f'<BehaviorTree ID="{id}">{body}</BehaviorTree>' for id, body in trees)
        ops: list[list[Any]] = []
        for _ in range(self._random.randint(3, 10)):
            chance = self._random.random()
            if chance < 0.12 and ops:
                ops.append(['halt'])
            elif chance < 0.25:
                ops.append(['set', *self._assignment()])
            elif chance < 0.27 and self._gaps:
                ops.append(['unset', pick(KEYS)])
            ops.append(['once' if self._drain else 'tick'])
        board = {
            **{key: self._random.randint(0, 3) for key in INTEGERS},
            **{key: pick((0.5, 1.0, 2.25)) for key in REALS},
            **{key: pick(('x', 'foo')) for key in TEXTS},
            **{key: pick((True, False)) for key in BOOLEANS},
        }
        for key in KEYS:
            if self._gaps and self._random.random() < 0.05:
                del board[key]
        document = f'<root BTCPP_format="4" main_tree_to_execute="Main">{xml}</root>'
        return {'xml': document, 'bb': board, 'ops': ops}

    def _assignment(self) -> tuple[str, str, Any]:
        pick = self._random.choice
        kind = pick('iidsb')
        match kind:
            case 'i':
                # An entry that was only declared keeps a number of the other kind as it is in the library; here it gets
                # the type that was declared. So with gaps the kinds are kept apart.
                keys: tuple[str, ...] = INTEGERS if self._gaps else (*INTEGERS, *INTEGERS, 'd')
                return pick(keys), 'i', self._random.randint(0, 5)
            case 'd':
                keys = REALS if self._gaps else (*REALS, *REALS, 'a')
                return pick(keys), 'd', pick((0.5, 2.0, 3.25))
            case 's':
                return pick((*TEXTS, *TEXTS, 'a', 'd')), 's', pick(('x', '7', 'foo'))
            case _:
                key = pick(('k', 'k', 'a'))
                # The library refuses false, and takes true, for an entry of integers; this engine takes both.
                return key, 'b', True if key == 'a' else pick((True, False))

    # -- elements --------------------------------------------------------------------------------------------------

    def _element(
        self, tag: str, kind: str, attributes: list[tuple[str, str]], children: str = '', named: bool = False
    ) -> str:
        self._names += 1
        attributes = [*attributes, *self._conditions()]
        if named or self._random.random() < 0.9:
            attributes.append(('name', f'n{self._names}'))
        head = tag
        # The library refuses the explicit form below a ReactiveSequence, which is a defect.
        if self._random.random() < 0.08 and not self._in_reactive_sequence:
            head = kind
            attributes.append(('ID', tag))
        self._random.shuffle(attributes)
        text = ''.join(f' {name}={xml_attribute(value)}' for name, value in attributes)
        return f'<{head}{text}>{children}</{head}>' if children else f'<{head}{text}/>'

    def _conditions(self) -> list[tuple[str, str]]:
        """Pre- and post-conditions, with the probability ``_conditional``; see ``scripts``."""
        return []

    def _node(self, depth: int) -> str:
        self._budget -= 1
        chance = self._random.random()
        if self._budget <= 0 or depth > 7 or (depth > 0 and chance < 0.38):
            return self._leaf()
        if chance < 0.74:
            return self._control(depth)
        if chance < 0.94 or depth > 4:
            return self._decorator(depth)
        return self._subtree(depth)

    def _children(self, count: int, depth: int, reactive_sequence: bool = False) -> str:
        outer, self._in_reactive_sequence = self._in_reactive_sequence, reactive_sequence
        text = ''.join(self._node(depth + 1) for _ in range(count))
        self._in_reactive_sequence = outer
        return text

    def _control(self, depth: int) -> str:
        pick = self._random.choice
        tag = pick(CONTROLS)
        if tag == 'AsyncSequence' and self._in_reactive_sequence:
            tag = 'AsyncFallback'
        count = self._random.randint(1, 4)
        attributes: list[tuple[str, str]] = []
        if tag == 'Parallel':
            if self._random.random() < 0.6:
                attributes.append(('success_count', str(pick((-2, -1, 1, count, self._random.randint(0, count))))))
            if self._random.random() < 0.6:
                attributes.append(('failure_count', str(pick((-1, 1, count, self._random.randint(0, count))))))
            if self._random.random() < 0.05:
                attributes = [(pick(('success_count', 'failure_count')), pick(('{a}', '{b}', '9')))]
        return self._element(tag, 'Control', attributes, self._children(count, depth, tag == 'ReactiveSequence'))

    def _decorator(self, depth: int) -> str:
        pick = self._random.choice
        tag = pick(DECORATORS)
        if self._drain and tag in ('KeepRunningUntilFailure', 'Delay'):
            tag = 'Inverter'
        attributes: list[tuple[str, str]] = []
        match tag:
            case 'Repeat':
                attributes = [
                    ('num_cycles', pick(('1', '2', '3', '0') if self._drain else ('1', '2', '3', '-1', '{a}')))
                ]
            case 'RetryUntilSuccessful':
                attributes = [
                    ('num_attempts', pick(('1', '2', '3', '0') if self._drain else ('1', '2', '3', '-1', '{b}')))
                ]
            case 'Timeout':
                attributes = [('msec', pick(('0', '100000')))]
            case 'Delay':
                attributes = [('delay_msec', '100000')]
            case 'Deco':
                pairs = [f'{letter}>{pick("SSFFRK")}' for letter in 'SFRK' if self._random.random() < 0.3]
                attributes = [('_map', ' '.join(pairs))] if pairs else []
        return self._element(tag, 'Decorator', attributes, self._children(1, depth), named=tag == 'Deco')

    def _leaf(self) -> str:
        pick = self._random.choice
        chance = self._random.random()
        if chance < 0.06:
            return self._element('AlwaysSuccess', 'Action', [])
        if chance < 0.12:
            return self._element('AlwaysFailure', 'Action', [])
        if chance < 0.15:
            return self._element('Sleep', 'Action', [('msec', '0')])
        if self._random.random() < self._blackboard * 0.5:
            return self._blackboard_leaf()
        attributes: list[tuple[str, str]] = []
        if self._random.random() < self._blackboard:
            attributes.append(('_write', ';'.join(self._write() for _ in range(pick((1, 1, 2))))))
        if self._random.random() < self._blackboard:
            attributes.append(('_read', ';'.join(self._random.sample(KEYS, 2))))
        if chance < 0.6:
            return self._element('Act', 'Action', [('_script', self._letters(True)), *attributes], named=True)
        if chance < 0.8:
            return self._element('Sync', 'Action', [('_script', self._letters(False)), *attributes], named=True)
        return self._element('Cond', 'Condition', [('_script', self._letters(False)), *attributes], named=True)

    def _blackboard_leaf(self) -> str:
        pick = self._random.choice
        if self._gaps and self._random.random() < 0.3:
            return self._element('UnsetBlackboard', 'Action', [('key', pick(KEYS))])
        group = pick((INTEGERS, INTEGERS, REALS, BOOLEANS, TEXTS))
        value = f'{{{pick(group)}}}'
        if self._random.random() < 0.5:
            value = 'foo' if group is TEXTS else '0.5' if group is REALS else '1'
        return self._element('SetBlackboard', 'Action', [('value', value), ('output_key', pick(group))])

    def _write(self) -> str:
        key, kind, value = self._assignment()
        return f'{key}:{kind}:{int(value) if isinstance(value, bool) else value}'

    def _letters(self, may_run: bool) -> str:
        letters = ''
        for _ in range(self._random.choice((1, 1, 2, 3, 4))):
            chance = self._random.random()
            if may_run and chance < self._running:
                letters += 'R'
            elif chance > 1.0 - self._skipping * 0.5:
                letters += 'K'
            else:
                letters += self._random.choice('SSF')
        return letters + 'I' if self._random.random() < 0.004 else letters

    def _subtree(self, depth: int) -> str:
        pick = self._random.choice
        if self._trees and self._random.random() < 0.3 and not self._building:
            id = pick(self._trees)[0]
        else:
            outer = self._building, self._in_reactive_sequence
            self._building, self._in_reactive_sequence = True, False
            body = self._node(depth + 1)
            self._building, self._in_reactive_sequence = outer
            id = f'T{len(self._trees)}'
            self._trees.append((id, body))
        attributes = [('ID', id), *self._conditions()]
        chance = self._random.random()
        if chance < 0.55:
            for group in GROUPS:
                for key in group:
                    what = self._random.random()
                    if what < 0.8:
                        attributes.append((key, '{=}' if what < 0.2 else f'{{{pick(group)}}}'))
                    elif group is TEXTS and what < 0.95:
                        attributes.append((key, pick(('foo', 'hello world'))))
        elif chance < 0.9:
            attributes.append(('_autoremap', pick(('true', '1'))))
            if self._random.random() < 0.4:
                attributes.append((pick(INTEGERS), f'{{{pick(INTEGERS)}}}'))
            if self._random.random() < 0.2:
                attributes.append((pick(TEXTS), 'foo'))
        if self._random.random() < 0.8:
            self._names += 1
            attributes.append(('name', f'n{self._names}'))
        return '<SubTree' + ''.join(f' {name}={xml_attribute(value)}' for name, value in attributes) + '/>'


def make_case(seed: int) -> dict[str, Any]:
    """The case of this number."""
    return _Generator(seed).case()

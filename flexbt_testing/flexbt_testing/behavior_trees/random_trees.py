# SPDX-License-Identifier: BSD-3-Clause
"""Random trees of scripted leaves by number: basic ones, with decisions and loops, and with scripts.

The same seed always gives the same tree.

Left out is what the library itself does not do the same way twice or in two of its versions (timers that fire, text
that looks like a number on the ports of a sub-tree), and what this engine does differently on purpose.
"""

from __future__ import annotations

import random
from typing import Any

from flexbt_core.values.text import xml_attribute

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
        # A separate generator for each seed: cases do not depend on the order in which they are made.
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


def basic_case(seed: int) -> dict[str, Any]:
    """Return the case of this number."""
    return _Generator(seed).case()


# Random trees as in ``basic`` that also have the controls which decide, the loops and the entry updates.
#
# What is left out, since the library of the wheel is older than what the engine follows: children of SkipUnlessUpdated
# and WaitValueUpdate that are not done in one tick (it does not halt them), text that begins with a number for a Switch
# (it takes the prefix for the number), queues on the blackboard, and TryCatch.

DECIDING_CONTROLS = (
    *('IfThenElse', 'WhileDoElse', 'ParallelAll') * 2,
    *('Switch2', 'Switch3') * 2,
    'Switch4',
    'Switch5',
    'Switch6',
)
LOOPS = (
    ('LoopInt', '1;2;3', '{c}'),
    ('LoopInt', '5', '{c}'),
    ('LoopInt', '', '{c}'),
    ('LoopDouble', '0.5;2', '{e}'),
    ('LoopString', 'x;foo', '{t}'),
    ('LoopBool', 'true;false;1', '{k}'),
)
ENTRY_DECORATORS = (*('Loop', 'RunOnce') * 2, 'SkipUnlessUpdated', 'WaitValueUpdate')


class _NodesGenerator(_Generator):
    def _control(self, depth: int) -> str:
        pick = self._random.choice
        if self._random.random() < 0.4:
            return super()._control(depth)
        tag = pick(DECIDING_CONTROLS)
        attributes: list[tuple[str, str]] = []
        if tag.startswith('Switch'):
            cases = int(tag[-1])
            # Now and then the wrong number of children, which is an error when the node is ticked.
            count = cases + 1 - (self._random.random() < 0.02)
            if self._random.random() < 0.97:
                attributes.append(('variable', pick(('{s}', '{t}', '{s}', '1', '2', 'foo'))))
            for number in range(1, cases + 1):
                if self._random.random() < 0.95:
                    attributes.append((f'case_{number}', pick(('0', '1', '2', '3', 'foo', 'x', 'y', '{t}'))))
        elif tag == 'ParallelAll':
            count = self._random.randint(1, 4)
            if self._random.random() < 0.6:
                attributes.append(('max_failures', pick(('-2', '-1', '0', '1', '2', str(count), '{a}'))))
        else:
            count = 1 if self._random.random() < 0.02 else self._random.randint(2, 3)
        return self._element(tag, 'Control', attributes, self._children(count, depth))

    def _decorator(self, depth: int) -> str:
        pick = self._random.choice
        if self._random.random() < 0.5:
            return super()._decorator(depth)
        tag = pick(ENTRY_DECORATORS)
        attributes: list[tuple[str, str]] = []
        if tag == 'Loop':
            tag, queue, value = pick(LOOPS)
            attributes = [('queue', queue), ('value', value)]
            if self._random.random() < 0.5:
                attributes.append(('if_empty', pick(('SUCCESS', 'FAILURE', 'SKIPPED', 'RUNNING'))))
        elif tag == 'RunOnce':
            if self._random.random() < 0.6:
                attributes = [('then_skip', pick(('true', 'false', '{k}')))]
        else:
            attributes = [('entry', self._entry())]
            outer = self._skipping, self._conditional
            self._skipping = self._conditional = 0.0
            child = self._element('Sync', 'Action', [('_script', self._letters(False))], named=True)
            self._skipping, self._conditional = outer
            return self._element(tag, 'Decorator', attributes, child)
        return self._element(tag, 'Decorator', attributes, self._children(1, depth))

    def _blackboard_leaf(self) -> str:
        if self._random.random() < 0.4:
            return self._element('WasEntryUpdated', 'Action', [('entry', self._entry())])
        return super()._blackboard_leaf()

    def _entry(self) -> str:
        key = self._random.choice(KEYS)
        return key if self._random.random() < 0.3 else f'{{{key}}}'


def control_case(seed: int) -> dict[str, Any]:
    """Return the case of this number."""
    return _NodesGenerator(seed).case()


# Random trees as in ``nodes`` that also have scripts: as nodes, and as pre- and post-conditions.
#
# The scripts mean the same in 4.8.2, the version of the wheel, as in 4.10, whose grammar the engine has: every operator
# has its parentheses, and ``true`` stands only where it does not matter whether it is an integer or a double. Some of
# them fail when they run. Left out is what the engine does differently on purpose: numbers that grow out of the type of
# their entry.

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
        """Return an entry that scripts have to make first. It may be missing, which is an error."""
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


def script_case(seed: int) -> dict[str, Any]:
    """Return the case of this number."""
    return _ScriptsGenerator(seed).case()

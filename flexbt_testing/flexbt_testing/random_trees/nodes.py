# SPDX-License-Identifier: BSD-3-Clause
"""Random trees as in ``basic`` that also have the controls which decide, the loops and the entry updates.

What is left out, since the library of the wheel is older than what the engine follows: children of SkipUnlessUpdated
and WaitValueUpdate that are not done in one tick (it does not halt them), text that begins with a number for a Switch
(it takes the prefix for the number), queues on the blackboard, and TryCatch.
"""

from __future__ import annotations

from typing import Any

from .basic import KEYS, _Generator

CONTROLS = (
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
DECORATORS = (*('Loop', 'RunOnce') * 2, 'SkipUnlessUpdated', 'WaitValueUpdate')


class _NodesGenerator(_Generator):
    def _control(self, depth: int) -> str:
        pick = self._random.choice
        if self._random.random() < 0.4:
            return super()._control(depth)
        tag = pick(CONTROLS)
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
        tag = pick(DECORATORS)
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


def make_case(seed: int) -> dict[str, Any]:
    """The case of this number."""
    return _NodesGenerator(seed).case()

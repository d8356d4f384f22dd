# SPDX-License-Identifier: BSD-3-Clause
"""Machines in YAML in many styles, for the tests of documents."""

PLAIN = """\
machine:
  outcomes: [finished, off]
  output_keys: [result]
  userdata: {place: dock, limits: [1, 2.5, true], nothing: null}
  states:
    Find:
      state: Find
      parameters: {tries: 3}
      transitions: {done: Both, off: off}
      autonomy: {done: low, off: 0}
    Both:
      concurrency:
        outcomes: [done, failed]
        input_keys: [place]
        output_keys: [result]
        conditions:
          - {outcome: done, when: {Go: done, Watch: off}}
          - {outcome: failed, when: {Go: off}}
          - {outcome: failed, when: {Watch: done}}
        states:
          Go: {state: Go, remapping: {goal: place, took: result}}
          Watch: {state: Find, parameters: {tries: 1}, autonomy: {done: full}}
      transitions: {done: finished, failed: Rescue}
      autonomy: {failed: HIGH}
    Rescue:
      priority:
        outcomes: [back]
        states:
          Turn:
            state: Find
            parameters: {tries: 2}
            retry: {attempts: 3, on: [off], delay: 2}
            transitions: {done: back, off: back}
      transitions: {back: Both}
"""

BEHAVIOR = """\
# Drive to places, and ask at each.
#
# A second paragraph.

behavior:
    name: Round   # as the operator sees it
    description: >
        Drive to places.
        # this is text
    parameters:
        tree: {default: my_robot/trees/drive.xml, description: tree that drives}
        limit:
            default: 60.0
            unit: s

# The machine begins here.
machine:
    outcomes:
    - finished
    - 'failed'
    autonomy: off
    states:

        # Drive first.
        # It takes a while.
        Drive:                              # driver
            state:       BtExecuteGoalState
            parameters:
                bt_file: $tree              # of the head
                script: |
                    # no comment
                    a = 1

            timeout:     {after: $limit, outcome: failed}
            transitions:
                done:     Watch             # next
                canceled: failed
                failed:   failed
            autonomy:
                done: off
            # a comment of Drive, at its end

        # Watch then.
        Watch:
            behavior: {use: Inspect Site, parameters: {duration: 2.0}, default_keys: [report]}
            transitions: {finished: Inner, failed: failed}

        Inner:
            machine:
                outcomes: [out, 'failed']
                states:
                    One: {state: WaitState, parameters: {wait_time: 1.0}, transitions: {done: Two}}
                    # two
                    Two: {state: WaitState, parameters: {wait_time: 1.0}, transitions: {done: out}}   # last
            transitions:
                out: Drive
                failed: failed

        "Odd name, with commas":
            state: LogState
            transitions: {"done": 'finished'}
            # the end
"""

FLOW = """\
machine: {outcomes: [a, b], states: {S: {state: X, transitions: {yes: T, no: b}},
          T: {state: Y, parameters: {},
              transitions: {x: S, y: a}},  # T
          U: {state: 'Z',
              transitions: {
                x: S,
                y: a,  # to a
              },
          }}}
"""

COLUMNS = """\
---
concurrency:
  outcomes: [done]
  conditions:
  - outcome: done
    when:
      A: done
      B: done
  - outcome: done
    when: {B: failed}
  states:
    A:
      state: WaitState
      parameters:
        wait_time: 2.0
        names: [yes, "no"]
    B:
      state: WaitState
      remapping:
        x: y
...
"""

EMPTY = """\
machine:
  outcomes: [done]
  states: {}   # none yet
"""

ANCHORS = """\
machine:
  outcomes: [done]
  states:
    A: {state: X, transitions: &t {done: B}}
    B: {state: X, transitions: *t}
    C: {state: X, transitions: {done: B}}
    D: *other
"""

NO_LINE_BREAK = (
    'machine:\n  outcomes: [done]\n  states:\n    A:\n      state: X\n    B:\n      state: Y\n      transitions: {x: A}'
)

TEXTS = {
    'plain': PLAIN,
    'behavior': BEHAVIOR,
    'flow': FLOW,
    'columns': COLUMNS,
    'empty': EMPTY,
    'no_line_break': NO_LINE_BREAK,
    'crlf': BEHAVIOR.replace('\n', '\r\n'),
    'bom': '\ufeff' + PLAIN,
    'tabs': PLAIN.replace('Find\n', 'Find\t# a\ttab\n').replace('\n    Both', '\n\n    # über 😀\n    Both'),
}

FLEXBE = '''\
#!/usr/bin/env python
# -*- coding: utf-8 -*-
"""Define Round. Created on a day, @author: Ä. Person"""

from flexbe_core import Autonomy
from flexbe_core import Behavior
from flexbe_core import ConcurrencyContainer
from flexbe_core import OperatableStateMachine
from my_states.drive_state import DriveState
from my_states.watch_state import WatchState
# [MANUAL_IMPORT]
from zz import path

# [/MANUAL_IMPORT]


class RoundSM(Behavior):
    """Drive a round."""

    def __init__(self, node):
        super().__init__()
        self.name = 'Round'
        self.add_parameter('speed', 1.0)
        self.add_behavior(InnerSM, 'Watch/Inner', node)
        # [MANUAL_INIT]

        # [/MANUAL_INIT]
        # Behavior comments:

        # ! 120 40 /Watch
        # an important note

    def create(self):
        hint = 'abc'
        # x:683 y:40, x:683 y:140
        _state_machine = OperatableStateMachine(outcomes=['finished', 'failed'], input_keys=['goal'])
        _state_machine.userdata.goal = 3
        # [MANUAL_CREATE]

        # [/MANUAL_CREATE]
        # x:30 y:365, x:130 y:365
        _sm_watch_0 = ConcurrencyContainer(outcomes=['finished', 'failed'], input_keys=['goal'],
                                           conditions=[('finished', [('Left', 'done'), ('Inner', 'done')]),
                                                       ('failed', [('Left', 'failed')])
                                                       ])

        with _sm_watch_0:
            # x:84 y:50
            OperatableStateMachine.add('Left',
                                       WatchState(side="left, or 'back'", hint=hint),
                                       transitions={'done': 'finished', 'failed': 'failed'},
                                       autonomy={'done': Autonomy.Off, 'failed': Autonomy.Off},
                                       remapping={'goal': 'goal'})

            # x:84 y:150
            OperatableStateMachine.add('Inner',
                                       self.use_behavior(InnerSM, 'Watch/Inner', parameters={'speed': 2.0}),
                                       transitions={'done': 'finished'},
                                       autonomy={'done': Autonomy.Inherit})

        with _state_machine:
            # x:84 y:50 {?hidden = self.speed}
            OperatableStateMachine.add('Drive',
                                       DriveState(speed=self.speed, check=lambda x: x > 1),
                                       transitions={'done': 'Watch'  # 300 60 -1 -1 -1 -1
                                                    , 'failed': 'failed'},
                                       autonomy={'done': Autonomy.Off, 'failed': Autonomy.Low},
                                       remapping={'goal': 'goal'})

            # x:284 y:50
            OperatableStateMachine.add('Watch',
                                       _sm_watch_0,
                                       transitions={'finished': 'finished', 'failed': 'Drive'},
                                       autonomy={'finished': Autonomy.Inherit, 'failed': Autonomy.Inherit},
                                       remapping={'goal': 'goal'})

        return _state_machine
    # [MANUAL_FUNC]

    # [/MANUAL_FUNC]
'''

FORMS = '''\
"""Machines in the forms that people write. ÄÖÜ 😀"""
from flexbt_core import (
    Child,
    ConcurrencyContainer,
    OperatableStateMachine,
    with_retry,
    with_timeout,
)
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest, BehaviorParameter
from flexbt_states import BtExecuteState, WaitState
from flexbt_states import OperatorInputState as Ask


class Deliveries(Behavior):
    manifest = BehaviorManifest('Deliveries', 'Drive.', parameters=[BehaviorParameter('limit', 2.0, 'time')])

    def create(self) -> OperatableStateMachine:
        ask = Ask('Where to?', 'geometry_msgs/PoseStamped')  # 😀 a question
        asked = {'received': 'Drive', 'declined': 'finished', 'failed': 'failed'}
        with OperatableStateMachine(['finished', 'failed'], userdata={'count': 0}) as machine:
            machine.add('Ask', ask, asked, remapping={'data': 'goal'})
            # ü: two wrappers
            drive = with_timeout(with_retry(WaitState((2.0)), 3, ['failed']), 5.0, 'failed')
            machine.add('Drive', drive, {'done': 'Work', 'failed': 'Ask'})
            machine.add("Work", self._work(), transitions=({'done': ('finished')}))
            for number in range(2):
                machine.add(f'Wait{number}', WaitState(number), {'done': 'Drive'})
            if self.limit:
                machine.add('Extra', WaitState(1.0), transitions={'done': 'finished'})
            machine.add(
                'Last',
                BtExecuteState(bt_file='a.xml', **self.more),
                transitions={'done': 'finished', **{'canceled': 'failed'}},
            )
        return machine

    def _work(self):
        return ConcurrencyContainer(
            outcomes=['done'],
            conditions=[('done', [('Left', 'done'), ('Right', 'done')]), ('done', [('Left', 'failed')])],
            children=[
                # the left one
                Child('Left', WaitState(wait_time=1.0), transitions={'done': 'done'}),
                Child('Right', WaitState(2.0)),  # right
            ],
        )


class Second(Behavior):
    def create(self):
        children = [Child('A', (WaitState(1)), {'done': 'B'}), Child('B', Ask())]
        machine = OperatableStateMachine(['done'], children=children)
        return machine
'''

PYTHON = {
    'flexbe': FLEXBE,
    'tabs': FLEXBE.replace('    ', '\t').replace('\t\t\t\t\t\t   ', '\t\t\t\t\t\t\t'),
    'forms': FORMS,
    'crlf': FLEXBE.replace('\n', '\r\n'),
    'bom': '\ufeff' + FORMS,
}

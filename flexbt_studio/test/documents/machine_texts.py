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

# SPDX-License-Identifier: BSD-3-Clause
"""Installed ROS packages with behaviors as FlexBE's editor writes them."""

from __future__ import annotations

from pathlib import Path

PATROL = '''
#!/usr/bin/env python
# -*- coding: utf-8 -*-
###########################################################
#               WARNING: Generated code!                  #
###########################################################

from flexbe_core import Autonomy
from flexbe_core import Behavior
from flexbe_core import ConcurrencyContainer
from flexbe_core import Logger
from flexbe_core import OperatableStateMachine
from flexbe_core import PriorityContainer
from flexbe_states.calculation_state import CalculationState
from flexbe_states.log_key_state import LogKeyState
from flexbe_states.log_state import LogState
from flexbe_states.wait_state import WaitState
from {package}.greet_sm import GreetSM

# Additional imports can be added inside the following tags
# [MANUAL_IMPORT]
import math
# [/MANUAL_IMPORT]


class PatrolSM(Behavior):
    """
    Define Patrol.
    """

    def __init__(self, node):
        super().__init__()
        self.name = 'Patrol'

        # parameters of this behavior
        self.add_parameter('rounds', 2)
        self.add_parameter('speed', 0.5)
        self.add_parameter('is_loud', False)
        self.add_parameter('mode', 'slow')
        self.add_parameter('title', '')
        self.add_parameter('places', dict())

        # references to used behaviors
        OperatableStateMachine.initialize_ros(node)
        ConcurrencyContainer.initialize_ros(node)
        PriorityContainer.initialize_ros(node)
        Logger.initialize(node)
        CalculationState.initialize_ros(node)
        LogKeyState.initialize_ros(node)
        LogState.initialize_ros(node)
        WaitState.initialize_ros(node)
        self.add_behavior(GreetSM, 'Hello', node)
        self.add_behavior(GreetSM, 'Goodbye', node)

        # Additional initialization code can be added inside the following tags
        # [MANUAL_INIT]
        self.tau = 2 * math.pi
        # [/MANUAL_INIT]

        # Behavior comments:

    def create(self):
        # x:30 y:365, x:130 y:365
        _state_machine = OperatableStateMachine(outcomes=['finished', 'failed'], output_keys=['total'])
        _state_machine.userdata.total = 0
        _state_machine.userdata.who = 'operator'

        # Additional creation code can be added inside the following tags
        # [MANUAL_CREATE]
        values = [self.rounds, self.speed, self.is_loud, self.mode, self.title, self.places]
        # [/MANUAL_CREATE]
        # x:30 y:365, x:130 y:365, x:230 y:365
        _sm_both_0 = ConcurrencyContainer(outcomes=['finished'],
                                          conditions=[
                                              ('finished', [('Wait', 'done'), ('Say', 'done')])
                                          ])

        with _sm_both_0:
            # x:130 y:74
            OperatableStateMachine.add('Wait',
                                       WaitState(wait_time=0.01),
                                       transitions={'done': 'finished'},
                                       autonomy={'done': Autonomy.Off})

            # x:330 y:74
            OperatableStateMachine.add('Say',
                                       LogState(text="both", severity=Logger.REPORT_INFO),
                                       transitions={'done': 'finished'},
                                       autonomy={'done': Autonomy.Off})

        with _state_machine:
            # x:52 y:78
            OperatableStateMachine.add('Hello',
                                       self.use_behavior(GreetSM, 'Hello', default_keys=['mark']),
                                       transitions={'finished': 'Count'},
                                       autonomy={'finished': Autonomy.Inherit},
                                       remapping={'who': 'who'})

            # x:52 y:178
            OperatableStateMachine.add('Count',
                                       CalculationState(calculation=lambda total: total + self.rounds),
                                       transitions={'done': 'Report'},
                                       autonomy={'done': Autonomy.Off},
                                       remapping={'input_value': 'total', 'output_value': 'total'})

            # x:52 y:278
            OperatableStateMachine.add('Report',
                                       LogKeyState(text=str(values).replace('{', '{{').replace('}', '}}') + ' {}',
                                                   severity=Logger.REPORT_HINT),
                                       transitions={'done': 'Both'},
                                       autonomy={'done': Autonomy.Off},
                                       remapping={'data': 'total'})

            # x:52 y:378
            OperatableStateMachine.add('Both',
                                       _sm_both_0,
                                       transitions={'finished': 'Goodbye'},
                                       autonomy={'finished': Autonomy.Inherit})

            # x:52 y:478
            OperatableStateMachine.add('Goodbye',
                                       self.use_behavior(GreetSM, 'Goodbye', parameters={'word': 'Goodbye'}),
                                       transitions={'finished': 'finished'},
                                       autonomy={'finished': Autonomy.Inherit},
                                       remapping={'who': 'who', 'mark': 'total'})

            # x:652 y:478
            OperatableStateMachine.add('Forgotten',
                                       LogState(text="no way leads here", severity=Logger.REPORT_INFO),
                                       transitions={'done': 'failed'},
                                       autonomy={'done': Autonomy.Off, 'gone': Autonomy.Off})

        return _state_machine

    # Private functions can be added inside the following tags
    # [MANUAL_FUNC]

    # [/MANUAL_FUNC]
'''

GREET = '''
from flexbe_core import Autonomy, Behavior, EventState, Logger, OperatableStateMachine


class SayState(EventState):
    """
    Says a word.

    -- word     string  What to say
    ># who      string  To whom
    ># mark     string  How it ends
    <= done             It was said
    """

    def __init__(self, word):
        super(SayState, self).__init__(outcomes=['done'], input_keys=['who', 'mark'])
        self._word = word
        self._born = SayState._node.get_clock().now()

    def execute(self, userdata):
        Logger.loginfo('%s %s%s' % (self._word, userdata.who, userdata.mark))
        return 'done'


class GreetSM(Behavior):

    def __init__(self, node):
        super(GreetSM, self).__init__()
        self.name = 'Greet'
        self.add_parameter('word', 'Hello')
        self.add_parameter('title', '')
        self.add_parameter('times', 1)
        OperatableStateMachine.initialize_ros(node)
        SayState.initialize_ros(node)

    def create(self):
        _state_machine = OperatableStateMachine(outcomes=['finished'], input_keys=['who', 'mark'])
        _state_machine.userdata.who = 'nobody'
        _state_machine.userdata.mark = '!'
        with _state_machine:
            OperatableStateMachine.add('Say',
                                       SayState(word=self.title + self.word),
                                       transitions={'done': 'finished'},
                                       autonomy={'done': Autonomy.Off})
        return _state_machine
'''

TREES = """
from flexbe_core import Autonomy, Behavior, OperatableStateMachine
from flex_bt_flexbe_states.bt_execute_goal_state import BtExecuteGoalState
from flex_bt_flexbe_states.bt_execute_state import BtExecuteState
from flex_bt_flexbe_states.bt_get_data_state import BtGetDataState
from flex_bt_flexbe_states.bt_loader_state import BtLoaderState
from flex_bt_flexbe_states.bt_set_data_state import BtSetDataState


class TreesSM(Behavior):

    def __init__(self, node):
        super().__init__()
        self.name = 'Trees'
        for state in (BtExecuteGoalState, BtExecuteState, BtGetDataState, BtLoaderState, BtSetDataState):
            state.initialize_ros(node)

    def create(self):
        steps = [
            ('Load', BtLoaderState(bt_topic="bt_loader", filepaths=["{package}/config/plan.xml"], timeout=5.0), {}),
            ('Set', BtSetDataState(bt_topic="bt_set_data", goal_id="limit", goal_msg_type="double"),
             {'goal': 'limit'}),
            ('Plan', BtExecuteGoalState(bt_topic="bt_executor", bt_file="{package}/config/plan.xml", goal_id="goal",
                                        goal_msg_type="PoseStamped", request_id="path", request_msg_pkg="nav_msgs",
                                        request_msg_type="Path"), {'goal': 'goal', 'data': 'path'}),
            ('Get', BtGetDataState(bt_topic="bt_get_data", request_id="path", request_msg_pkg="nav_msgs",
                                   request_msg_type="Path"), {'data': 'path'}),
            ('Follow', BtExecuteState(bt_topic="bt_executor", bt_file="{package}/config/plan.xml"), {}),
        ]
        _state_machine = OperatableStateMachine(outcomes=['finished', 'failed', 'canceled'])
        _state_machine.userdata.limit = 0.5
        _state_machine.userdata.goal = None
        with _state_machine:
            for (label, state, remapping), following in zip(steps, [*(step[0] for step in steps[1:]), 'finished']):
                ways = {'done': following, 'failed': 'failed', 'canceled': 'canceled'}
                OperatableStateMachine.add(label, state,
                                           transitions={name: ways[name] for name in state.outcomes},
                                           autonomy={name: Autonomy.Off for name in state.outcomes},
                                           remapping=remapping)
        return _state_machine
"""

HOLD = """
from flexbe_core import Autonomy, Behavior, EventState, Logger, OperatableStateMachine
from flexbe_states.log_state import LogState


class HoldState(EventState):

    def __init__(self):
        super().__init__(outcomes=['done'])

    def on_enter(self, userdata):
        Logger.loginfo('holding')


class HoldSM(Behavior):

    def __init__(self, node):
        super().__init__()
        self.name = 'Hold'
        self.add_parameter('title', 'first')

    def create(self):
        machine = OperatableStateMachine(outcomes=['finished'])
        with machine:
            OperatableStateMachine.add('Hold', HoldState(), transitions={'done': 'Say'})
            OperatableStateMachine.add('Say', LogState(self.title, Logger.REPORT_INFO),
                                       transitions={'done': 'finished'})
        return machine
"""

MANIFEST = """<?xml version="1.0" encoding="UTF-8"?>

<behavior name="{name}">

    <executable package_path="{package}.{module}" class="{class_name}" />
    <tagstring>test</tagstring>
    <author>Somebody</author>
    <date>Sat Nov 21 2026</date>
    <description>
        Goes round.

        And greets.
    </description>

    <!-- Contained Behaviors -->
    <contains name="Greet" />

    <!-- Available Parameters -->
    {params}

</behavior>
"""

PARAMS = """<params>
        <param type="numeric" name="rounds" default="2" label="Rounds" hint="How often">
            <min value="1" />
            <max value="5" />
        </param>
        <param type="numeric" name="speed" default="0.5" label="Speed" hint="m/s" />
        <param type="boolean" name="is_loud" default="False" label="Loud" hint="" />
        <param type="enum" name="mode" default="slow" label="Mode" hint="">
            <option value="slow" />
            <option value="fast" />
        </param>
        <param type="text" name="title" default="" label="Title" hint="" />
        <param type="yaml" name="places" default="" label="Places" hint="">
            <key name="home" />
        </param>
    </params>"""


def manifest(package: str, name: str, module: str, class_name: str, params: str = '') -> str:
    """Return a manifest file."""
    return MANIFEST.format(package=package, name=name, module=module, class_name=class_name, params=params)


def write_package(prefix: Path, package: str, *, manifests: dict[str, str], sources: dict[str, str]) -> Path:
    """Install a package as FlexBE's are: manifests into lib, exported; gives the directory of its Python modules."""
    share = prefix / 'share' / package
    index = prefix / 'share' / 'ament_index' / 'resource_index' / 'packages'
    for directory in (share / 'config', index, prefix / 'lib' / package / 'manifest', prefix / 'python' / package):
        directory.mkdir(parents=True, exist_ok=True)
    (index / package).touch()
    (share / 'package.xml').write_text(
        f'<package format="3"><name>{package}</name><version>1.0.0</version>'
        '<export><flexbe_behaviors /><build_type>ament_cmake</build_type></export></package>'
    )
    for name, text in manifests.items():
        file = prefix / 'lib' / package / 'manifest' / name
        file.parent.mkdir(exist_ok=True)
        file.write_text(text)
    (prefix / 'python' / package / '__init__.py').touch()
    for name, text in sources.items():
        (prefix / 'python' / package / name).write_text(text.lstrip('\n'))
    return prefix / 'python'

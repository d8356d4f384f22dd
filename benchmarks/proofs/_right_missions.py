# SPDX-License-Identifier: BSD-3-Clause
"""Missions that are right, of many designs, with what their engineer requires of them."""

from __future__ import annotations

from typing import Final, NamedTuple

from flexbt_core.state_machine.model.event_state import EventState
from flexbt_states import BtExecuteState, OperatorDecisionState, WaitState


class Mission(NamedTuple):
    """A mission, as the text of its trees (XML) or of its machine (YAML), and requirements as they are written."""

    name: str
    text: str
    required: tuple[str, ...]


def _trees(name: str, body: str, *required: str) -> Mission:
    return Mission(name, f'<root BTCPP_format="4" main_tree_to_execute="Main">{body}</root>', required)


_GO: Final = (
    '<ComputePathToPose goal="{goal}" path="{path}" error_code_id="{compute_path_error_code}"/>'
    '<FollowPath path="{path}" error_code_id="{follow_path_error_code}"/>'
)
_PLANNED: Final = 'FollowPath only after ComputePathToPose > SUCCESS, each time anew'

TREES: Final = (
    _trees(
        'plan and follow',
        f'<BehaviorTree ID="Main"><Sequence>{_GO}</Sequence></BehaviorTree>',
        _PLANNED,
        '=SUCCESS only after FollowPath > SUCCESS',
        'ComputePathToPose has goal={goal}',
        'after ComputePathToPose > FAILURE, =FAILURE before the end',
    ),
    _trees(
        'recover and hear of a new goal',
        f"""<BehaviorTree ID="Main"><RecoveryNode number_of_retries="2" name="Reach">
          <Sequence>{_GO}</Sequence>
          <ReactiveFallback><GoalUpdated/><Sequence>
            <WouldAControllerRecoveryHelp error_code="{{follow_path_error_code}}"/>
            <ClearEntireCostmap name="ClearLocal" service_name="local_costmap/clear_entirely_local_costmap"/>
            <Wait wait_duration="2"/></Sequence></ReactiveFallback>
        </RecoveryNode></BehaviorTree>""",
        _PLANNED,
        'Wait works only while GoalUpdated fails',
        'ClearLocal works only while GoalUpdated fails',
        'ClearLocal only after WouldAControllerRecoveryHelp > SUCCESS',
        'Wait only after ClearLocal > SUCCESS',
        '=SUCCESS only after FollowPath > SUCCESS',
        'ComputePathToPose at most 3 times',
        'after Wait > FAILURE, =FAILURE before the end',
        'after ClearLocal > FAILURE, =FAILURE before the end',
        'Reach has number_of_retries=2',
    ),
    _trees(
        'patrol',
        """<BehaviorTree ID="Main"><Sequence>
          <SubTree ID="GoTo" name="gate" target="{gate}"/>
          <Spin name="look" spin_dist="6.28"/>
          <SubTree ID="GoTo" name="yard" target="{yard}"/>
          <SubTree ID="Report" name="report" text="{log}"/>
        </Sequence></BehaviorTree>
        <BehaviorTree ID="GoTo"><RetryUntilSuccessful num_attempts="3">
          <NavigateToPose name="drive" goal="{target}"/></RetryUntilSuccessful></BehaviorTree>
        <BehaviorTree ID="Report"><ForceSuccess><Wait name="tell" wait_duration="{text}"/></ForceSuccess>
        </BehaviorTree>""",
        'gate/drive has goal={gate}',
        'yard/drive has goal={yard}',
        'report/tell has wait_duration={log}',
        'look only after gate/drive > SUCCESS',
        'yard/drive only after look > SUCCESS',
        'report/tell only after yard/drive > SUCCESS',
        'after gate/drive > FAILURE, gate/drive before the end, up to 3 times',
        'after yard/drive > FAILURE, yard/drive before the end, up to 3 times',
        'after report/tell > FAILURE, =SUCCESS before the end',
        '=SUCCESS only after report/tell',
        'report/tell at most 1 time',
        'gate is a GoTo',
        'yard is a GoTo',
        'report is a Report',
    ),
    _trees(
        'drive while charged',
        f"""<BehaviorTree ID="Main"><Fallback>
          <ReactiveSequence name="charged">
            <Inverter><IsBatteryLow name="low" min_battery="0.2"/></Inverter>
            <SequenceWithMemory>{_GO}</SequenceWithMemory>
          </ReactiveSequence>
          <ReactiveSequence>
            <IsBatteryLow name="still_low" min_battery="0.2"/>
            <DockRobot name="dock" dock_id="home"/>
          </ReactiveSequence>
        </Fallback></BehaviorTree>""",
        'FollowPath works only while low fails',
        'ComputePathToPose works only while low fails',
        'dock works only while still_low holds',
        _PLANNED,
        'FollowPath never while dock',
        'dock has dock_id=home',
        'after dock > FAILURE, =FAILURE before the end',
        'after FollowPath > SUCCESS, =SUCCESS before the end',
        '=SUCCESS is always still possible',
    ),
    _trees(
        'dock and charge',
        """<BehaviorTree ID="Main"><Sequence>
          <Fallback><IsBatteryCharging name="docked"/>
            <RetryUntilSuccessful num_attempts="3"><DockRobot name="dock" dock_id="home"/></RetryUntilSuccessful>
          </Fallback>
          <Timeout msec="600000"><RetryUntilSuccessful num_attempts="-1"><Sequence>
            <Wait name="rest" wait_duration="10"/>
            <Inverter><IsBatteryLow name="low" min_battery="0.9"/></Inverter>
          </Sequence></RetryUntilSuccessful></Timeout>
          <UndockRobot name="undock"/>
        </Sequence></BehaviorTree>""",
        'dock only after docked > FAILURE',
        'after dock > FAILURE, dock before the end, up to 3 times',
        'dock at most 3 times',
        'rest only after docked',
        'undock only after low > FAILURE',
        'low only after rest > SUCCESS, each time anew',
        '=SUCCESS only after undock > SUCCESS',
        'after low > SUCCESS, rest before the end',
    ),
    _trees(
        'replan once a second',
        f"""<BehaviorTree ID="Main"><PipelineSequence>
          <RateController hz="1.0">{_GO.split('/>')[0]}/></RateController>
          {_GO.split('/>')[1]}/>
        </PipelineSequence></BehaviorTree>""",
        'FollowPath only after ComputePathToPose > SUCCESS',
        '=SUCCESS only after FollowPath > SUCCESS',
        'ComputePathToPose at most 2 times in 1 s',
        'after FollowPath > SUCCESS, =SUCCESS before the end',
        'RateController has hz=1',
    ),
    _trees(
        'two ways',
        """<BehaviorTree ID="Main"><Fallback name="ways">
          <Timeout msec="60000"><NavigateToPose name="direct" goal="{goal}"/></Timeout>
          <Sequence>
            <BackUp name="back" backup_dist="0.3" backup_speed="0.1"/>
            <NavigateToPose name="again" goal="{goal}"/>
          </Sequence>
        </Fallback></BehaviorTree>""",
        'direct at most 1 time',
        'back only after direct',
        'back at most 1 time',
        'again only after back > SUCCESS',
        'after direct > FAILURE, back before the end',
        'after direct > halted, back before the end',
        'after direct > SUCCESS, =SUCCESS before the end',
        'direct has goal={goal}',
        'again has goal={goal}',
        'Timeout has msec=60000',
        'after again > FAILURE, =FAILURE before the end',
    ),
    _trees(
        'choose by mode',
        """<BehaviorTree ID="Main"><Sequence>
          <Switch2 variable="{mode}" case_1="fetch" case_2="bring">
            <SubTree ID="Fetch" name="fetch" place="{shelf}"/>
            <SubTree ID="Bring" name="bring" place="{desk}"/>
            <AlwaysFailure name="neither"/>
          </Switch2>
          <Spin name="done" spin_dist="1.57"/>
        </Sequence></BehaviorTree>
        <BehaviorTree ID="Fetch"><NavigateToPose name="go" goal="{place}"/></BehaviorTree>
        <BehaviorTree ID="Bring"><Sequence><NavigateToPose name="go" goal="{place}"/>
          <Wait name="hand_over" wait_duration="3"/></Sequence></BehaviorTree>""",
        'fetch/go has goal={shelf}',
        'bring/go has goal={desk}',
        'fetch is a Fetch',
        'bring is a Bring',
        'bring/hand_over only after bring/go > SUCCESS',
        'after bring/go > SUCCESS, bring/hand_over before the end',
        'after fetch/go > SUCCESS, done before the end',
        'after bring/hand_over > SUCCESS, done before the end',
        'after fetch/go > FAILURE, =FAILURE before the end',
        'after bring/go > FAILURE, =FAILURE before the end',
        'after bring/hand_over > FAILURE, =FAILURE before the end',
        'after done > FAILURE, =FAILURE before the end',
        '=SUCCESS only after done > SUCCESS',
        'Switch2 has variable={mode} and case_1=fetch and case_2=bring',
        'fetch/go at most 1 time',
        'bring/go at most 1 time',
        'done at most 1 time',
    ),
    _trees(
        'select planner and controller',
        """<BehaviorTree ID="Main"><Sequence>
          <ControllerSelector selected_controller="{selected_controller}" default_controller="FollowPath"
            topic_name="controller_selector"/>
          <PlannerSelector selected_planner="{selected_planner}" default_planner="GridBased"
            topic_name="planner_selector"/>
          <ComputePathToPose goal="{goal}" path="{path}" planner_id="{selected_planner}"/>
          <SmoothPath unsmoothed_path="{path}" smoothed_path="{smooth}"/>
          <FollowPath path="{smooth}" controller_id="{selected_controller}"/>
        </Sequence></BehaviorTree>""",
        'FollowPath has path={smooth}',
        'SmoothPath only after ComputePathToPose > SUCCESS',
        'FollowPath only after SmoothPath > SUCCESS',
        '=SUCCESS only after FollowPath > SUCCESS',
        'ComputePathToPose only after PlannerSelector',
        'FollowPath only after ControllerSelector',
    ),
    _trees(
        'what is left of a tour',
        """<BehaviorTree ID="Main"><RetryUntilSuccessful num_attempts="3"><Sequence>
          <RemovePassedGoals input_goals="{goals}" output_goals="{goals}" radius="0.7"/>
          <ComputePathThroughPoses goals="{goals}" path="{path}"/>
          <TruncatePath distance="1.0" input_path="{path}" output_path="{short}"/>
          <FollowPath path="{short}"/>
          <Timeout msec="9000"><Sequence>
            <Wait name="settle" wait_duration="2"/><Spin name="look" spin_dist="1.57"/>
            <Delay delay_msec="3000"><Wait name="listen" wait_duration="1"/></Delay>
          </Sequence></Timeout>
        </Sequence></RetryUntilSuccessful></BehaviorTree>""",
        'RemovePassedGoals has input_goals={goals}',
        'ComputePathThroughPoses has goals={goals}',
        'ComputePathThroughPoses only after RemovePassedGoals > SUCCESS, each time anew',
        'ComputePathThroughPoses at most 3 times',
        'TruncatePath has input_path={path}',
        'TruncatePath only after ComputePathThroughPoses > SUCCESS, each time anew',
        'FollowPath has path={short}',
        'FollowPath only after TruncatePath > SUCCESS, each time anew',
        'settle only after FollowPath > SUCCESS, each time anew',
        'look only after settle > SUCCESS, each time anew',
        'listen only after look > SUCCESS, each time anew',
        'Timeout has msec=9000',
        '=SUCCESS only after listen > SUCCESS',
        'after look > FAILURE, RemovePassedGoals before the end, up to 3 times',
        'after listen > FAILURE, RemovePassedGoals before the end, up to 3 times',
    ),
    _trees(
        'wait for a pose, then go',
        """<BehaviorTree ID="Main"><Sequence>
          <Timeout msec="5000"><RetryUntilSuccessful num_attempts="-1"><Fallback>
            <InitialPoseReceived name="pose"/><ForceFailure><Wait name="pause" wait_duration="1"/></ForceFailure>
          </Fallback></RetryUntilSuccessful></Timeout>
          <Inverter><IsStuck name="stuck"/></Inverter>
          <NavigateThroughPoses name="tour" goals="{goals}"/>
        </Sequence></BehaviorTree>""",
        'tour only after pose > SUCCESS',
        'tour only after stuck > FAILURE',
        'after stuck > SUCCESS, =FAILURE before the end',
        'pause only after pose > FAILURE',
        '=SUCCESS only after tour > SUCCESS',
        'tour has goals={goals}',
        'Timeout has msec=5000',
        'tour at most 1 time',
        'stuck only after pose > SUCCESS',
    ),
)


# -- machines ----------------------------------------------------------------------------------------------------------


class Work(EventState):
    """Something that takes time and may fail."""

    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()

    def __init__(self, place: str = '') -> None:
        super().__init__(['done', 'failed'], self.inputs, self.outputs, desired_rate=None)
        self._place = place


class Find(Work):
    outputs = ('pose',)


class Drive(Work):
    inputs = ('goal',)


class Measure(Work):
    inputs = ('pose',)
    outputs = ('size',)


class Grasp(Work):
    inputs = ('pose', 'size')


class Tell(Work):
    inputs = ('text',)


STATES: Final = {
    **{one.__name__: one for one in (Work, Find, Drive, Measure, Grasp, Tell)},
    'BtExecuteState': BtExecuteState,
    'OperatorDecisionState': OperatorDecisionState,
    'WaitState': WaitState,
}

MACHINES: Final = (
    Mission(
        'find and grasp',
        """
machine:
  outcomes: [finished, failed]
  states:
    Find: {state: Find, transitions: {done: Measure, failed: AskWhere}}
    Measure: {state: Measure, transitions: {done: Grasp, failed: failed}}
    Grasp: {state: Grasp, transitions: {done: finished, failed: AskWhere}, autonomy: {failed: high}}
    AskWhere:
      state: OperatorDecisionState
      parameters: {outcomes: [again, give_up], hint: 'Where is it?'}
      transitions: {again: Find, give_up: failed}
      autonomy: {again: full, give_up: full}
""",
        (
            '/Grasp only after /Measure > done, each time anew',
            '/Measure only after /Find > done, each time anew',
            'after /Find > failed comes /AskWhere',
            'after /Grasp > failed comes /AskWhere',
            'after /Measure > failed comes =failed',
            'after /AskWhere > give_up comes =failed',
            'after /AskWhere > again comes /Find',
            '=finished only after /Grasp > done',
            '/Grasp > failed has autonomy=High',
            '/AskWhere > again has autonomy=Full',
            '/AskWhere > give_up has autonomy=Full',
            '/Find is a Find',
            '/Measure is a Measure',
            '/Grasp is a Grasp',
            '/Grasp has pose={pose} and size={size}',
        ),
    ),
    Mission(
        'look in a machine of its own',
        """
machine:
  outcomes: [finished, failed]
  userdata: {pose: none, goal: start}
  states:
    Look:
      machine:
        outcomes: [found, nothing]
        output_keys: [pose]
        states:
          Search: {state: Find, transitions: {done: found, failed: Turn}}
          Turn: {state: WaitState, parameters: {wait_time: 1.0}, transitions: {done: Again}}
          Again: {state: Find, transitions: {done: found, failed: nothing}}
      transitions: {found: Go, nothing: failed}
    Go: {state: Drive, remapping: {goal: pose}, transitions: {done: finished, failed: Look}, autonomy: {failed: low}}
""",
        (
            '/Go only after /Look > found, each time anew',
            'after /Look > nothing comes =failed',
            'after /Look/Search > failed comes /Look/Turn',
            'after /Go > failed comes /Look',
            '/Look > found only after /Look/Search',
            '/Look/Again only after /Look/Turn > done, each time anew',
            '=finished only after /Go > done',
            '/Go has goal={pose}',
            'after /Look/Search > done, /Go before the end',
            'after /Look/Again > done, /Go before the end',
            '/Go > failed has autonomy=Low',
            '/Look > nothing only after /Look/Again > failed, each time anew',
        ),
    ),
    Mission(
        'drive and watch',
        """
machine:
  outcomes: [finished, failed]
  userdata: {goal: yard, text: hello}
  states:
    Both:
      concurrency:
        outcomes: [arrived, failed, alarm]
        input_keys: [goal]
        conditions:
          - {outcome: arrived, when: {Drive: done}}
          - {outcome: failed, when: {Drive: failed}}
          - {outcome: alarm, when: {Watch: done}}
          - {outcome: failed, when: {Watch: failed}}
        states:
          Drive: {state: Drive}
          Watch: {state: Work, parameters: {place: yard}}
      transitions: {arrived: finished, failed: Tell, alarm: Tell}
      autonomy: {alarm: high}
    Tell: {state: Tell, transitions: {done: failed, failed: failed}}
""",
        (
            '=finished only after /Both/Drive > done',
            'after /Both > failed comes /Tell',
            'after /Both > alarm comes /Tell',
            'after /Both > arrived comes =finished',
            'after /Tell > done comes =failed',
            'after /Tell > failed comes =failed',
            '/Both > alarm only after /Both/Watch > done',
            '/Both > alarm has autonomy=High',
            'after /Both/Watch > failed, /Tell before the end',
            '/Both/Drive is a Drive',
            '/Tell is a Tell',
            '/Tell has text={text}',
            'after /Both/Drive > failed, /Tell before the end',
        ),
    ),
    Mission(
        'trees with recovery',
        """
machine:
  outcomes: [finished, failed]
  states:
    Drive:
      state: BtExecuteState
      parameters: {bt_file: flexbt_demo_behaviors/navigate/global_planner.xml}
      transitions: {done: finished, canceled: failed, failed: Recover}
      autonomy: {failed: low}
    Recover:
      state: BtExecuteState
      parameters: {bt_file: flexbt_demo_behaviors/navigate/recovery.xml, timeout: 120.0}
      transitions: {done: Drive, canceled: failed, failed: failed}
      autonomy: {failed: high}
""",
        (
            'after /Drive > failed comes /Recover',
            'after /Drive > canceled comes =failed',
            'after /Recover > done comes /Drive',
            'after /Recover > failed comes =failed',
            'after /Recover > canceled comes =failed',
            '=finished only after /Drive > done',
            '/Drive has tree=flexbt_demo_behaviors/navigate/global_planner.xml',
            '/Recover has tree=flexbt_demo_behaviors/navigate/recovery.xml',
            '/Drive > failed has autonomy=Low',
            '/Recover > failed has autonomy=High',
        ),
    ),
    Mission(
        'attempts, and who is told',
        """
machine:
  outcomes: [finished, failed]
  userdata: {goal: dock, text: docked, sorry: not docked}
  states:
    Dock:
      state: Drive
      retry: {attempts: 3, on: [failed]}
      transitions: {done: TellDone, failed: TellFailed}
      autonomy: {failed: low}
    TellDone: {state: Tell, transitions: {done: finished, failed: finished}}
    TellFailed: {state: Tell, remapping: {text: sorry}, transitions: {done: failed, failed: failed}}
""",
        (
            'after /Dock > done comes /TellDone',
            'after /Dock > failed comes /TellFailed',
            'after /TellDone > done comes =finished',
            'after /TellDone > failed comes =finished',
            'after /TellFailed > done comes =failed',
            'after /TellFailed > failed comes =failed',
            '/TellFailed has text={sorry}',
            '/TellDone has text={text}',
            '/Dock has goal={goal}',
            '/Dock > failed has autonomy=Low',
            '/TellDone is a Tell',
            '/TellFailed is a Tell',
            '/Dock has attempts=3',
        ),
    ),
)

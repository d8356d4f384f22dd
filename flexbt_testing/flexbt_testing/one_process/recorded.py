# SPDX-License-Identifier: BSD-3-Clause
"""Would a robot decide otherwise now? A recording feeds its executive and its BT server, in a world.

They get the operator's commands, the poses, and the results of the navigation servers, at the times at which they were
recorded. What they decide is compared with what was recorded. What a recording does not have is not fed: battery,
sensors, goals of other clients, topics of users' own nodes. A failure of navigation has the code UNKNOWN, or TF_ERROR
where the recorded tree found that a recovery would not help.
"""

from __future__ import annotations

import argparse
import bisect
import json
import math
import os
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from .world import World  # isort: skip - it prepares this interpreter

import numpy
import yaml

from flexbt_common import names
from flexbt_common.calls.goal_server import ServedGoal
from flexbt_common.errors import ResourceError
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.limits import deserialize
from flexbt_common.values.message_fields import seconds_of
from flexbt_console.errors import ConsoleError, UsageError
from flexbt_console.recording.run_file import read_run
from flexbt_console.recording.topics import check_definition, type_of
from flexbt_core.values.text import escape_lines, one_line
from flexbt_msgs.msg import CommandResult, ExecutiveCommand, ExecutiveEvent, ExecutiveStatus, TreeNode, TreeStatus
from flexbt_sim.messages import map_of, pose_of
from flexbt_sim.world import Pose

from .abstract_robot import AbstractRobot, run
from .programs import Program, robot_programs
from .scheduler import SCHEDULER, SECOND
from .what_if import Comparison, Course, Event, compare, executive_event, tree_event

TOLERANCE: Final = 1.0
"""Difference of times that counts as none, s: a world has no latencies, which add up on a robot."""

_DECISION_SECONDS: Final = 5.0
"""Time for which the answer to a decision waits for it, and a START for the end of the run before, s."""

_PLAN_NS: Final = 50_000_000
"""Time after a status of a tree within which a plan was received that was published before, ns."""

_LATER_CODE: Final = 2
"""What the codes TF_ERROR of navigation are more than UNKNOWN."""

_READ: Final = frozenset(
    {
        names.EXECUTIVE_STATUS,
        names.EXECUTIVE_EVENTS,
        names.EXECUTIVE_COMMAND,
        names.EXECUTIVE_STOP,
        names.TREE_STRUCTURE,
        names.TREE_STATUS,
        names.PLACES,
        names.MAP,
        names.POSE,
        names.PLAN,
    }
)
_HELPERS: Final = {
    'FollowPath': 'WouldAControllerRecoveryHelp',
    'ComputePathToPose': 'WouldAPlannerRecoveryHelp',
    'ComputePathThroughPoses': 'WouldAPlannerRecoveryHelp',
}
"""Leaves of Nav2 that fail for some codes of errors."""

_FED: Final = ('flexbt_server', 'flexbt_onboard')
_NOT_RECORDED: Final = ('enters ', 'asks ', 'started ', 'ended ')


@dataclass
class Answer:
    """How a navigation server has ended a goal: when it began, how long it took (s; without end, if it was halted)."""

    began: float = math.inf
    seconds: float = math.inf
    is_success: bool = False
    recovery_helps: bool = True
    path: Any = None
    is_used: bool = False


class Recording:
    """What a recording has for a world; times are from the first START on, s.

    Raises:
        UsageError: the file cannot be read, was recorded with other fields of the messages, or has no start of a run.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._by_topic: dict[str, list[tuple[int, Any]]] = defaultdict(list)
        for one in sorted(read_run(file), key=lambda one: one.time):
            if one.topic in _READ:
                check_definition(one.topic, one.type, one.definition, f'{file}: ')
                self._by_topic[one.topic].append((one.time, deserialize(one.data, type_of(one.topic))))
        statuses = self._by_topic[names.EXECUTIVE_STATUS]
        self._clock = [when for when, _ in statuses], [seconds_of(status.stamp) for _, status in statuses]
        given = {
            command.id: (when, command)
            for topic in (names.EXECUTIVE_COMMAND, names.EXECUTIVE_STOP)
            for when, command in reversed(self._by_topic[topic])
        }
        commands = sorted(given.values(), key=lambda one: one[0])
        starts = [when for when, command in commands if command.kind == ExecutiveCommand.START]
        if not starts or not statuses:
            raise UsageError(f'{file}: has no start of a behavior; begin to record before it')
        self._begin = float(numpy.interp(starts[0], *self._clock))
        self.asking = {decision.id: decision.path for _, status in statuses for decision in status.decisions}
        """The states that asked, by the identifiers of their decisions."""
        results = [result for _, status in statuses for result in status.results]
        self.applied = {result.command_id for result in results if result.code == CommandResult.APPLIED}
        self.commands = [(self._time(when), command) for when, command in commands if when >= starts[0]]
        self.poses = [(self._time(when), pose_of(message.pose)) for when, message in self._by_topic[names.POSE]]
        self.answers: dict[str, list[Answer]] = defaultdict(list)
        """By type of leaf, in the order in which they began."""
        self.lag = 0.0
        """How much later something happened on the robot, where calls take time, than in the world, s."""
        self.fed_since: int | None = None
        """Time of the world at which the first START was given, ns."""
        events = sorted([*self._executive_events(), *self._tree_events()], key=lambda event: event.time)
        last: Any = statuses[-1][1]
        states = ', '.join(one.path for one in last.active_states)
        end = last.outcome if last.state == ExecutiveStatus.IDLE else f'in {states}'
        self.course = Course([one for one in events if one.time >= -TOLERANCE], self._time(statuses[-1][0]), [end])

    def programs(self, folder: Path) -> list[Program]:
        """Return the programs of the world; ``folder`` is for the file of places."""
        if not self._by_topic[names.MAP] or not self.poses:
            raise UsageError(f'{self._file}: has no map or no poses; begin to record when the robot is ready')
        poses = {one.name: pose_of(one.pose.pose) for _, list in self._by_topic[names.PLACES] for one in list.places}
        known = {name: {'x': pose.x, 'y': pose.y, 'yaw': pose.yaw} for name, pose in poses.items()}
        file = folder / 'places.yaml'
        file.write_text(yaml.safe_dump(known))
        map = map_of(self._by_topic[names.MAP][-1][1])
        main = partial(run, RecordedRobot, recording=self, map=map, pose=self.poses[0][1], speed=1.0)
        fed = [one for one in robot_programs(str(file) if known else '') if one.package in _FED]
        real = [replace(one, parameters={**one.parameters, 'use_sim_time': False}) for one in fed]
        return [Program('', 'abstract_robot', main=main), *real]

    def answer(self, kind: str, now: float) -> Answer:
        """Return what a server has answered to a goal of about this time; without end, if there was none.

        A goal that was given more often than then, as to a planner each second, has the same success as the one before.
        """
        answers, then = self.answers[kind], now + self.lag
        place = bisect.bisect(answers, then - TOLERANCE, key=lambda one: one.began)
        following = next((one for one in answers[place:] if not one.is_used), Answer())
        if following.began > then + TOLERANCE:
            return answers[place - 1] if place and answers[place - 1].is_success else Answer()
        following.is_used = True
        self.lag = following.began - now
        return following

    def _time(self, received: int) -> float:
        """Return when something was received on the clock of the robot, which may be simulated."""
        return float(numpy.interp(received, *self._clock)) - self._begin

    def _executive_events(self) -> Iterator[Event]:
        for _, message in self._by_topic[names.EXECUTIVE_EVENTS]:
            for event in message.events:
                fields = {name: getattr(event, name) for name in ('path', 'outcome', 'reason', 'command')}
                fields['effect'] = 'applied' if event.applied else 'refused'
                kind = 'left' if event.kind == ExecutiveEvent.TRANSITION else 'command'
                yield Event(seconds_of(event.stamp) - self._begin, 'executive', executive_event(kind, fields))

    def _tree_events(self) -> Iterator[Event]:
        structures = {(one.run_id, one.number): one for _, one in self._by_topic[names.TREE_STRUCTURE]}
        running: dict[tuple[str, int], Answer] = {}
        failed: dict[str, Answer] = {}
        for received, status in self._by_topic[names.TREE_STATUS]:
            structure = structures.get((status.run_id, status.structure))
            if structure is None:
                continue
            for change in status.changes:
                node, now = structure.nodes[change.uid - 1], seconds_of(change.stamp) - self._begin
                kind, key = node.registration, (status.run_id, change.uid)
                if change.status == TreeStatus.RUNNING and node.kind == TreeNode.ACTION:
                    running[key] = Answer(now)
                    self.answers[kind].append(running[key])
                elif key in running:
                    answer = running.pop(key)
                    if change.status in (TreeStatus.SUCCESS, TreeStatus.FAILURE):
                        answer.seconds, answer.is_success = now - answer.began, change.status == TreeStatus.SUCCESS
                        answer.path = self._plan_before(received + _PLAN_NS)
                        failed[_HELPERS.get(kind, kind)] = answer
                elif kind in failed and change.status == TreeStatus.FAILURE:
                    failed[kind].recovery_helps = False
                if what := tree_event(structure, change):
                    yield Event(now, f'tree {structure.behavior_tree}', what, change.uid)

    def _plan_before(self, received: int) -> Any:
        plans = self._by_topic[names.PLAN]
        return next((plan for when, plan in reversed(plans) if when <= received), None)


class RecordedRobot(AbstractRobot):
    """A robot that is where it was, and whose navigation servers end their goals as they did."""

    def __init__(self, runtime: NodeRuntime, recording: Recording, **how: Any) -> None:
        self._recording = recording
        self._active: dict[str, tuple[ServedGoal, Answer, float]] = {}
        """By action: the latest goal, its answer, and when it is due."""
        super().__init__(runtime, **how)

    def _serve(self, name: str, kind: Any, _begin: Any) -> None:
        super()._serve(name, kind, partial(self._answer, kind))

    def _answer(self, kind: Any, goal: ServedGoal, result: Any) -> None:
        now = self._runtime.steady.now()
        before, answer, due = self._active.get(kind.__name__, (None, Answer(), math.inf))
        if before is not None and before.active:
            before.abort(kind.Result())  # as the servers of Nav2 do: the leaf goes on with the new goal
        elif not now < due < math.inf:  # else the leaf goes on after a pause
            answer = self._recording.answer(kind.__name__, self._fed_for())
            due = now + answer.seconds
        self._active[kind.__name__] = goal, answer, due
        if hasattr(result, 'path') and answer.path is not None:
            result.path = answer.path
        if not answer.is_success and hasattr(result, 'error_code'):
            unknown = getattr(goal.request, 'UNKNOWN', getattr(result, 'UNKNOWN', 0))  # Wait has no codes
            result.error_code = unknown + (0 if answer.recovery_helps else _LATER_CODE)

        def end() -> None:
            if goal.active:
                (goal.succeed if answer.is_success else goal.abort)(result)

        if due < math.inf:
            self._runtime.post_in(max(0.0, due - now), end)

    def _fed_for(self) -> float:
        since = self._recording.fed_since
        return 0.0 if since is None else (SCHEDULER.now - since) / SECOND

    def _now(self) -> Pose:
        place = bisect.bisect(self._recording.poses, self._fed_for(), key=lambda one: one[0])
        return self._recording.poses[max(0, place - 1)][1]


def decide_again(file: Path, swaps: Iterable[tuple[str, Path]] = (), tolerance: float = TOLERANCE) -> Comparison:
    """Feed a world with a recording, and compare what its executive and its trees decide with what was recorded.

    ``swaps`` are files that replace installed ones, as :meth:`World.swap` does.

    Raises:
        ConsoleError: the recording cannot be used.
        ResourceError, AssertionError: a file cannot be swapped.
    """
    recording = Recording(file)
    with (
        tempfile.TemporaryDirectory(prefix='flexbt_recorded_') as folder,
        World(0, recording.programs(Path(folder))) as world,
    ):
        for name, new in swaps:
            world.swap(name, new)
        begin, recording.fed_since = world.now, SCHEDULER.now
        course = world.course(partial(_feed, recording, begin))
    told = [one._replace(time=one.time - begin) for one in course.events if not one.what.startswith(_NOT_RECORDED)]
    fed = Course(list(_once(told)), course.end - begin, [course.ends[0].partition(';')[0], *course.ends[1:]])
    recorded = replace(recording.course, events=list(_once(recording.course.events)))
    return replace(compare(recorded, fed, tolerance), names=('recorded', 'now'))


def _feed(recording: Recording, begin: float, world: World) -> None:
    """Give the recorded commands at their times."""
    node = world.observer.node
    publisher = node.create_publisher(ExecutiveCommand, names.EXECUTIVE_COMMAND, names.command_qos())
    for time, command in recording.commands:
        world.run(max(0.0, begin + time - world.now))
        if command.decision_id:  # which no status has if it was answered at once
            path, until = recording.asking.get(command.decision_id), SCHEDULER.after(_DECISION_SECONDS)
            while not (asked := _asked(world, path)) and SCHEDULER.now < until:
                world.run(0.02)
            command.decision_id = asked[-1] if asked else command.decision_id
        elif command.kind == ExecutiveCommand.START and command.id in recording.applied:
            until = SCHEDULER.after(_DECISION_SECONDS)
            while world.view.running and SCHEDULER.now < until:  # the run before, which may end a little later
                world.run(0.02)
        snapshot = world.view.snapshot
        assert snapshot is not None
        if command.run_id:
            command.run_id = snapshot.run_id
        if command.executive_id:
            command.executive_id = snapshot.executive_id
        publisher.publish(command)
        recording.lag = 0.0
    world.run(max(0.0, begin + recording.course.end + TOLERANCE - world.now))


def _asked(world: World, path: str | None) -> list[str]:
    """Return the identifiers of the decisions that wait at a path, or anywhere for None."""
    return [one.id for one in world.view.decisions if path in (None, one.path)]


def _once(events: Iterable[Event]) -> Iterator[Event]:
    """Yield events without those of a tree that repeat one since an action has failed, or the tree has begun.

    How often leaves are repeated, such as the planner each second, or a condition at each tick, depends on latencies.
    """
    told: dict[str, set[tuple[int, str]]] = defaultdict(set)
    begins: dict[str, tuple[int, str]] = {}
    for event in events:
        change = event.node, event.what.rpartition(' ')[2]
        of_tree, is_of_tree = told[event.who], event.who.startswith('tree ')
        has_failed = change == (event.node, 'FAILURE') and (event.node, 'RUNNING') in of_tree
        if change == begins.setdefault(event.who, change) or has_failed:
            of_tree.clear()
        if not is_of_tree or change not in of_tree:
            yield event
        of_tree.add(change)


def _seconds(text: str) -> float:
    with suppress(ValueError):
        if 0.0 <= float(text) < math.inf:
            return float(text)
    raise argparse.ArgumentTypeError(f'{text!r} is not a number from 0 on')


def main(words: Sequence[str] | None = None) -> int:
    """Compare, and print. Return 0 without a difference, 1 with one, 2 for a recording or file of no use."""
    parser = argparse.ArgumentParser(prog='recorded', description=(__doc__ or '').split('\n\n')[0])
    parser.add_argument('file', type=Path, help='a recording (MCAP)')
    swap = 'use FILE in the place of the installed tree or behavior NAME (package/relative/path)'
    parser.add_argument('--swap', nargs=2, action='append', default=[], metavar=('NAME', 'FILE'), help=swap)
    about = 'difference of times that counts as none, s'
    parser.add_argument('--tolerance', type=_seconds, default=TOLERANCE, help=about)
    parser.add_argument('--json', action='store_true', help='print one line of JSON: whether they differ, and the text')
    given = parser.parse_args(words)
    os.environ.pop('ROS_AUTOMATIC_DISCOVERY_RANGE', None)  # it would separate the programs of the world, too
    try:
        found = decide_again(given.file, [(name, Path(file)) for name, file in given.swap], given.tolerance)
    except (ConsoleError, ResourceError, AssertionError, OSError) as error:
        print(one_line(f'recorded: {error}'), file=sys.stderr)
        return 2
    differs, text = found.difference is not None, '\n'.join(escape_lines(str(found)))
    print(json.dumps({'differs': differs, 'text': text}) if given.json else text)
    return int(differs)


if __name__ == '__main__':
    sys.exit(main())

# SPDX-License-Identifier: BSD-3-Clause
"""How many slips in real missions are found by what there is now, without the version before.

The trees of the demonstrations and of Nav2, and the machines that run them, each with one change of its text at a
random place: another control, a decorator that is missing or too many, another number, key, text or type, children that
are swapped, left out or there twice; a transition that leads elsewhere, outcomes that are exchanged, approvals that are
not needed any more, another key. Those after which the mission does what it did are no
slips: both are followed side by side. Each is looked at by ``check`` and by ``prove``, with what is required below. The
missions as they are must give no alarm.

Usage: python3 benchmarks proof_slips [--number N] [--seed N] [--only NAME]... [--show] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import copy
import random
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple
from xml.etree import ElementTree

from _figures import write_figures
from proof_missions import under_a_machine

from flexbt_core.behavior_tree.model.errors import TreeLoadError
from flexbt_core.behavior_tree.model.status import NodeKind
from flexbt_core.monitors.requirement_text import StatedRequirement, parse_requirement
from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.definition import MachineDefinition, StateDefinition
from flexbt_formal.exploration.explorer import ExplorationLimits
from flexbt_formal.exploration.machine_system import MachineBounds
from flexbt_formal.proofs.behavior_proof import Version, compare_behaviors, prove_behavior
from flexbt_formal.proofs.proof_cache import ProofCache
from flexbt_formal.proofs.tree_proof import compare_trees, prove_tree
from flexbt_server.node_types import node_registry
from flexbt_testing.behavior_trees.bt_tool import STOCK_TREES
from flexbt_tools.behaviors.built_behavior import build, installed, used_trees
from flexbt_tools.errors import RefusedError, UnfitError
from flexbt_tools.tree_checks.check import check_trees
from flexbt_tools.tree_checks.diagnostics import CheckSeverity
from flexbt_tools.trees.files import find_resource, read_library, roots
from flexbt_tools.trees.stand_ins import OpenRegistry

TARGET: Final = 0.95
REFUSALS: Final = (TreeLoadError, RefusedError, UnfitError)
SECONDS: Final = 30.0
"""CPU time for the proof of one, and for looking whether it does the same."""

DEMONSTRATED: Final = (
    *(
        f'flexbt_demo_behaviors/navigate/{name}.xml'
        for name in ('navigate', 'controller', 'global_planner', 'recovery')
    ),
    *(f'flexbt_demo_behaviors/night_watch/{name}.xml' for name in ('drive', 'charge', 'battery_low')),
)
MACHINES: Final = ('Navigate', 'Navigate Split', 'Night Watch')
UNDER: Final = ('navigate_to_pose_w_replanning_and_recovery', 'navigate_w_replanning_time')
"""Of Nav2's trees, those that the machine around them is tried with."""

Element = ElementTree.Element


# -- what is required -------------------------------------------------------------------------------------------------

_FOLLOWS: Final = (
    'FollowPath only after ComputePathToPose > SUCCESS',
    '=SUCCESS only after FollowPath > SUCCESS',
    'after FollowPath > SUCCESS, =SUCCESS before the end',
)
_RECOVERS: Final = (
    '=SUCCESS is always still possible',
    'ClearGlobalCostmap-Subtree only after ClearLocalCostmap-Subtree > SUCCESS, each time anew',
    'Spin only after ClearLocalCostmap-Subtree',
    'Wait only after Spin',
    'BackUp only after Wait',
)
_PARTS: Final = (
    'NavigateWithReplanning is a PipelineSequence',
    'ComputePathToPose has goal={goal} and path={path} and planner_id={selected_planner}',
    'FollowPath has path={path} and controller_id={selected_controller}',
    'ControllerSelector has selected_controller={selected_controller} and default_controller=FollowPath',
    'PlannerSelector has selected_planner={selected_planner} and default_planner=GridBased',
    'ControllerSelector has topic_name=controller_selector',
    'PlannerSelector has topic_name=planner_selector',
)
_RECOVERING: Final = (
    *_PARTS,
    'NavigateRecovery is a RecoveryNode',
    'NavigateRecovery has number_of_retries=6',
    'ComputePathToPose has number_of_retries=1',
    'RateController has hz=1.0',
    'RecoveryFallback is a ReactiveFallback',
    'RecoveryActions is a RoundRobin',
    'Spin has spin_dist=1.57',
    'Wait has wait_duration=5.0',
    'BackUp has backup_dist=0.30 and backup_speed=0.15',
    'ClearLocalCostmap-Subtree has service_name=local_costmap/clear_entirely_local_costmap',
    'ClearLocalCostmap-Context has service_name=local_costmap/clear_entirely_local_costmap',
    'ClearGlobalCostmap-Subtree has service_name=global_costmap/clear_entirely_global_costmap',
    'ClearGlobalCostmap-Context has service_name=global_costmap/clear_entirely_global_costmap',
    'WouldAPlannerRecoveryHelp has error_code={compute_path_error_code}',
    'WouldAControllerRecoveryHelp has error_code={follow_path_error_code}',
)
REQUIRED: Final[dict[str, tuple[str, ...]]] = {
    'navigate': (*_FOLLOWS, *_RECOVERS, *_RECOVERING),
    'navigate_to_pose_w_replanning_and_recovery': (*_FOLLOWS, *_RECOVERS, *_RECOVERING),
    'navigate_w_replanning_time': (*_FOLLOWS, *_PARTS, 'RateController has hz=1.0'),
    'navigate_w_replanning_distance': (*_FOLLOWS, *_PARTS, 'DistanceController has distance=1.0'),
    'navigate_w_replanning_speed': (
        *_FOLLOWS,
        *_PARTS,
        'SpeedController has min_rate=0.1 and max_rate=1.0 and min_speed=0.0 and max_speed=0.26',
    ),
    'navigate_w_replanning_only_if_goal_is_updated': (*_FOLLOWS, *_PARTS),
    'navigate_w_replanning_only_if_path_becomes_invalid': (*_FOLLOWS, *_PARTS, 'RateController has hz=1.0'),
    'odometry_calibration': (
        'Spin only after DriveOnHeading > SUCCESS, each time anew',
        'DriveOnHeading at most 12 times',
        '=SUCCESS only after Spin > SUCCESS, 12 times',
        'DriveOnHeading has dist_to_travel=2.0 and speed=0.2 and time_allowance=12',
        'Spin has spin_dist=1.570796 and is_recovery=false',
    ),
    'controller': ('=SUCCESS only after FollowPath > SUCCESS', 'FollowPath at most 2 times'),
    'global_planner': ('=SUCCESS only after ComputePathToPose > SUCCESS', 'ComputePathToPose at most 2 times'),
    'recovery': ('=SUCCESS only after BackUp > SUCCESS', 'Spin only after ClearGlobalCostmap > SUCCESS'),
    'drive': (*_FOLLOWS, '=SUCCESS is always still possible', 'Wait at most 4 times'),
    'charge': (
        '=SUCCESS only after WatchDrive/FollowPath > SUCCESS',
        '=SUCCESS only after IsBatteryLow > FAILURE',
    ),
    'battery_low': ('=SUCCESS only after IsBatteryLow > SUCCESS', 'IsBatteryLow at most 1 time in 0.9 s'),
    'Navigate Split': (
        '/FollowPath only after /JudgePath > done, each time anew',
        'after /FollowPath > failed comes /Recover',
        'after /PlanPath > failed comes /Recover',
        'after /Recover > failed comes =failed',
        'after /JudgePath > canceled comes /AskGoal',
        '/JudgePath > done has autonomy=High',
        '/JudgePath > canceled has autonomy=Full',
        '/Recover > failed has autonomy=High',
        '/PlanPath has goal={goal}',
        '/ShowPath has path={path}',
    ),
    'Night Watch': (
        '/Watch/Round/CompareScan only after /Watch/Round/GetScan > received, each time anew',
        'after /Watch/Round/JudgeFinding > alarm comes /Watch/Round/RaiseAlarm',
    ),
    'under a machine': (
        'after /Drive > failed comes /Recover',
        'after /Drive > canceled comes /Ask',
        'after /Recover > done comes /Drive',
        'after /Ask > enough comes =failed',
        'after /Ask > again comes /Drive',
        '=finished only after /Drive > done',
        '/Drive > failed has autonomy=Low',
        '/Drive has goal={goal}',
    ),
}


# -- changes of the text of a tree -------------------------------------------------------------------------------------

Change = Callable[[Element, int, random.Random, Element], bool]
_CONTROLS: Final = {
    'Sequence': ('Fallback', 'ReactiveSequence', 'Parallel'),
    'ReactiveSequence': ('Sequence', 'ReactiveFallback'),
    'Fallback': ('Sequence', 'ReactiveFallback'),
    'ReactiveFallback': ('Fallback', 'ReactiveSequence'),
    'PipelineSequence': ('Sequence', 'ReactiveSequence', 'Fallback'),
    'RecoveryNode': ('Sequence', 'Fallback'),
    'RoundRobin': ('Sequence', 'Fallback'),
    'SequenceWithMemory': ('Sequence', 'Fallback'),
}


def _control(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    node = parent[place]
    if node.tag not in _CONTROLS:
        return False
    node.tag = chance.choice(_CONTROLS[node.tag])
    node.attrib.pop('number_of_retries', None)
    return True


def _undecorated(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    if len(parent[place]) != 1:
        return False
    parent[place] = parent[place][0]
    return True


def _decorated(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    tag, attributes = chance.choice(
        [('Inverter', {}), ('ForceSuccess', {}), ('ForceFailure', {}), ('Repeat', {'num_cycles': '2'})]
    )
    around = Element(tag, attributes)
    around.append(parent[place])
    parent[place] = around
    return True


def _number(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    node = parent[place]
    names = [name for name, text in node.attrib.items() if text.replace('.', '', 1).lstrip('-').isdigit()]
    if not names:
        return False
    name = chance.choice(names)
    number = float(node.attrib[name])
    other = chance.choice([0.0, -1.0, number * 10.0, number / 10.0, number + 1.0])
    is_whole = '.' not in node.attrib[name]
    text = str(int(other)) if is_whole else f'{other:g}'
    if float(text) == number:
        return False
    node.set(name, text)
    return True


def _key(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    keys = sorted({text for node in root.iter() for text in node.attrib.values() if text.startswith('{')})
    names = [name for name, text in parent[place].attrib.items() if text.startswith('{')]
    if not names:
        return False
    name = chance.choice(names)
    old = parent[place].attrib[name]
    typed = '{' + old[2] + old[1] + old[3:]  # two letters exchanged
    parent[place].set(name, chance.choice([*(one for one in keys if one != old), typed]))
    return True


def _text(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    node = parent[place]
    names = [
        name
        for name, text in node.attrib.items()
        if name != 'name' and text[:1] not in '{' and not text.replace('.', '', 1).lstrip('-').isdigit()
    ]
    if not names:
        return False
    name = chance.choice(names)
    old = node.attrib[name]
    swapped = {'local': 'global', 'global': 'local', 'true': 'false', 'false': 'true', 'planner': 'controller'}
    other = next((old.replace(one, new) for one, new in swapped.items() if one in old), old[:-1])
    node.set(name, other)
    return other != old


def _type(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    node = parent[place]
    if len(node) or node.tag == 'SubTree':
        return False
    known = {one.id: one for one in _registry()}
    kind = known[node.tag].kind
    others = {one.tag for one in root.iter() if one.tag in known and known[one.tag].kind is kind}
    others |= {'Spin', 'Wait'} if kind is NodeKind.ACTION else {'GoalReached', 'IsStuck'}
    node.tag = chance.choice(sorted(others - {node.tag}))
    for name in node.attrib.keys() - known[node.tag].ports.keys() - {'name'}:
        del node.attrib[name]
    given = {name: text for one in root.iter(node.tag) if one is not node for name, text in one.attrib.items()}
    for name, text in given.items():  # as somebody copies it
        if name != 'name':
            node.attrib.setdefault(name, text)
    return True


def _swapped(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    if place + 1 >= len(parent):
        return False
    parent[place], parent[place + 1] = parent[place + 1], parent[place]
    return True


def _left_out(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    if len(parent) < 2:
        return False
    del parent[place]
    return True


def _twice(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    if len(parent) < 2:
        return False
    parent.insert(place, copy.deepcopy(parent[place]))
    return True


def _hoisted(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    """Return a node moves into the one before it."""
    if place == 0 or len(parent[place - 1]) < 2 or len(parent) < 3:
        return False
    node = parent[place]
    parent.remove(node)
    parent[place - 1].append(node)
    return True


OF_TREES: Final[dict[str, Change]] = {
    'another control': _control,
    'no decorator': _undecorated,
    'a decorator': _decorated,
    'number': _number,
    'key': _key,
    'text': _text,
    'type of a leaf': _type,
    'swapped': _swapped,
    'left out': _left_out,
    'there twice': _twice,
    'into the one before': _hoisted,
}


# -- changes of a machine ----------------------------------------------------------------------------------------------

Node = StateDefinition | MachineDefinition


def _with(machine: MachineDefinition, path: str, make: Callable[[Any], Any]) -> MachineDefinition:
    """Return the machine with another node at a path."""
    children = {
        label: make(child)
        if child.path == path
        else _with(child, path, make)
        if isinstance(child, MachineDefinition) and path.startswith(f'{child.path}/')
        else child
        for label, child in machine.children.items()
    }
    return replace(machine, children=children)


def _target(node: Node, labels: list[str], machine: MachineDefinition, chance: random.Random) -> Node | None:
    """Return a transition leads to another state."""
    ways = [outcome for outcome, way in node.transitions.items() if way.state is not None]
    if not ways or len(labels) < 3:
        return None
    outcome = chance.choice(ways)
    way = node.transitions[outcome]
    other = chance.choice([one for one in labels if one != way.state])
    return replace(node, transitions={**node.transitions, outcome: replace(way, state=other)})


def _exchanged(node: Node, labels: list[str], machine: MachineDefinition, chance: random.Random) -> Node | None:
    """Two outcomes lead where the other one did."""
    if len(node.transitions) < 2:
        return None
    one, other = chance.sample(sorted(node.transitions), 2)
    ways = node.transitions
    if (ways[one].state, ways[one].outcome) == (ways[other].state, ways[other].outcome):
        return None
    return replace(node, transitions={**ways, one: ways[other], other: ways[one]})


def _autonomy(node: Node, labels: list[str], machine: MachineDefinition, chance: random.Random) -> Node | None:
    """Let what needed an approval go without one."""
    ways = [outcome for outcome, way in node.transitions.items() if way.autonomy >= Autonomy.Low]
    if not ways:
        return None
    outcome = chance.choice(ways)
    way = replace(node.transitions[outcome], autonomy=Autonomy.Off)
    return replace(node, transitions={**node.transitions, outcome: way})


def _data(node: Node, labels: list[str], machine: MachineDefinition, chance: random.Random) -> Node | None:
    """Return a key of a state stands for another one of its machine."""
    if isinstance(node, MachineDefinition) or not node.state.input_keys:
        return None
    key = chance.choice(sorted(node.state.input_keys))
    others = {name for child in machine.children.values() for name in child.remap.values()} - {node.remap.get(key, key)}
    return replace(node, remap={**node.remap, key: chance.choice(sorted(others))}) if others else None


OF_MACHINES: Final = {
    'wrong target': _target,
    'outcomes exchanged': _exchanged,
    'no approval': _autonomy,
    'key of a state': _data,
}


# -- the missions ------------------------------------------------------------------------------------------------------


class Slip(NamedTuple):
    """A mission with a change: who finds it, whether it is refused (it cannot be loaded, or lacks what requirements are
    about), and whether the mission does what it did before."""

    text: str
    is_checked: bool = False
    is_proved: bool = False
    is_refused: bool = False
    is_alike: bool = False


@cache
def _registry() -> Any:
    return OpenRegistry(node_registry(lambda source, error: None))


class OfTree:
    """A file of trees, and what is required of it."""

    def __init__(self, file: Path, folder: Path) -> None:
        self.name = file.stem
        self._folder = folder
        self._text = file.read_text(encoding='utf-8')
        self._others = [str(file.parent / 'drive.xml')] if self.name == 'charge' else []
        self._required = _required(self.name)
        self._known = set(self._warnings(str(file)))
        self._sound = self._library(str(file))

    def kinds(self) -> list[str]:
        return list(OF_TREES)

    def alarms(self) -> list[str]:
        library, key = self._sound
        report = prove_tree(library, key, required=self._required, limits=ExplorationLimits(2 * SECONDS))
        return [f'{self.name}: {found.violation.text}' for found in report.counterexamples]

    def slip(self, kind: str, chance: random.Random) -> Slip | None:
        root = ElementTree.fromstring(self._text)  # noqa: S314 - of this computer
        places = [(parent, place) for parent in root.iter() for place in range(len(parent)) if parent.tag != 'root']
        chance.shuffle(places)
        if not any(OF_TREES[kind](parent, place, chance, root) for parent, place in places):
            return None
        text = ElementTree.tostring(root, encoding='unicode')
        file = self._folder / f'{self.name}.xml'
        file.write_text(text, encoding='utf-8')
        is_checked = not self._known.issuperset(self._warnings(str(file)))
        try:
            library, key = self._library(str(file))
            report = prove_tree(library, key, required=self._required, limits=ExplorationLimits(SECONDS))
        except REFUSALS:
            return Slip(text, is_checked, is_refused=True)
        is_proved = bool(report.counterexamples)
        is_found = is_checked or is_proved
        is_alike = (
            not is_found and compare_trees(self._sound, (library, key), limits=ExplorationLimits(SECONDS)).is_same
        )
        return Slip(text, is_checked, is_proved, is_alike=is_alike)

    def _library(self, file: str) -> Any:
        library = read_library([file, *self._others], _registry())
        return library, next(key for key in roots(library) if key.file == file)

    def _warnings(self, file: str) -> Iterator[tuple[str, str]]:
        for one in check_trees([file, *self._others], _registry()):
            if one.rule.severity is not CheckSeverity.INFO:
                yield one.rule.name, one.place.message


class OfMachine:
    """A machine with its trees, and what is required of it."""

    def __init__(self, name: str, machine: MachineDefinition, cache: ProofCache) -> None:
        self.name = name
        self._machine = machine
        self._cache = cache
        self._required = _required('under a machine' if name in UNDER else name)
        self._nodes = [(one, child) for one in machine.nodes() if isinstance(one, MachineDefinition)
                       for child in one.children.values()]  # fmt: skip

    def kinds(self) -> list[str]:
        return list(OF_MACHINES)

    def alarms(self) -> list[str]:
        return [f'{self.name}: {text}' for text in self._proved(self._machine)]

    def slip(self, kind: str, chance: random.Random) -> Slip | None:
        for machine, node in chance.sample(self._nodes, len(self._nodes)):
            other = OF_MACHINES[kind](node, list(machine.children), machine, chance)
            if other is None:
                continue
            changed = _with(self._machine, node.path, lambda _, other=other: other)  # type: ignore[misc]
            text = f'{node.path}: {other.transitions} {other.remap}'
            try:
                is_proved = bool(self._proved(changed))
            except REFUSALS:
                return Slip(text, is_refused=True)
            is_alike = not is_proved and kind != 'key of a state' and self._is_alike(changed)
            return Slip(text, is_proved=is_proved, is_alike=is_alike)
        return None

    def _proved(self, machine: MachineDefinition) -> list[str]:
        used = used_trees(machine, (), _registry())
        proof = prove_behavior(
            self.name, machine, used, MachineBounds(), ExplorationLimits(2 * SECONDS, 1_000_000),
            required=self._required, cache=self._cache,
        )  # fmt: skip
        return [found.violation.text for report in proof.reports for found in report.counterexamples]

    def _is_alike(self, machine: MachineDefinition) -> bool:
        before, now = (Version(one, used_trees(one, (), _registry())) for one in (self._machine, machine))
        limits = ExplorationLimits(SECONDS, 10_000)
        return compare_behaviors(self.name, before, now, MachineBounds(), limits)[-1].is_same


def _required(name: str) -> tuple[StatedRequirement, ...]:
    return tuple(parse_requirement(text, name) for text in REQUIRED.get(name, ()))


def missions(folder: Path) -> Iterator[OfTree | OfMachine]:
    """Yield all of them."""
    cache = ProofCache(folder / 'cache')
    for file in (*map(find_resource, DEMONSTRATED), *STOCK_TREES):
        yield OfTree(Path(file), folder)
    for entry in installed(MACHINES):
        machine = build(entry, []).machine
        assert machine is not None
        yield OfMachine(entry.name, machine, cache)
    for tree in STOCK_TREES:
        if tree.stem in UNDER:
            yield OfMachine(tree.stem, define(under_a_machine(str(tree))), cache)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--number', type=int, default=100, help='slips in all (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--only', action='append', default=[], help='only missions with this in their name; repeatable')
    parser.add_argument('--show', action='store_true', help='print those that were not found')
    parser.add_argument('--output', type=Path, default=Path('out/proof_slips.json'))
    options = parser.parse_args()
    chance = random.Random(options.seed)
    tried, checked, refused, found, alike = (Counter[str]() for _ in range(5))
    begin = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        known = [one for one in missions(Path(folder)) if any(part in one.name for part in options.only or [''])]
        alarms = []
        for one in known:
            alarms += one.alarms()
            print(f'{one.name}: as it is, {len(alarms)} alarms so far', flush=True)
        print(f'alarms about the missions as they are: {len(alarms)}', *alarms, sep='\n  ', flush=True)
        seen: set[tuple[str, str]] = set()
        for _ in range(50 * options.number):
            if tried.total() >= options.number:
                break
            mission = chance.choice(known)
            kind = chance.choice(mission.kinds())
            slip = mission.slip(kind, chance)
            if slip is None or (mission.name, slip.text) in seen:
                continue
            seen.add((mission.name, slip.text))
            if slip.is_alike:
                alike[kind] += 1
                continue
            tried[kind] += 1
            checked[kind] += slip.is_checked
            refused[kind] += slip.is_refused
            is_found = slip.is_checked or slip.is_proved or slip.is_refused
            found[kind] += is_found
            if options.show and not is_found:
                print(f'not found: {mission.name}: {kind}: {slip.text}', flush=True)
    seconds = time.process_time() - begin
    share = found.total() / max(1, tried.total())
    print(f'{"change":24} {"slips":>6} {"checked":>8} {"refused":>8} {"found":>6} {"no slip":>8}')
    for kind in (*OF_TREES, *OF_MACHINES):
        print(f'{kind:24} {tried[kind]:6} {checked[kind]:8} {refused[kind]:8} {found[kind]:6} {alike[kind]:8}')
    total = f'{tried.total():6} {checked.total():8} {refused.total():8} {found.total():6} {alike.total():8}'
    print(f'{"all":24} {total}  {share:.1%} (target {TARGET:.0%}), {seconds:.0f} s of CPU')
    counted = {'slips': tried, 'by check': checked, 'refused': refused, 'found': found, 'no slip': alike}
    figures = {name: dict(counter) for name, counter in counted.items()}
    write_figures(options.output, {**figures, 'share': share, 'CPU, s': seconds, 'false alarms': len(alarms)})
    return 0 if share >= TARGET and not alarms else 1


if __name__ == '__main__':
    sys.exit(main())

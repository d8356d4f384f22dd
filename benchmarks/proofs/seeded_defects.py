# SPDX-License-Identifier: BSD-3-Clause
"""How many seeded defects check and proof find in right missions, without the version before.

The missions are trees and machines of several designs, each with what its engineer requires of it. A defect is one
change at a random place: children that are swapped, another control, a node or state that is left out, keys that are
crossed, a wrong remapping, sub-tree, tree or transition, an attempt, decorator, output key, approval or condition that
is missing, a key that nothing writes, an output that nobody gets, a time limit that is too short. What makes no
difference is no defect: both versions are followed side by side, with all inputs, and those that do the same are left
out.

Right variants must give no alarm: the missions, Nav2's small trees, and the missions written otherwise. Such a rewrite
is drawn at random, too, and taken when both versions do the same.

Usage: python3 benchmarks seeded_defects [--number N] [--variants N] [--seed N] [--show] [--save FILE] [--load FILE]
"""

from __future__ import annotations

import argparse
import copy
import json
import random
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

import yaml
from _figures import write_figures
from _right_missions import MACHINES, STATES, TREES, Mission

from flexbt_core.behavior_tree.model.errors import TreeLoadError
from flexbt_core.monitors.requirement_text import (
    RequirementError,
    StatedRequirement,
    machine_vocabulary,
    parse_requirement,
    problems_with,
)
from flexbt_core.state_machine.authoring.yaml_form import read_machine
from flexbt_core.state_machine.model.definition import MachineDefinition
from flexbt_core.state_machine.model.userdata import MachineError
from flexbt_formal.exploration.explorer import ExplorationLimits
from flexbt_formal.exploration.machine_system import MachineBounds
from flexbt_formal.proofs.behavior_proof import Version, compare_behaviors, prove_behavior
from flexbt_formal.proofs.tree_proof import compare_trees, prove_tree
from flexbt_server.node_types import node_registry
from flexbt_testing.behavior_trees.bt_tool import STOCK_TREES
from flexbt_tools.behaviors.built_behavior import BuiltBehavior, used_trees
from flexbt_tools.behaviors.check import check_behavior
from flexbt_tools.errors import RefusedError, UnfitError
from flexbt_tools.tree_checks.check import check_trees
from flexbt_tools.tree_checks.diagnostics import CheckSeverity
from flexbt_tools.trees.files import read_library, roots
from flexbt_tools.trees.stand_ins import OpenRegistry

TARGET: Final = 0.95
SECONDS: Final = 20.0
"""Of processor time for one proof, or one comparison."""
LARGE: Final = ('recovery', 'path_becomes_invalid')
"""In the names of Nav2's trees that take longer than that."""

Element = ElementTree.Element


@cache
def _registry() -> Any:
    return OpenRegistry(node_registry(lambda source, error: None))


# -- defects of trees --------------------------------------------------------------------------------------------------

Change = Callable[[Element, int, random.Random, Element], bool]
"""Changes the child at a place, if that can be; of the whole document, which is last."""

_CONTROLS: Final = {
    'Sequence': ('Fallback', 'Parallel'),
    'Fallback': ('Sequence',),
    'PipelineSequence': ('Sequence', 'Fallback'),
    'ReactiveSequence': ('ReactiveFallback',),
    'ReactiveFallback': ('ReactiveSequence',),
    'SequenceWithMemory': ('Fallback',),
}
_MEMORY: Final = {'ReactiveSequence': 'Sequence', 'ReactiveFallback': 'Fallback', 'PipelineSequence': 'Sequence'}
_ATTEMPTS: Final = ('RetryUntilSuccessful', 'RecoveryNode')
_DECORATORS: Final = ('Timeout', 'RateController', 'ForceSuccess', 'ForceFailure')


def _swapped(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    if place + 1 >= len(parent) or parent.tag == 'root':
        return False
    parent[place], parent[place + 1] = parent[place + 1], parent[place]
    return True


def _control(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    others = _CONTROLS.get(parent[place].tag)
    if others is None:
        return False
    parent[place].tag = chance.choice(others)
    return True


def _lost_halt(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    other = _MEMORY.get(parent[place].tag)
    if other is None:
        return False
    parent[place].tag = other
    return True


def _removed(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    if len(parent) < 2 or parent.tag == 'root':
        return False
    del parent[place]
    return True


def _crossed(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    """Return a port gets the key of another one, which gets that of the first."""
    node = parent[place]
    given = [(one, name) for one in root.iter() for name, text in one.attrib.items() if text.startswith('{')]
    own = [name for one, name in given if one is node]
    if not own:
        return False
    name = chance.choice(own)
    others = [(one, other) for one, other in given if one.attrib[other] != node.attrib[name]]
    if not others:
        return False
    other, port = chance.choice(others)
    node.attrib[name], other.attrib[port] = other.attrib[port], node.attrib[name]
    return True


def _remapped(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    """Return a key is another one, or has two letters exchanged; or a sub-tree is not given it."""
    node = parent[place]
    names = [name for name, text in node.attrib.items() if text.startswith('{')]
    if not names:
        return False
    name = chance.choice(names)
    old = node.attrib[name]
    keys = {text for one in root.iter() for text in one.attrib.values() if text.startswith('{')} - {old}
    ways = [*sorted(keys), '{' + old[2] + old[1] + old[3:]] + ([''] if node.tag == 'SubTree' else [])
    way = chance.choice(ways)
    if way:
        node.set(name, way)
    else:
        del node.attrib[name]
    return way != old


def _unwrapped(*tags: str) -> Change:
    def change(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
        if parent[place].tag not in tags:
            return False
        parent[place] = parent[place][0]
        return True

    return change


def _wrong_sub_tree(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    others = [one.get('ID', '') for one in root.iter('BehaviorTree') if one.get('ID') not in ('Main', None)]
    others = [one for one in others if one != parent[place].get('ID')]
    if parent[place].tag != 'SubTree' or not others:
        return False
    parent[place].set('ID', chance.choice(others))
    return True


def _inverted(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    node = parent[place]
    if node.tag == 'Inverter':
        parent[place] = node[0]
        return True
    if len(node) or not node.tag.startswith(('Is', 'Would', 'Goal', 'InitialPose')):
        return False
    parent[place] = Element('Inverter')
    parent[place].append(node)
    return True


def _forgiven(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    if parent.tag == 'root':
        return False
    node, parent[place] = parent[place], Element('ForceSuccess')
    parent[place].append(node)
    return True


def _unwritten(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    """Return an input is read from a key that nothing writes."""
    names = _given(parent[place], readable=True)
    if not names:
        return False
    parent[place].set(chance.choice(names), '{wanted}')
    return True


def _lost_output(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    """Return what a node makes goes to a key that nothing reads."""
    names = [name for name in _given(parent[place], readable=False) if not name.startswith('error_')]
    if not names:
        return False
    parent[place].set(chance.choice(names), '{spare}')
    return True


def _given(node: Element, *, readable: bool) -> list[str]:
    """Return the ports of a leaf that point to keys, and are read, or only written."""
    manifest = _registry().get(node.tag)
    ports = manifest.ports if not len(node) and node.tag != 'SubTree' else {}
    return [
        name
        for name, text in node.attrib.items()
        if text.startswith('{') and name in ports and ports[name].readable is readable
    ]


def _short_limit(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    """Return a time limit is in another unit: seconds for milliseconds."""
    node = parent[place]
    if node.tag != 'Timeout' or int(node.get('msec', '0')) < 1000:
        return False
    node.set('msec', str(int(node.get('msec', '0')) // 1000))
    return True


OF_TREES: Final[dict[str, Change]] = {
    'swapped children': _swapped,
    'changed control': _control,
    'lost halt': _lost_halt,
    'removed node': _removed,
    'crossed keys': _crossed,
    'wrong remapping': _remapped,
    'dropped attempts': _unwrapped(*_ATTEMPTS),
    'dropped decorator': _unwrapped(*_DECORATORS),
    'wrong sub-tree': _wrong_sub_tree,
    'inverted condition': _inverted,
    'forgiven failure': _forgiven,
    'unwritten key': _unwritten,
    'lost output': _lost_output,
    'short time limit': _short_limit,
}


# -- defects of machines -----------------------------------------------------------------------------------------------


class _Names(yaml.SafeLoader):
    """Takes `on` and `off` as names, as the files of machines have them."""

    yaml_implicit_resolvers = {
        first: [one for one in resolvers if one[0] != 'tag:yaml.org,2002:bool']
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }


Node = dict[str, Any]
"""A machine or state as YAML has it."""
_DEMONSTRATED: Final = ('global_planner', 'controller', 'recovery')


def _inner(node: Node) -> Node | None:
    return next((node[kind] for kind in ('machine', 'concurrency', 'priority') if kind in node), None)


def _states(machine: Node) -> Iterator[tuple[Node, str]]:
    """Yield all states and machines in a machine: what they are in, and their label."""
    for label, state in machine['states'].items():
        yield machine, label
        if (inner := _inner(state)) is not None:
            yield from _states(inner)


def _target(machine: Node, label: str, chance: random.Random) -> bool:
    state = machine['states'][label]
    ways = state.get('transitions')
    if not ways:
        return False
    outcome = chance.choice(sorted(ways))
    others = [one for one in (*machine['states'], *machine['outcomes']) if one != ways[outcome]]
    ways[outcome] = chance.choice(others)
    return True


def _exchanged(machine: Node, label: str, chance: random.Random) -> bool:
    ways = machine['states'][label].get('transitions') or {}
    if len(ways) < 2:
        return False
    one, other = chance.sample(sorted(ways), 2)
    ways[one], ways[other] = ways[other], ways[one]
    return True


def _autonomy(machine: Node, label: str, chance: random.Random) -> bool:
    levels = machine['states'][label].get('autonomy')
    if not levels:
        return False
    outcome = chance.choice(sorted(levels))
    levels[outcome] = chance.choice([one for one in ('off', 'low', 'high', 'full') if one != levels[outcome]])
    return True


def _output_key(machine: Node, label: str, chance: random.Random) -> bool:
    inner = _inner(machine['states'][label])
    return inner is not None and bool(inner.pop('output_keys', None))


def _remapping(machine: Node, label: str, chance: random.Random) -> bool:
    state = machine['states'][label]
    keys = state.get('remapping') or {key: key for key in getattr(STATES.get(state.get('state', '')), 'inputs', ())}
    known = {'pose', 'goal', 'text', *keys.values()}
    if not keys:
        return False
    key = chance.choice(sorted(keys))
    state['remapping'] = {**keys, key: chance.choice(sorted(known - {keys[key]}))}
    return True


def _attempts(machine: Node, label: str, chance: random.Random) -> bool:
    return machine['states'][label].pop('retry', None) is not None


def _condition(machine: Node, label: str, chance: random.Random) -> bool:
    inner = _inner(machine['states'][label])
    if inner is None or 'conditions' not in inner:
        return False
    inner['conditions'].pop(chance.randrange(len(inner['conditions'])))
    return True


def _wrong_tree(machine: Node, label: str, chance: random.Random) -> bool:
    given = machine['states'][label].get('parameters', {})
    if 'bt_file' not in given:
        return False
    files = [f'flexbt_demo_behaviors/navigate/{name}.xml' for name in _DEMONSTRATED]
    given['bt_file'] = chance.choice([one for one in files if one != given['bt_file']])
    return True


def _without_state(machine: Node, label: str, chance: random.Random) -> bool:
    """Leave a state out: what led to it leads to where its first outcome led."""
    states = machine['states']
    if len(states) < 2 or next(iter(states)) == label or not (ways := states[label].get('transitions')):
        return False
    target = next(iter(ways.values()))
    del states[label]
    for state in states.values():
        state['transitions'] = {one: target if to == label else to for one, to in state['transitions'].items()}
    return target != label


def _state_type(machine: Node, label: str, chance: random.Random) -> bool:
    state = machine['states'][label]
    kinds = [name for name in STATES if name[0].isupper() and issubclass(STATES[name], STATES['Work'])]
    if state.get('state') not in kinds:
        return False
    state['state'] = chance.choice([one for one in kinds if one != state['state']])
    return True


def _short_time(machine: Node, label: str, chance: random.Random) -> bool:
    """Return a tree is given up before it can be done."""
    given = machine['states'][label].get('parameters', {})
    if 'timeout' not in given:
        return False
    given['timeout'] = given['timeout'] / 1000.0
    return True


OF_MACHINES: Final[dict[str, Callable[[Node, str, random.Random], bool]]] = {
    'wrong transition': _target,
    'exchanged outcomes': _exchanged,
    'wrong autonomy': _autonomy,
    'missing output key': _output_key,
    'wrong remapping of a state': _remapping,
    'dropped attempts of a state': _attempts,
    'missing condition': _condition,
    'wrong tree': _wrong_tree,
    'left out state': _without_state,
    'wrong state': _state_type,
    'short time': _short_time,
}


# -- rewrites ----------------------------------------------------------------------------------------------------------


def _wrapped(*tags: tuple[str, dict[str, str]]) -> Change:
    def change(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
        if parent.tag == 'root':
            return False
        for tag, attributes in tags:
            node, parent[place] = parent[place], Element(tag, attributes)
            parent[place].append(node)
        return True

    return change


def _digits(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    node = parent[place]
    names = [name for name, text in node.attrib.items() if text.replace('.', '', 1).isdigit() and '.' in text]
    for name in names:
        node.attrib[name] += '0'
    return bool(names)


def _named(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    if 'name' in parent[place].attrib or parent[place].tag not in _CONTROLS:
        return False
    parent[place].set('name', f'part {chance.randrange(1000)}')
    return True


def _shuffled(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    node = parent[place]
    items = list(node.attrib.items())
    chance.shuffle(items)
    node.attrib.clear()
    node.attrib.update(items)
    return len(items) > 1


def _grouped(parent: Element, place: int, chance: random.Random, root: Element) -> bool:
    """Children of a sequence, or of a fallback, are in one of the same kind of their own."""
    if parent.tag not in ('Sequence', 'Fallback', 'ReactiveSequence') or place + 2 > len(parent) or len(parent) < 3:
        return False
    group = Element(parent.tag)
    for node in list(parent)[place : place + 2]:
        parent.remove(node)
        group.append(node)
    parent.insert(place, group)
    return True


REWRITES: Final[dict[str, Change]] = {
    'a sequence of one': _wrapped(('Sequence', {})),
    'a fallback of one': _wrapped(('Fallback', {})),
    'inverted twice': _wrapped(('Inverter', {}), ('Inverter', {})),
    'one attempt': _wrapped(('RetryUntilSuccessful', {'num_attempts': '1'})),
    'done once': _wrapped(('Repeat', {'num_cycles': '1'})),
    'digits': _digits,
    'names of controls': _named,
    'order of attributes': _shuffled,
    'grouped': _grouped,
    'another control': _control,
    'swapped': _swapped,
}


def _order(machine: Node, label: str, chance: random.Random) -> bool:
    states = machine['states']
    first, *others = states
    chance.shuffle(others)
    machine['states'] = {one: states[one] for one in (first, *others)}
    return len(others) > 1


def _explicit(machine: Node, label: str, chance: random.Random) -> bool:
    state = machine['states'][label]
    keys = getattr(STATES.get(state.get('state', '')), 'inputs', ())
    if not keys or 'remapping' in state:
        return False
    state['remapping'] = {key: key for key in keys}
    return True


def _conditions(machine: Node, label: str, chance: random.Random) -> bool:
    inner = _inner(machine['states'][label])
    if inner is None or 'conditions' not in inner:
        return False
    chance.shuffle(inner['conditions'])
    return True


REWRITES_OF_MACHINES: Final[dict[str, Callable[[Node, str, random.Random], bool]]] = {
    'order of states': _order,
    'keys told': _explicit,
    'order of conditions': _conditions,
    'exchanged outcomes': _exchanged,
}


# -- what is found -----------------------------------------------------------------------------------------------------


class OfTree:
    """A mission of trees."""

    changes: dict[str, Any] = OF_TREES
    rewrites: dict[str, Any] = REWRITES

    def __init__(self, mission: Mission, folder: Path) -> None:
        self.mission = mission
        self._file = folder / 'main.xml'
        self._required: tuple[StatedRequirement, ...] = ()
        self._known = set(self._warnings(mission.text))
        self._sound = self._library(mission.text)
        self._required, self.left_out = _fit(mission, lambda one: prove_tree(*self._sound, required=one))

    def changed(self, change: Change, chance: random.Random) -> str:
        """Return the text with a change at a random place; '' when there is none for it."""
        root = ElementTree.fromstring(self.mission.text)  # noqa: S314 - of this program
        places = [(parent, place) for parent in root.iter() for place in range(len(parent))]
        chance.shuffle(places)
        if not any(change(parent, place, chance, root) for parent, place in places):
            return ''
        return ElementTree.tostring(root, encoding='unicode')

    def found(self, text: str) -> str:
        """Return the name of the tool that finds something wrong; '' for none."""
        if not self._known.issuperset(self._warnings(text)):
            return 'check'
        try:
            report = prove_tree(*self._library(text), required=self._required, limits=ExplorationLimits(SECONDS))
        except (TreeLoadError, RefusedError, UnfitError):
            return 'refused'
        return 'prove' if report.counterexamples else ''

    def is_alike(self, text: str) -> bool:
        """Return whether it does the same as the mission, followed to the end."""
        found = compare_trees(self._sound, self._library(text), limits=ExplorationLimits(SECONDS)).comparison
        return found.is_same and found.is_complete

    def _library(self, text: str) -> Any:
        self._file.write_text(text, encoding='utf-8')
        library = read_library([str(self._file)], _registry())
        return library, roots(library)[0]

    def _warnings(self, text: str) -> Iterator[tuple[str, str]]:
        self._file.write_text(text, encoding='utf-8')
        keys = ('goal', 'goals', 'gate', 'yard', 'log', 'mode', 'shelf', 'desk')
        for one in check_trees([str(self._file)], _registry(), keys):
            if one.rule.severity is not CheckSeverity.INFO:
                yield one.rule.name, one.place.message


class OfMachine:
    """A mission of a machine."""

    changes: dict[str, Any] = OF_MACHINES
    rewrites: dict[str, Any] = REWRITES_OF_MACHINES

    def __init__(self, mission: Mission, folder: Path) -> None:
        self.mission = mission
        self._required: tuple[StatedRequirement, ...] = ()
        self._sound = read_machine(mission.text, STATES)
        self._known = set(self._warnings(self._sound))
        vocabulary = machine_vocabulary(self._sound)
        self._required, self.left_out = _fit(mission, lambda one: _raise(problems_with(one, vocabulary, mission.name)))

    def changed(self, change: Callable[[Node, str, random.Random], bool], chance: random.Random) -> str:
        """Return the text with a change at a random place; '' when there is none for it."""
        root = yaml.load(self.mission.text, _Names)  # noqa: S506 - a safe one
        places = list(_states(root['machine']))
        chance.shuffle(places)
        before = copy.deepcopy(root)
        if not any(change(machine, label, chance) for machine, label in places) or root == before:
            return ''
        return yaml.safe_dump(root, sort_keys=False)

    def found(self, text: str) -> str:
        """Return the name of the tool that finds something wrong; '' for none."""
        try:
            machine = read_machine(text, STATES)
        except MachineError:
            return 'refused'
        if not self._known.issuperset(self._warnings(machine)):
            return 'check'
        try:
            proof = prove_behavior(
                self.mission.name, machine, used_trees(machine, (), _registry()), MachineBounds(),
                ExplorationLimits(SECONDS, 100_000), required=self._required,
            )  # fmt: skip
        except (TreeLoadError, RefusedError, UnfitError):
            return 'refused'
        return 'prove' if any(report.counterexamples for report in proof.reports) else ''

    def is_alike(self, text: str) -> bool:
        """Return whether it does the same as the mission, followed to the end."""
        before, now = (
            Version(one, used_trees(one, (), _registry())) for one in (self._sound, read_machine(text, STATES))
        )
        found = compare_behaviors(self.mission.name, before, now, MachineBounds(), ExplorationLimits(SECONDS, 20_000))
        return all(one.is_same and one.comparison.is_complete for one in found)

    def _warnings(self, machine: MachineDefinition) -> Iterator[tuple[str, str]]:
        for one in check_behavior(BuiltBehavior(self.mission.name, machine), (), _registry()):
            if one.rule.severity is not CheckSeverity.INFO:
                yield one.rule.name, one.message


def _raise(problems: list[str]) -> None:
    if problems:
        raise UnfitError('\n'.join(problems))


def _fit(
    mission: Mission, use: Callable[[tuple[StatedRequirement, ...]], object]
) -> tuple[tuple[StatedRequirement, ...], int]:
    """Return the requirements that can be said of the mission as it is, and how many cannot."""
    found = []
    for text in mission.required:
        try:
            stated = parse_requirement(text, mission.name)
            use((stated,))
            found.append(stated)
        except (RequirementError, UnfitError) as error:
            print(f'{mission.name}: {error}', file=sys.stderr)
    return tuple(found), len(mission.required) - len(found)


# -- the benchmark -----------------------------------------------------------------------------------------------------


def defects(missions: list[Any], number: int, chance: random.Random) -> Iterator[tuple[str, str, str, str]]:
    """Mission, kind of the change, text, and who finds it; without what does the same as before."""
    known: set[str] = set()
    kinds = list(dict.fromkeys(kind for one in missions for kind in one.changes))
    given = 0
    for _ in range(100 * number):
        if given >= number:
            return
        kind = chance.choice(kinds)
        mission = chance.choice([one for one in missions if kind in one.changes])
        text = mission.changed(mission.changes[kind], chance)
        if not text or text in known:
            continue
        known.add(text)
        finder = mission.found(text)
        if not finder and mission.is_alike(text):
            continue
        given += 1
        yield mission.mission.name, kind, text, finder


def variants(missions: list[Any], number: int, chance: random.Random) -> Iterator[tuple[str, str, str]]:
    """Mission, kind of the rewrite, and what is said to be wrong with it, which is right."""
    for mission in missions:
        yield mission.mission.name, 'as it is', mission.found(mission.mission.text)
    given, known = len(missions), {mission.mission.text for mission in missions}
    kinds = [(one, kind) for one in missions for kind in one.rewrites]
    for _ in range(100 * number):
        if given >= number:
            return
        mission, kind = chance.choice(kinds)
        text = mission.changed(mission.rewrites[kind], chance)
        if not text or text in known:
            continue
        known.add(text)
        try:
            if not mission.is_alike(text):
                continue
        except (TreeLoadError, RefusedError, MachineError):
            continue
        given += 1
        yield mission.mission.name, kind, mission.found(text)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--number', type=int, default=200, help='defects in all (default: %(default)s)')
    parser.add_argument('--variants', type=int, default=100, help='right variants in all (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--show', action='store_true', help='print the defects that were not found')
    parser.add_argument('--save', type=Path, help='write the defects, for another version of the programs')
    parser.add_argument('--load', type=Path, help='look for these defects instead')
    parser.add_argument('--output', type=Path, default=Path('out/seeded_defects.json'))
    options = parser.parse_args()
    begin = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        missions: list[Any] = [OfTree(one, Path(folder)) for one in TREES]
        missions += [OfMachine(one, Path(folder)) for one in MACHINES]
        by_name = {one.mission.name: one for one in missions}
        stock = [
            OfTree(Mission(one.stem, one.read_text(encoding='utf-8'), ()), Path(folder))
            for one in STOCK_TREES
            if not any(part in one.stem for part in LARGE)
        ]
        alarms = [one for one in variants([*missions, *stock], options.variants, random.Random(options.seed)) if one[2]]
        for one in alarms:
            print('alarm:', *one)
        print(f'alarms: {len(alarms)} of {options.variants} right variants', flush=True)
        looked_at: Iterator[tuple[str, str, str, str]]
        if options.load is not None:
            drawn = json.loads(options.load.read_text(encoding='utf-8'))
            looked_at = iter([(name, kind, text, by_name[name].found(text)) for name, kind, text, _ in drawn])
        else:
            looked_at = defects(missions, options.number, random.Random(options.seed + 1))
        tried, kept = Counter[tuple[str, str]](), []
        for name, kind, text, finder in looked_at:
            kept.append((name, kind, text, finder))
            tried[kind, finder] += 1
            if options.show and not finder:
                print(f'not found: {name}: {kind}: {text}', flush=True)
    if options.save is not None:
        options.save.write_text(json.dumps(kept), encoding='utf-8')
    share = 1.0 - sum(count for (_, finder), count in tried.items() if not finder) / max(1, tried.total())
    rows = {kind: [tried[kind, finder] for finder in ('check', 'refused', 'prove', '')]
            for kind in (*OF_TREES, *OF_MACHINES)}  # fmt: skip
    print(f'{"defect":28} {"check":>7} {"refused":>7} {"prove":>7} {"missed":>7}')
    for kind, counts in rows.items():
        print(f'{kind:28} ' + ' '.join(f'{count:7}' for count in counts))
    seconds = time.process_time() - begin
    print(f'{tried.total()} defects, {share:.1%} found (target {TARGET:.0%}), {seconds:.0f} s of processor time')
    requirements = sum(len(one.mission.required) - one.left_out for one in missions)
    write_figures(
        options.output,
        {'defects': rows, 'share': share, 'alarms': alarms, 'requirements': requirements, 'CPU, s': seconds},
    )
    return 0 if share >= TARGET and not alarms else 1


if __name__ == '__main__':
    sys.exit(main())

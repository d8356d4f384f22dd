# SPDX-License-Identifier: BSD-3-Clause
"""How many slips of an engineer a proof finds: realistic trees with what they require, and the same with one change.

A change is one of the text, at a random place: another control, children that are swapped, left out or there twice, a
decorator that is missing or too many, another number, key, sub-tree or leaf, a loop. Those after which the tree does
what it did are no defects: all that can happen to both is followed side by side, with what begins, ends and is waited
for, and how long. The trees as they are must give no alarm.

What is not found leaves all true that is required, and that skills declare. ``bt_tool prove --against`` shows all of
these to whoever has the version before.

Usage: python3 benchmarks proof_defects [--number N] [--seed N] [--show] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import copy
import random
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple
from xml.etree import ElementTree

from _figures import write_figures

from flexbt_core.behavior_tree.engine.leaf import Condition
from flexbt_core.behavior_tree.model.definition import TreeKey, TreeLibrary
from flexbt_core.behavior_tree.model.errors import TreeLoadError
from flexbt_core.behavior_tree.model.ports import STRING, input_port, output_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.nodes.nav2.registration import register_nav2
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.monitors.requirement_text import parse_requirement, problems_with
from flexbt_core.skills.literals import Predicate
from flexbt_core.skills.skill import Skill
from flexbt_formal.exploration.comparison import compare
from flexbt_formal.exploration.explorer import ExplorationLimits, explore
from flexbt_formal.exploration.model import Report
from flexbt_formal.exploration.tree_system import TreeSystem
from flexbt_testing.seeded_missions import StandIn

TARGET: Final = 0.95
_LIMITS: Final = ExplorationLimits(seconds=20.0)
_PAIRS: Final = ExplorationLimits(seconds=20.0, configurations=5000)
"""Situations of both trees that are compared at most; those that are alike so far count as the same."""

Element = ElementTree.Element


class Test(Condition):
    def tick(self) -> NodeStatus:
        raise AssertionError('a proof runs no real leaf')


VALID: Final = Predicate('valid', {'path': 'path'})
HELD: Final = Predicate('held')
DOCKED: Final = Predicate('docked')


class Plan(StandIn):
    ports = {'goal': input_port(STRING), 'path': output_port(STRING)}


class IsValid(Test):
    skill = Skill.measuring(VALID)
    ports = {'path': input_port(STRING)}


class Drive(StandIn):
    skill = Skill.of(
        parameters={'path': 'path'},
        preconditions=['valid(path)', 'not docked'],
        resources=['base'],
        deadline=60.0,
        predicates=[VALID, DOCKED],
    )
    ports = {'path': input_port(STRING)}


class Dock(StandIn):
    skill = Skill.of(
        preconditions=['not docked'], outcomes={'SUCCESS': ['docked']}, resources=['base'], predicates=[DOCKED]
    )


class Undock(StandIn):
    skill = Skill.of(outcomes={'SUCCESS': ['not docked']}, resources=['base'], predicates=[DOCKED])


class Grasp(StandIn):
    skill = Skill.of(preconditions=['not held'], outcomes={'SUCCESS': ['held']}, resources=['arm'], predicates=[HELD])


class Place(StandIn):
    skill = Skill.of(preconditions=['held'], outcomes={'SUCCESS': ['not held']}, resources=['arm'], predicates=[HELD])


class BackUp(StandIn):
    skill = Skill.of(resources=['base'])


class Clear(StandIn):
    pass


class Speak(StandIn):
    pass


class IsCharged(Test):
    pass


class IsSafe(Test):
    pass


LEAVES: Final = (Plan, IsValid, Drive, Dock, Undock, Grasp, Place, BackUp, Clear, Speak, IsCharged, IsSafe)


class Mission(NamedTuple):
    """Trees, the first of which is run, and what is required of it."""

    trees: str
    required: tuple[str, ...]


FETCH: Final = Mission(
    """
    <BehaviorTree ID="Fetch"><Sequence>
      <IsCharged name="charged"/>
      <RetryUntilSuccessful num_attempts="2"><Plan name="plan" goal="{goal}" path="{path}"/></RetryUntilSuccessful>
      <ReactiveSequence>
        <IsSafe name="safe"/>
        <Timeout msec="60000"><Drive name="drive" path="{path}"/></Timeout>
      </ReactiveSequence>
      <Fallback>
        <Grasp name="grasp"/>
        <Sequence><BackUp name="back"/><Grasp name="grasp_again"/></Sequence>
      </Fallback>
      <ForceSuccess><Speak name="speak"/></ForceSuccess>
    </Sequence></BehaviorTree>
    """,
    (
        'plan only after charged > SUCCESS',
        'plan at most 2 times',
        'after plan > FAILURE, plan before the end, up to 2 times',
        'drive only after plan > SUCCESS, each time anew',
        'drive works only while safe holds',
        'grasp only after drive > SUCCESS, each time anew',
        'back only after grasp > FAILURE, each time anew',
        'grasp_again only after back > SUCCESS, each time anew',
        'after grasp > SUCCESS, speak before the end',
        'after speak, =SUCCESS before the end',
        'after grasp_again > SUCCESS, speak before the end',
        'after grasp_again > FAILURE, =FAILURE before the end',
        'after back > FAILURE, =FAILURE before the end',
        'after drive > FAILURE, =FAILURE before the end',
        'charged is an IsCharged',
        'safe is an IsSafe',
        'plan is a Plan',
        'plan has goal={goal} and path={path}',
        'drive is a Drive',
        'drive has path={path}',
        'grasp is a Grasp',
        'back is a BackUp',
        'grasp_again is a Grasp',
        'speak is a Speak',
    ),
)
DELIVER: Final = Mission(
    """
    <BehaviorTree ID="Deliver"><Sequence>
      <Fallback><Undock name="undock"/><BackUp name="free"/></Fallback>
      <SubTree ID="Go" name="there" target="{goal}"/>
      <Place name="place"/>
      <SubTree ID="Go" name="home" target="{base}"/>
      <RetryUntilSuccessful num_attempts="3"><Dock name="dock"/></RetryUntilSuccessful>
    </Sequence></BehaviorTree>
    <BehaviorTree ID="Go"><RecoveryNode number_of_retries="1">
      <PipelineSequence>
        <RateController hz="1.0"><Plan name="plan" goal="{target}" path="{path}"/></RateController>
        <Timeout msec="60000"><Drive name="drive" path="{path}"/></Timeout>
      </PipelineSequence>
      <Clear name="clear"/>
    </RecoveryNode></BehaviorTree>
    """,
    (
        'there/plan only after undock',
        'free only after undock > FAILURE',
        'undock at most 1 times',
        'after free > FAILURE, =FAILURE before the end',
        'after there/clear > FAILURE, =FAILURE before the end',
        'after home/clear > FAILURE, =FAILURE before the end',
        'after there/clear > SUCCESS, there/plan before the end',
        'after home/clear > SUCCESS, home/plan before the end',
        'place only after there/drive > SUCCESS',
        'home/plan only after place > SUCCESS',
        'dock only after home/drive > SUCCESS',
        '=SUCCESS only after dock > SUCCESS',
        'dock at most 3 times',
        'after dock > FAILURE, dock before the end, up to 3 times',
        'after there/drive > FAILURE, there/clear before the end, up to 1 time',
        'after home/drive > FAILURE, home/clear before the end, up to 1 time',
        'there/plan at most 2 times in 1 s',
        'home/plan at most 2 times in 1 s',
        'undock is an Undock',
        'free is a BackUp',
        'place is a Place',
        'dock is a Dock',
        'there/plan is a Plan',
        'there/drive is a Drive',
        'there/clear is a Clear',
        'there/plan has goal={goal}',
        'home/plan has goal={base}',
        'there/drive has path={there/path}',
    ),
)
MISSIONS: Final = (FETCH, DELIVER)


# -- what is wrong ----------------------------------------------------------------------------------------------------


def _places(root: Element) -> list[tuple[Element, int]]:
    """Return all nodes, as parent and place."""
    return [(parent, place) for parent in root.iter() for place in range(len(parent)) if parent.tag != 'root']


def _exchange(*tags: str) -> Callable[[Element, int, random.Random], bool]:
    def change(parent: Element, place: int, chance: random.Random) -> bool:
        node = parent[place]
        if node.tag not in tags:
            return False
        node.tag = chance.choice([tag for tag in tags if tag != node.tag])
        node.attrib.pop('number_of_retries', None)
        if node.tag == 'Parallel':
            node.set('success_count', str(len(node)))
        return True

    return change


def _number(attribute: str, *others: str) -> Callable[[Element, int, random.Random], bool]:
    def change(parent: Element, place: int, chance: random.Random) -> bool:
        node = parent[place]
        if attribute not in node.attrib:
            return False
        node.set(attribute, chance.choice([one for one in others if one != node.get(attribute)]))
        return True

    return change


def _wrap(tag: str, **attributes: str) -> Callable[[Element, int, random.Random], bool]:
    def change(parent: Element, place: int, chance: random.Random) -> bool:
        around = Element(tag, attributes)
        around.append(parent[place])
        parent[place] = around
        return True

    return change


def _swap(parent: Element, place: int, chance: random.Random) -> bool:
    if place + 1 >= len(parent):
        return False
    parent[place], parent[place + 1] = parent[place + 1], parent[place]
    return True


def _drop(parent: Element, place: int, chance: random.Random) -> bool:
    if len(parent) < 2:
        return False
    del parent[place]
    return True


def _twice(parent: Element, place: int, chance: random.Random) -> bool:
    if len(parent) < 2:
        return False
    parent.insert(place, copy.deepcopy(parent[place]))
    return True


def _unwrap(parent: Element, place: int, chance: random.Random) -> bool:
    if len(parent[place]) != 1:
        return False
    parent[place] = parent[place][0]
    return True


def _key(parent: Element, place: int, chance: random.Random) -> bool:
    keys = [name for name, text in parent[place].attrib.items() if text.startswith('{')]
    if not keys:
        return False
    name = chance.choice(keys)
    text = parent[place].attrib[name]
    parent[place].set(name, chance.choice([one for one in ('{path}', '{goal}', '{paht}') if one != text]))
    return True


def _leaf(parent: Element, place: int, chance: random.Random) -> bool:
    node = parent[place]
    if len(node) or node.tag == 'SubTree':
        return False
    node.tag = chance.choice([one.__name__ for one in LEAVES if one.__name__ != node.tag])
    ports = next(one.ports for one in LEAVES if one.__name__ == node.tag)
    for name in set(node.attrib) - ports.keys() - {'name'}:
        del node.attrib[name]
    for name in ports.keys() - node.attrib.keys():
        node.set(name, f'{{{name}}}')
    return True


CHANGES: Final[dict[str, Callable[[Element, int, random.Random], bool]]] = {
    'memory': _exchange('Sequence', 'ReactiveSequence'),
    'Sequence and Fallback': _exchange('Sequence', 'Fallback'),
    'no pipeline': _exchange('PipelineSequence', 'Sequence'),
    'no recovery': _exchange('RecoveryNode', 'Sequence', 'Fallback'),
    'at once': _exchange('Sequence', 'Parallel'),
    'swapped': _swap,
    'left out': _drop,
    'there twice': _twice,
    'no decorator': _unwrap,
    'inverted': _wrap('Inverter'),
    'failure forgiven': _wrap('ForceSuccess'),
    'success lost': _wrap('ForceFailure'),
    'attempts': _number('num_attempts', '-1', '0', '1', '5'),
    'recoveries': _number('number_of_retries', '-1', '0'),
    'time': _number('msec', '0', '600000'),
    'key': _key,
    'leaf': _leaf,
    'again and again': _wrap('Repeat', num_cycles='-1'),
    'sub-tree': _number('target', '{path}', '{goal}', '{base}'),
}


def changed(mission: Mission, kind: str, chance: random.Random) -> str:
    """Return the trees with one such change; '' when there is no place for it."""
    root = ElementTree.fromstring(f'<root BTCPP_format="4">{mission.trees}</root>')  # noqa: S314 - of this file
    places = _places(root)
    chance.shuffle(places)
    if any(CHANGES[kind](parent, place, chance) for parent, place in places):
        return ElementTree.tostring(root, encoding='unicode')
    return ''


# -- what a proof says of it ------------------------------------------------------------------------------------------


def maker(mission: Mission, xml: str) -> Callable[[], TreeSystem] | None:
    """Make the tree with what is required of it; None when the trees, or what is required of them, are refused."""
    registry = builtin_registry()
    register_nav2(registry)
    registry.register_classes(LEAVES)
    stated = [parse_requirement(text, 'mission') for text in mission.required]
    requirements = [one.requirement for one in stated]
    try:
        library = TreeLibrary([load_xml(xml, 'mission.xml', registry)])
        main = next(iter(library.documents['mission.xml'].trees))

        def make() -> TreeSystem:
            return TreeSystem(library, TreeKey('mission.xml', main), given=('goal', 'base'), requirements=requirements)

        return None if problems_with(stated, make().vocabulary, main) else make
    except TreeLoadError:
        return None


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--number', type=int, default=200, help='defects in all (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--show', action='store_true', help='print those that were not found')
    parser.add_argument('--output', type=Path, default=Path('out/proof_defects.json'))
    options = parser.parse_args()
    chance = random.Random(options.seed)
    sound = {mission: changed_nothing(mission) for mission in MISSIONS}
    alarms = [found.violation.text for make in sound.values() for found in _report(make).counterexamples]
    found, tried, alike = Counter[str](), Counter[str](), Counter[str]()
    known: set[str] = set()
    begin = time.process_time()
    for _ in range(50 * options.number):
        if tried.total() >= options.number:
            break
        kind, mission = chance.choice(list(CHANGES)), chance.choice(MISSIONS)
        xml = changed(mission, kind, chance)
        if not xml or xml in known:
            continue
        known.add(xml)
        make = maker(mission, xml)
        is_found = make is None or bool(_report(make).counterexamples)
        if not is_found and make is not None and compare(sound[mission], make, _PAIRS, most=0).is_same:
            alike[kind] += 1
            continue
        tried[kind] += 1
        found[kind] += is_found
        if options.show and not is_found:
            print(f'not found: {kind}: {xml}')
    seconds = time.process_time() - begin
    share = found.total() / max(1, tried.total())
    print(f'{"change":24} {"defects":>8} {"found":>6} {"no defect":>10}')
    for kind in CHANGES:
        print(f'{kind:24} {tried[kind]:8} {found[kind]:6} {alike[kind]:10}')
    print(f'{"all":24} {tried.total():8} {found.total():6} {alike.total():10}  {share:.1%} (target {TARGET:.0%})')
    print(f'{seconds:.0f} s of CPU; alarms about the trees as they are: {len(alarms)}', *alarms, sep='\n  ')
    figures = {'defects': dict(tried), 'found': dict(found), 'no defect': dict(alike), 'share': share}
    write_figures(options.output, {**figures, 'CPU, s': seconds, 'false alarms': len(alarms)})
    return 0 if share >= TARGET and not alarms else 1


def changed_nothing(mission: Mission) -> Callable[[], TreeSystem]:
    """Return the trees as they are."""
    make = maker(mission, f'<root BTCPP_format="4">{mission.trees}</root>')
    assert make is not None, mission.required
    return make


def _report(make: Callable[[], TreeSystem]) -> Report:
    return explore(make, '', limits=_LIMITS)


if __name__ == '__main__':
    sys.exit(main())

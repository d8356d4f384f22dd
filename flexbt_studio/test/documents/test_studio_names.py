# SPDX-License-Identifier: BSD-3-Clause
"""Renaming across the files of a project: what is certain changes, all else stays, and trees run as before."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from test_xml_key_gestures import KEYS, Maker, given, run

from flexbt_core.behavior_tree.engine.registry import NodeRegistry, node_skills
from flexbt_core.behavior_tree.model.errors import Source
from flexbt_core.behavior_tree.xml.parser import Element, parse
from flexbt_onboard.behaviors.machine_behavior import installed_states
from flexbt_server.node_types import node_registry
from flexbt_studio.documents.diagnostics import Checker
from flexbt_studio.documents.names import LONGEST, Named, Names, Renaming
from flexbt_studio.documents.palette import states
from flexbt_studio.documents.project import Project
from flexbt_studio.documents.text import applied
from flexbt_studio.errors import StudioError
from flexbt_tools.trees.stand_ins import add_models

TREE = """\
<root BTCPP_format="4" main_tree_to_execute="Deliver">
  <BehaviorTree ID="Deliver">
    <Sequence>
      <ComputePathToPose name="plan" goal="{goal}" path="{path}"/>
      <FollowPath name="drive" path="{path}"/>
      <SubTree ID="Give" name="give" what="{cup}" cup="{other}"/>
      <SubTree ID="Giver"/>
      <Script code="cup := 'cup'; cupboard := cup"/>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Giver"><AlwaysSuccess/></BehaviorTree>
</root>
"""
GIVE = """\
<root BTCPP_format="4">
  <BehaviorTree ID="Give">
    <Sequence>
      <Grip name="plan" object="{what}"/>
      <Script code="cup := what"/>
    </Sequence>
  </BehaviorTree>
  <TreeNodesModel><Action ID="Grip"><input_port name="object"/></Action></TreeNodesModel>
</root>
"""
ROUND = """\
behavior:
  name: Round
  parameters:
    limit: {default: 60.0}
    tree: {default: Deliver}
machine:
  outcomes: [finished, failed]
  input_keys: [place]
  states:
    AskGoal:
      state: OperatorInputState
      parameters: {prompt: Where to?, type: geometry_msgs/PoseStamped}
      transitions: {received: Drive, declined: finished, failed: failed}
      remapping: {data: goal}
    Drive:
      state: BtExecuteGoalState
      parameters: {bt_file: $tree, timeout: $limit}
      transitions: {done: Tell, canceled: AskGoal, failed: Inner}
    Inner:
      machine:
        outcomes: [back]
        input_keys: [goal]
        states:
          Drive:
            state: BtExecuteGoalState
            parameters: {bt_file: Deliver}
            transitions: {done: back, canceled: back, failed: back}
      transitions: {back: AskGoal}
    Tell:
      state: LogKeyState
      parameters: {text: 'at {}'}
      transitions: {done: finished}
      remapping: {data: place}
"""
DAY = """\
machine:
  outcomes: [over]
  userdata: {place: dock}
  states:
    First:
      behavior: {use: Round, parameters: {limit: 5}}
      transitions: {finished: over, failed: over}
    Second:
      behavior: {use: Round}
      transitions: {finished: over, failed: First}
      remapping: {place: place}
    Third:
      behavior: {use: Round, default_keys: [place]}
      transitions: {finished: over, failed: over}
"""
REQUIREMENTS = """\
# What the site requires.
Round:
  - /Drive only after /AskGoal > received, each time anew   # always
  - after /Inner/Drive > done, =finished before the end
  - =finished only with goal written
day:
  - '/First/Drive at most 3 times'
  - after /First > failed comes =over
Deliver:
  - drive only after plan > SUCCESS
  - give/plan at most 2 times
"""
MOCKS = 'mocks:\n  drive: FAILURE\n  plan: SUCCESS\n'
PYTHON = """\
from flexbt_core import OperatableStateMachine
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest
from flexbt_states import BtExecuteState, LogKeyState


class Trip(Behavior):
    manifest = BehaviorManifest('Trip', description='Deliver, then say "Deliver".')

    def create(self):
        deliver = BtExecuteState(bt_file='Deliver')
        with OperatableStateMachine(['finished', "failed"], input_keys=['place']) as machine:
            machine.add('Deliver', deliver, {'done': 'Tell', 'canceled': 'failed', 'failed': 'failed'})
            machine.add("Tell", LogKeyState('{}'), {'done': 'finished'}, remapping={'data': 'place'})
        return machine


def test_trip():
    assert run('Deliver') == 'finished'
"""
FILES = {
    'deliver.xml': TREE,
    'more/give.xml': GIVE,
    'round.yaml': ROUND,
    'day.yaml': DAY,
    'site.yaml': REQUIREMENTS,
    'plan.yaml': MOCKS,
    'trip.py': PYTHON,
}


@pytest.fixture(scope='module')
def registry() -> NodeRegistry:
    return node_registry(lambda nodes, error: None)


class Site:
    """A project on disk, and its names."""

    def __init__(self, folder: Path, registry: NodeRegistry, files: dict[str, str]) -> None:
        self.texts = dict(files)
        for file, text in files.items():
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            (folder / file).write_bytes(text.encode())
        self.project = Project(folder)
        checker = Checker(self.project, registry, node_skills(registry, lambda text: None))
        self.names = Names(self.project, registry, checker, states(installed_states()[0]))

    def rename(self, named: Named, new: str) -> Renaming:
        """Rename something, on disk and here."""
        made = self.names.rename(named, new)
        for file, edits in made.edits.items():
            self.texts[file] = applied(self.texts[file], edits)
            self.project.adopt(file, self.texts[file])
        return made

    def at(self, file: str, before: str, name: str = '') -> Named:
        """Return what the name behind a text means."""
        return self.names.at(file, self.texts[file].index(before + name) + len(before))


@pytest.fixture
def site(tmp_path: Path, registry: NodeRegistry) -> Site:
    return Site(tmp_path, registry, FILES)


def changed(site: Site, named: Named, new: str, **expected: list[tuple[str, str]]) -> Renaming:
    """Rename, and assert that the texts are those before with these replacements, each once, and no others."""
    made = site.rename(named, new)
    for file, text in FILES.items():
        for old, after in expected.get(re.sub(r'\W', '_', file), []):
            assert text.count(old) == 1, old
            text = text.replace(old, after)
        assert site.texts[file] == text, file
    return made


def test_a_tree_is_renamed_where_it_is_meant(site: Site) -> None:
    made = changed(
        site,
        site.at('deliver.xml', '<BehaviorTree ID="', 'Deliver'),
        'Bring',
        deliver_xml=[
            ('main_tree_to_execute="Deliver"', 'main_tree_to_execute="Bring"'),
            ('Tree ID="Deliver"', 'Tree ID="Bring"'),
        ],
        round_yaml=[('{default: Deliver}', '{default: Bring}'), ('bt_file: Deliver', 'bt_file: Bring')],
        site_yaml=[('Deliver:', 'Bring:')],
        trip_py=[("bt_file='Deliver'", "bt_file='Bring'")],
    )
    places = PYTHON.index('"Deliver"') + 1, PYTHON.index("run('Deliver") + 5
    assert [(one.file, one.span.start) for one in made.notes] == [('trip.py', place) for place in places]


def test_a_key_is_renamed_with_the_ports_that_lead_to_it(site: Site) -> None:
    changed(
        site,
        site.at('more/give.xml', 'object="{', 'what'),
        'thing',
        deliver_xml=[('what="{cup}"', 'thing="{cup}"')],
        more_give_xml=[('{what}', '{thing}'), ('cup := what', 'cup := thing')],
    )


def test_a_key_that_a_model_of_another_file_gives_by_default_is_given(tmp_path: Path, registry: NodeRegistry) -> None:
    nodes = '<Script code="b := 1"/><SubTree ID="Two"/><SubTree ID="Two" a="7"/>'
    ports = '<input_port name="a" default="{b}"/><input_port name="z" default="{c}"/>'
    files = {
        'main.xml': f'<root><BehaviorTree ID="Main"><Sequence>{nodes}</Sequence></BehaviorTree></root>',
        'two.xml': '<root><BehaviorTree ID="Two"><AlwaysSuccess/></BehaviorTree>'
        f'<TreeNodesModel><SubTree ID="Two">{ports}</SubTree></TreeNodesModel></root>',
    }
    site = Site(tmp_path, registry, files)
    with pytest.raises(StudioError, match=r'by default, \[z\] of the sub-tree Two is the key c'):
        site.rename(site.at('main.xml', 'code="', 'b'), 'c')
    site.rename(site.at('main.xml', 'code="', 'b'), 'new')
    expected = files['main.xml'].replace('b :=', 'new :=').replace('"Two"/>', '"Two" a="{new}"/>', 1)
    assert site.texts == {**files, 'main.xml': expected}


def test_a_key_is_not_a_text_of_a_script_nor_a_longer_name(site: Site) -> None:
    changed(
        site,
        site.at('deliver.xml', 'what="{', 'cup'),
        'mug',
        deliver_xml=[
            ('what="{cup}"', 'what="{mug}"'),
            ("cup := 'cup'; cupboard := cup", "mug := 'cup'; cupboard := mug"),
        ],
    )


def test_a_node_is_renamed_in_requirements_and_plans_if_it_is_certain(site: Site) -> None:
    made = changed(
        site,
        site.at('deliver.xml', 'name="', 'drive'),
        'go: there',
        deliver_xml=[('name="drive"', 'name="go: there"')],
        site_yaml=[('- drive only after plan > SUCCESS', "- 'go: there only after plan > SUCCESS'")],
        plan_yaml=[('drive: FAILURE', "'go: there': FAILURE")],
    )
    assert made.notes == []


def test_a_node_of_a_sub_tree_is_renamed_in_the_paths_of_runs(site: Site) -> None:
    made = changed(
        site,
        site.at('more/give.xml', 'name="', 'plan'),
        'grip',
        more_give_xml=[('name="plan"', 'name="grip"')],
        site_yaml=[('give/plan at', 'give/grip at')],
    )
    assert {one.file for one in made.notes} == {'plan.yaml', 'site.yaml'}  # another node has the name, too


def test_a_sub_tree_without_a_name_is_called_by_its_tree_in_requirements(site: Site) -> None:
    for file, text in (
        ('deliver.xml', TREE.replace(' name="give"', '')),
        ('site.yaml', REQUIREMENTS.replace('- give/plan at', '- Give::4/plan at most 3 times\n  - Give/plan at')),
    ):
        site.texts[file] = text
        (site.project.root / file).write_text(text)
    before = site.texts['site.yaml']
    site.rename(site.at('more/give.xml', 'name="', 'plan'), 'grip')
    assert site.texts['site.yaml'] == before.replace('/plan at', '/grip at')
    site.rename(site.at('deliver.xml', 'SubTree ID="', 'Give'), 'Hand')
    assert site.texts['site.yaml'] == before.replace('/plan at', '/grip at').replace('Give', 'Hand')


def test_a_state_is_renamed_in_requirements_of_all_behaviors_that_contain_it(site: Site) -> None:
    changed(
        site,
        site.at('round.yaml', '    ', 'Drive:'),
        'Go',
        round_yaml=[('    Drive:\n      state', '    Go:\n      state'), ('received: Drive', 'received: Go')],
        site_yaml=[('- /Drive only', '- /Go only'), ('/First/Drive at', '/First/Go at')],
    )


def test_an_outcome_is_renamed_where_the_behavior_is_embedded(site: Site) -> None:
    changed(
        site,
        site.at('round.yaml', 'outcomes: [', 'finished'),
        'done',
        round_yaml=[
            ('[finished', '[done'),
            ('declined: finished', 'declined: done'),
            ('{done: finished}', '{done: done}'),
        ],
        day_yaml=[
            ('{finished: over, failed: over}\n    Second', '{done: over, failed: over}\n    Second'),
            ('[place]}\n      transitions: {finished: over', '[place]}\n      transitions: {done: over'),
            ('{finished: over, failed: First}', '{done: over, failed: First}'),
        ],
        site_yaml=[('=finished before', '=done before'), ('=finished only', '=done only')],
    )


def test_a_userdata_key_keeps_its_ways(site: Site) -> None:
    changed(
        site,
        site.at('round.yaml', 'remapping: {data: ', 'goal'),
        'aim',
        round_yaml=[
            ('{data: goal}', '{data: aim}'),
            ('failed: Inner}\n', 'failed: Inner}\n      remapping: {goal: aim}\n'),
            ('{back: AskGoal}\n', '{back: AskGoal}\n      remapping: {goal: aim}\n'),
        ],
        site_yaml=[('with goal written', 'with aim written')],
    )


def test_an_input_key_of_a_behavior_keeps_the_keys_around_it(site: Site) -> None:
    changed(
        site,
        site.at('round.yaml', 'input_keys: [', 'place'),
        'where',
        round_yaml=[('[place]', '[where]'), ('{data: place}', '{data: where}')],
        day_yaml=[
            ('over}\n    Second', 'over}\n      remapping: {where: place}\n    Second'),
            ('default_keys: [place]', 'default_keys: [where]'),
            ('{place: place}', '{where: place}'),
        ],
    )


def test_a_key_that_a_state_uses_in_two_ways_is_renamed_in_both(tmp_path: Path, registry: NodeRegistry) -> None:
    inner = 'machine:\n  outcomes: [done]\n  io_keys: [a, b]\n  states:\n    Read: {state: LogKeyState}\n'
    outer = (
        'machine:\n  outcomes: [done]\n  userdata: {b: 1}\n  states:\n'
        '    In:\n      behavior: {use: inner}\n      transitions: {done: done}\n      remapping: {a: b}\n'
        '    Kept:\n      behavior: {use: inner, default_keys: [a]}\n      transitions: {done: done}\n'
    )
    code = TWO.replace("parameters={'limit': 2.0}", "default_keys=['place']")
    code = "(['finished'], input_keys=['place'])".join(code.rsplit("(['finished'])", 1))
    site = Site(tmp_path, registry, {'inner.yaml': inner, 'outer.yaml': outer, 'two.py': code})
    site.rename(site.at('outer.yaml', 'userdata: {', 'b'), 'c')
    changed = outer.replace('{b: 1}', '{c: 1}').replace('{a: b}', '{a: c, b: c}')
    assert site.texts['outer.yaml'] == f'{changed}      remapping: {{b: c}}\n'
    site.rename(site.at('inner.yaml', 'io_keys: [', 'a'), 'z')
    assert 'remapping: {z: c, b: c}' in site.texts['outer.yaml']
    kept = 'default_keys: [z]}\n      transitions: {done: done}\n      remapping: {b: c, z: a}\n'
    assert site.texts['outer.yaml'].endswith(kept)
    for taken, more in (('{z: c, ', '{z: c, x: c, '), ('default_keys: [z', 'default_keys: [z, x')):
        site.project.adopt('outer.yaml', site.texts['outer.yaml'].replace(taken, more))
        with pytest.raises(StudioError, match='names a key x already'):
            site.names.rename(site.at('inner.yaml', 'io_keys: [', 'z'), 'x')
    site.rename(site.at('two.py', "input_keys=['", 'place'), 'goal')
    assert "default_keys=['goal']" in site.texts['two.py'] and 'remapping' not in site.texts['two.py']


def test_a_behavior_and_its_parameter_are_renamed(site: Site) -> None:
    changed(
        site,
        site.at('round.yaml', 'name: ', 'Round'),
        'Tour',
        round_yaml=[('name: Round', 'name: Tour')],
        day_yaml=[
            ('{use: Round, parameters', '{use: Tour, parameters'),
            ('{use: Round}', '{use: Tour}'),
            ('Round, default', 'Tour, default'),
        ],
        site_yaml=[('Round:', 'Tour:')],
    )
    site.rename(site.at('round.yaml', 'timeout: $', 'limit'), 'most')
    assert 'timeout: $most' in site.texts['round.yaml'] and '    most: {default' in site.texts['round.yaml']
    assert 'parameters: {most: 5}' in site.texts['day.yaml']


TWO = """\
from flexbt_core import OperatableStateMachine
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest, BehaviorParameter
from flexbt_states import WaitState


class Outer(Behavior):
    manifest = BehaviorManifest('Outer', parameters=[BehaviorParameter('limit', 1.0)])

    def create(self):
        with OperatableStateMachine(['finished']) as machine:
            inner = self.use_behavior(Inner, 'Inner', parameters={'limit': 2.0})
            machine.add('Inner', inner, {'finished': 'Wait'})
            machine.add('Wait', WaitState(self.limit), {'done': 'finished'})
        return machine


class Inner(Behavior):
    manifest = BehaviorManifest('Inner', parameters=[BehaviorParameter('limit', 1.0)])

    def create(self):
        with OperatableStateMachine(['finished']) as machine:
            machine.add('Rest', WaitState(self.limit), {'done': 'finished'})
        return machine
"""


@pytest.mark.parametrize(
    ('before', 'changes'),
    [
        (
            "'Outer', parameters=[BehaviorParameter('",
            ["'Outer', parameters=[BehaviorParameter('", "'Wait', WaitState(self."],
        ),
        ("parameters={'", ["parameters={'", "'Inner', parameters=[BehaviorParameter('", "'Rest', WaitState(self."]),
        (
            "'Rest', WaitState(self.",
            ["parameters={'", "'Inner', parameters=[BehaviorParameter('", "'Rest', WaitState(self."],
        ),
    ],
)
def test_a_parameter_is_that_of_its_own_behavior(
    tmp_path: Path, registry: NodeRegistry, before: str, changes: list[str]
) -> None:
    site = Site(tmp_path, registry, {'two.py': TWO})
    expected = TWO
    for one in changes:
        assert expected.count(f'{one}limit') == 1, one
        expected = expected.replace(f'{one}limit', f'{one}most')
    site.rename(site.at('two.py', before, 'limit'), 'most')
    assert site.texts['two.py'] == expected


REMAP = """\
<root main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <Sequence>
      <SetBlackboard output_key="cup" value="1"/>
      <SubTree ID="Give"><remap internal="what" external="cup"/></SubTree>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Give"><Script code="done := what"/></BehaviorTree>
</root>
"""


@pytest.mark.parametrize(
    ('before', 'name', 'changes'),
    [
        ('external="', 'cup', ['output_key="', 'external="']),
        ('internal="', 'what', ['internal="', 'done := ']),
    ],
)
def test_the_keys_of_a_remapping_are_renamed(
    tmp_path: Path, registry: NodeRegistry, before: str, name: str, changes: list[str]
) -> None:
    site = Site(tmp_path, registry, {'old.xml': REMAP})
    named = site.at('old.xml', before, name)
    places = sorted(one.span.start for one in site.names.uses(named))
    assert places == sorted(REMAP.index(f'{one}{name}') + len(one) for one in changes)
    site.rename(named, 'mug')
    expected = REMAP
    for one in changes:
        expected = expected.replace(f'{one}{name}', f'{one}mug')
    assert site.texts['old.xml'] == expected


def test_a_port_of_a_declared_node_type_is_renamed_in_all_files(site: Site) -> None:
    changed(
        site,
        site.at('more/give.xml', '<Grip name="plan" ', 'object'),
        'thing',
        more_give_xml=[
            ('object="{what}"', 'thing="{what}"'),
            ('<input_port name="object"', '<input_port name="thing"'),
        ],
    )
    with pytest.raises(StudioError, match='in its code'):
        site.names.rename(site.at('deliver.xml', 'name="plan" ', 'goal'), 'aim')


def test_a_port_of_a_palette_is_no_port_of_a_class(tmp_path: Path) -> None:
    palette = '<root><TreeNodesModel><Action ID="Lift"><input_port name="mass"/></Action></TreeNodesModel></root>'
    registry = node_registry(lambda nodes, error: None)
    add_models(registry, 'palette.xml', palette)
    site = Site(tmp_path, registry, {'palette.xml': palette})
    with pytest.raises(StudioError, match='the model of Lift was read at the start'):
        site.names.rename(site.at('palette.xml', 'name="', 'mass'), 'weight')


def test_python_keeps_its_quotes(site: Site) -> None:
    changed(
        site,
        site.at('trip.py', 'machine.add("', 'Tell'),
        "It's told",
        trip_py=[('add("Tell"', 'add("It\'s told"'), ("'done': 'Tell'", "'done': \"It's told\"")],
    )


def test_whatever_has_a_name_gets_it_back(tmp_path: Path, registry: NodeRegistry) -> None:
    """Rename every name at every place where it stands, and rename it back."""
    texts = {file: text for file, text in FILES.items() if file not in ('site.yaml', 'plan.yaml')}
    site = Site(tmp_path, registry, FILES)
    renamed = 0
    kinds = set()
    for file, text in texts.items():
        for word in re.finditer(r'\w+', text):
            try:
                named = site.names.at(file, word.start())
                made = site.names.rename(named, 'Zz9')
            except StudioError:
                continue
            renamed += 1
            kinds.add(named.kind)
            is_longer = any(edit.start == edit.end for edits in made.edits.values() for edit in edits)
            mentions = {(one.file, one.span) for one in site.names.uses(named)}
            for one, edits in made.edits.items():
                after = applied(site.texts[one], edits)
                assert 'Zz9' in after
                site.project.adopt(one, after)
                assert named.kind == 'key' or {(one, (edit.start, edit.end)) for edit in edits} <= mentions
            owner = re.sub(rf'(?<![^/]){re.escape(named.name)}$', 'Zz9', named.owner)
            back = site.names.rename(
                named._replace(name='Zz9', owner=owner if named.kind in ('tree', 'state') else named.owner), named.name
            )
            for one, edits in back.edits.items():
                assert is_longer or applied(site.project.text(one), edits) == site.texts[one], (named, one)
            assert is_longer or back.edits.keys() == made.edits.keys(), named
            for one in made.edits:
                site.project.adopt(one, site.texts[one])
    assert renamed > 70 and kinds == {
        'tree',
        'key',
        'node',
        'port',
        'state',
        'outcome',
        'userdata',
        'behavior',
        'parameter',
    }


def split(text: str) -> dict[str, str]:
    """Return random trees as three files."""
    trees = re.findall(r'  <BehaviorTree ID="(\w+)">.*?</BehaviorTree>', text, re.DOTALL)
    parts = re.findall(r'  <BehaviorTree.*?</BehaviorTree>', text, re.DOTALL)
    model = re.search(r'<TreeNodesModel>.*</TreeNodesModel>', text, re.DOTALL)
    models = {'Main': model[0] if model else ''}
    return {
        f'{id}.xml': f'<root BTCPP_format="4">\n{part}{models.get(id, "")}\n</root>\n'
        for id, part in zip(trees, parts, strict=True)
    }


def joined(files: dict[str, str]) -> str:
    return f'<root BTCPP_format="4">{"".join(re.sub("</?root.*?>", "", files[one]) for one in sorted(files))}</root>'


@pytest.mark.parametrize('seed', range(100, 108))
def test_random_trees_in_three_files_run_as_before(seed: int, tmp_path: Path) -> None:
    maker, before = Maker(seed), None
    registry = node_registry(lambda nodes, error: None)
    while before is None:
        files = split(maker.document())
        values = given(files['Main.xml'])
        before = run(joined(files), values)
    site = Site(tmp_path, registry, files)
    done = 0
    for tree in ('Main', 'One', 'Two'):
        named = Named('tree', tree, f'{tree}.xml', tree)
        made = site.rename(named, 'Ääh' if tree != 'Main' else 'Main2')
        statuses = run(joined(site.texts).replace('"Main2"', '"Main"'), values)
        assert statuses == before
        walked = [one.attributes.get('ID') for file in files for one in elements(site.texts[file])]
        assert tree not in walked and made.notes == []
        site.rename(
            named._replace(name='Ääh' if tree != 'Main' else 'Main2', owner='Ääh' if tree != 'Main' else 'Main2'), tree
        )
        assert site.texts == files
        for key in KEYS[:5]:
            new = '_new' if key == '_p' else 'new'
            try:
                made = site.rename(Named('key', key, f'{tree}.xml', tree), new)
            except StudioError:
                continue
            done += 1
            if tree == 'Main':
                others = {new if name == key else name: value for name, value in values.items()}
                after, board = run(joined(site.texts), others) or ([], {})
                assert (after, {key if name == new else name: one for name, one in board.items()}) == before
            else:
                assert run(joined(site.texts), values) == before, (
                    f'{key} of {tree}\n{joined(files)}\n{joined(site.texts)}'
                )
            own = [value for one in elements(site.texts[f'{tree}.xml']) for value in one.attributes.values()]
            adds = any(
                files[one][edit.start : edit.end] in ('', '{=}') for one, edits in made.edits.items() for edit in edits
            )
            is_here = [value for value in own if re.search(rf'(?<![\w@]){key}(?!\w)', value)]
            assert adds or tree == 'Main' or not is_here, (key, is_here)
            if not adds:
                back = site.rename(Named('key', new, f'{tree}.xml', tree), key)
                if all(edit.start < edit.end for edits in back.edits.values() for edit in edits):
                    assert site.texts == files
            for file, text in files.items():
                site.texts[file] = text
                site.project.adopt(file, text)
    assert done > 3


def elements(text: str) -> list[Element]:
    pending, found = [parse(Source('', text))], []
    for one in pending:
        found.append(one)
        pending += one.children
    return found


@pytest.mark.parametrize(
    ('file', 'before', 'name', 'place'),
    [
        ('deliver.xml', '<SubTree ID="', 'Give"', ('more/give.xml', '"Give"')),
        ('deliver.xml', '<SubTree ID="Give" name="give" ', 'what', ('more/give.xml', '{what}')),
        ('round.yaml', 'received: ', 'Drive', ('round.yaml', ' Drive:')),
        ('round.yaml', 'declined: ', 'finished', ('round.yaml', '[finished')),
        ('round.yaml', 'bt_file: ', 'Deliver', ('deliver.xml', 'Tree ID="Deliver')),
        ('day.yaml', 'behavior: {use: ', 'Round', ('round.yaml', ' Round')),
        ('round.yaml', 'timeout: $', 'limit', ('round.yaml', 'limit:')),
        ('day.yaml', 'transitions: {', 'finished', ('round.yaml', '[finished')),
        ('day.yaml', 'remapping: {', 'place', ('round.yaml', '[place')),
        ('more/give.xml', '<Grip name="plan" ', 'object', ('more/give.xml', 'port name="object')),
    ],
)
def test_a_name_leads_to_its_definition(site: Site, file: str, before: str, name: str, place: tuple[str, str]) -> None:
    found = site.names.definition(site.at(file, before, name))
    where, text = place
    word = re.search(r'\w+$', text.rstrip('":}')) or re.search(r'\w+', text)
    assert word is not None
    assert (found.file, found.span.start) == (where, FILES[where].index(text) + word.start())


@pytest.mark.parametrize(
    ('file', 'before', 'name', 'new', 'told'),
    [
        ('deliver.xml', '<BehaviorTree ID="', 'Deliver', 'Give', 'already, in more/give.xml'),
        ('deliver.xml', '<BehaviorTree ID="', 'Deliver', '', 'empty'),
        ('deliver.xml', '<BehaviorTree ID="', 'Deliver', 'x' * 10_000_000, 'at most 200 characters'),
        ('deliver.xml', '<BehaviorTree ID="', 'Deliver', 'a"b', 'not allowed'),
        ('deliver.xml', '<BehaviorTree ID="', 'Deliver', 'Sequence', 'node type'),
        ('more/give.xml', '{', 'what', 'cup', 'become one|already'),
        ('more/give.xml', '{', 'what', 'a b', 'cannot replace'),
        ('more/give.xml', '{', 'what', 'x<', 'cannot replace'),
        ('more/give.xml', '{', 'what', '😀', 'port name|scripts cannot'),
        ('round.yaml', '    ', 'Drive:', 'Tell', 'already'),
        ('round.yaml', '    ', 'Drive:', 'a/b', "contains '/'"),
        ('round.yaml', '    ', 'Drive:', ' ', 'cannot be a label'),
        ('round.yaml', 'outcomes: [', 'finished', 'failed', 'already'),
        ('round.yaml', 'remapping: {data: ', 'goal', 'place', 'already|become one'),
        ('round.yaml', 'name: ', 'Round', 'day', 'already'),
        ('deliver.xml', 'name="', 'drive', '  ', 'needs a name'),
    ],
)
def test_a_name_that_does_not_fit_changes_nothing(
    site: Site, file: str, before: str, name: str, new: str, told: str
) -> None:
    with pytest.raises(StudioError, match=told):
        site.names.rename(site.at(file, before, name), new)
    assert len(new) > LONGEST or {one: site.project.text(one) for one in FILES} == FILES


def test_odd_names_are_written_so_that_they_are_read_again(site: Site) -> None:
    for new in ('yes', '1:30', "it's", 'say "hi"', 'ä→😀', '- x', '# no', 'a: b', '{x}', 'null'):
        made = site.names.rename(site.at('round.yaml', '    ', 'Drive:'), new)
        text = applied(ROUND, made.edits['round.yaml'])
        site.project.adopt('round.yaml', text)
        (found,) = (one for one in site.project.document('round.yaml').view()['states'] if one['path'] == f'/{new}')
        assert found['type'] == 'BtExecuteGoalState'
        site.project.adopt('round.yaml', ROUND)


def test_only_requirements_of_one_thing_are_renamed_and_a_name_by_references(
    tmp_path: Path, registry: NodeRegistry
) -> None:
    files = {
        'a.xml': '<root BTCPP_format="4"><BehaviorTree ID="Round"><AlwaysSuccess/></BehaviorTree></root>',
        'b.xml': '<root BTCPP_format="4"><BehaviorTree ID="B"><SubTree ID="R&#111;und"/></BehaviorTree></root>',
        'places.yaml': 'Round: [1.0, 2.0]\n',
        'site.yaml': 'Round: [never FAILURE]\n',
    }
    site = Site(tmp_path, registry, files)
    made = site.rename(site.at('a.xml', 'ID="', 'Round'), 'Tour')
    assert set(made.edits) == {'a.xml', 'b.xml', 'site.yaml'} and site.texts['b.xml'].endswith(
        '<SubTree ID="Tour"/></BehaviorTree></root>'
    )
    assert [one.file for one in made.notes] == ['places.yaml']
    (tmp_path / 'tour.yaml').write_text(ROUND.replace('name: Round', 'name: Tour'))
    for file, before in (('a.xml', 'ID="'), ('tour.yaml', 'name: ')):
        site.texts['tour.yaml'] = site.project.text('tour.yaml')
        made = site.names.rename(site.at(file, before, 'Tour'), 'Round')
        assert 'site.yaml' not in made.edits and 'site.yaml' in {one.file for one in made.notes}


@pytest.mark.parametrize(
    ('file', 'before', 'name', 'others'),
    [
        ('round.yaml', 'name: ', 'Round', {'day.yaml', 'site.yaml'}),
        ('round.yaml', '    ', 'Drive:', {'site.yaml'}),
        ('round.yaml', '[', 'finished', {'day.yaml', 'site.yaml'}),
        ('round.yaml', 'input_keys: [', 'place', {'day.yaml'}),
        ('deliver.xml', 'BehaviorTree ID="', 'Deliver', {'site.yaml', 'trip.py'}),
        ('deliver.xml', 'name="', 'drive', {'site.yaml'}),
    ],
)
def test_what_two_files_define_is_renamed_in_one_and_noted_elsewhere(
    tmp_path: Path, registry: NodeRegistry, file: str, before: str, name: str, others: set[str]
) -> None:
    copied = f'a_copy_of_{file}'  # the first one by its name
    for number, one in enumerate((copied, f'z_copy_of_{file}')):
        (tmp_path / str(number)).mkdir()
        site = Site(tmp_path / str(number), registry, {**FILES, one: FILES[file]})
        made = site.names.rename(site.at(one, before, name), 'other')
        assert set(made.edits) == {one} and (number or others <= {note.file for note in made.notes})


def test_a_file_that_cannot_be_read_wholly_is_told(site: Site) -> None:
    site.project.adopt('more/give.xml', GIVE.replace('</Sequence>', '<'))
    made = site.names.rename(site.at('deliver.xml', 'SubTree ID="', 'Give'), 'Hand')
    assert applied(TREE, made.edits['deliver.xml']) == TREE.replace('ID="Give"', 'ID="Hand"')
    assert 'ID="Hand"' in applied(site.project.text('more/give.xml'), made.edits['more/give.xml'])
    site.project.adopt('day.yaml', DAY + '  : [')
    made = site.names.rename(site.at('round.yaml', 'name: ', 'Round'), 'Tour')
    assert (
        any(one.file == 'day.yaml' and 'cannot be read' in one.text for one in made.notes) or 'day.yaml' in made.edits
    )

# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool plan``: the example of its page, and what it says when something is wrong."""

from __future__ import annotations

import gzip
import json
import re
from pathlib import Path

import pytest

from flexbt_common.pictures import markup
from flexbt_testing.behavior_trees.bt_tool import tool

PAGE = (Path(__file__).parents[3] / 'docs' / 'how_to' / 'goals.md').read_text(encoding='utf-8')
SKILLS, MISSION, TEAM_SKILLS, TEAM = re.findall(r'^```yaml\n(.*?)^```$', PAGE, re.MULTILINE | re.DOTALL)
SUMMARY, TEAM_SUMMARY = re.findall(r'^\$ bt_tool plan .*\n((?:.+\n)+)```$', PAGE, re.MULTILINE)


def without_times(text: str) -> str:
    """Return a summary without how long it took, without the progress that is told on a busy machine, and in whole
    lines."""
    whole = text.replace('\n  ', ' ')
    return re.sub(r'^[\d.]+ s: no plan costs .*\n| \(\d+ conditions, .* s\)', '', whole, flags=re.MULTILINE)


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    (tmp_path / 'cup_skills.yaml').write_text(SKILLS)
    file = tmp_path / 'cup.yaml'
    file.write_text(MISSION)
    return file


def test_the_example_of_the_page(mission: Path, tmp_path: Path) -> None:
    tree = tmp_path / 'cup.xml'
    done = tool('plan', str(mission), '-o', str(tree))
    assert (done.code, done.out) == (0, '')
    assert max(map(len, done.err.splitlines())) <= 120
    assert without_times(done.err) == without_times(SUMMARY)
    assert tool('check', str(tree), '--allow-unknown').code == 0
    printed = tool('plan', str(mission), '--quiet')
    assert (printed.out, printed.err) == (tree.read_text(), '')


def test_alternatives_of_a_goal_may_exclude_each_other(mission: Path) -> None:
    assert tool('plan', str(mission), '--goal', 'cup_at(office) | cup_at(hall)').code == 0
    both = tool('plan', str(mission), '--goal', 'cup_at(office) & cup_at(hall)')
    assert (both.code, both.out) == (1, '')
    assert 'can never hold at once' in both.err


def test_the_call_of_the_page(
    mission: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(mission.parent)
    [code] = re.findall(r'^```python\n(.*?)^```$', PAGE, re.MULTILINE | re.DOTALL)
    exec(compile(code, 'goals.md', 'exec'), {})  # noqa: S102 it is of this repository
    assert capsys.readouterr().out.startswith("61.0 ('GoTo(office, hall)', ")
    assert tool('check', 'cup.xml', '--allow-unknown').code == 0


def test_the_map_of_a_plan(mission: Path, team: Path, tmp_path: Path) -> None:
    drawn = tmp_path / 'map.mmd'
    assert tool('plan', str(mission), '--draw', str(drawn)).code == 0
    text = drawn.read_text()
    regions = dict(re.findall(r'^  (r\d+)\(\["(.*)"\]\):::', text, re.MULTILINE))
    way = [re.findall(r'^  start --> (r\d+)$', text, re.MULTILINE)[0]]
    onward = dict(re.findall(r'^  (r\d+) ==> (r\d+)$', text, re.MULTILINE))
    while way[-1] in onward:
        way.append(onward[way[-1]])
    assert [re.sub(r'\(.*', '', regions[one]) for one in way[:-1]] == [
        'GoTo', 'GoThrough', 'PickUpCup', 'GoThrough', 'GoTo', 'PutDownCup'
    ]  # fmt: skip
    assert regions[way[-1]] == 'the goal<br/>cup_at(office)'
    assert len(regions) == 14  # as many as there are branches, and the goal
    shut = re.findall(rf'^  {way[0]} -.->\|"not open\(kitchen_door\)"\| (r\d+)$', text, re.MULTILINE)
    assert regions[shut[0]].startswith('GoTo(office, hall)<br/>cost left: 69<br/>where<br/>')
    assert tool('plan', str(team), '--disturbed', '0', '--draw', str(drawn)).code == 0
    assert len(re.findall(r' ==>\|', drawn.read_text())) == 2 * 4 * 6 + 4 + 6  # each in any order
    assert tool('plan', str(team), '--draw', str(tmp_path / 'no' / 'map.mmd')).code == 2


def test_a_picture_without_graphviz_names_what_the_command_can_do(
    mission: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('PATH', '')
    monkeypatch.setattr(markup, 'find_spec', lambda name: None)
    done = tool('plan', str(mission), '--quiet', '--draw', str(tmp_path / 'map.svg'))
    assert (done.code, done.err.endswith('files .mmd (Mermaid) and .dot need nothing\n')) == (2, True)


@pytest.fixture
def team(tmp_path: Path) -> Path:
    (tmp_path / 'team_skills.yaml').write_text(TEAM_SKILLS)
    file = tmp_path / 'team.yaml'
    file.write_text(TEAM)
    return file


def test_the_example_with_two_robots(team: Path, tmp_path: Path) -> None:
    tree = tmp_path / 'team.xml'
    done = tool('plan', str(team), '-o', str(tree))
    assert (done.code, done.out) == (0, '')
    assert without_times(done.err).startswith(without_times(TEAM_SUMMARY.removesuffix('...\n')))
    assert tool('check', str(tree), '--allow-unknown').code == 0
    told = json.loads(tool('plan', str(team), '--json', '--disturbed', '0').out)
    assert (told['duration'], told['cost'], told['alone']) == (50.0, 80.0, {'red': 80.0, 'blue': 80.0})
    first = told['tasks'][0]['robot']  # either of two that can do the same
    action = f'DriveTo({first}, office, hall)'
    assert told['tasks'][0] == {'robot': first, 'action': action, 'begins': 0.0, 'ends': 10.0}


def test_whoever_may_hold_up_a_team_is_named(team: Path) -> None:
    skills = team.with_name('team_skills.yaml')
    skills.write_text(TEAM_SKILLS.replace('    deadline: 30.0\n', ''))
    done = tool('plan', str(team), '--disturbed', '0')
    assert done.code == 0
    assert 'no deadline: LeaveCup, TakeCup; where one of these never ends, the others wait' in done.err
    told = json.loads(tool('plan', str(team), '--json', '--disturbed', '0').out)
    assert told['unlimited'] == ['LeaveCup', 'TakeCup']


@pytest.mark.parametrize(
    ('wrong', 'right', 'message'),
    [
        ('red: [DriveTo,', 'red: [DriveT,', "robots: red: there is no skill 'DriveT'; did you mean 'DriveTo'?"),
        (' {red', ' #{red', 'team.yaml:2:1: robots has to be a mapping'),
        (
            'red: [DriveTo, TakeCup, LeaveCup], blue: [DriveTo, TakeCup, LeaveCup]',
            '',
            'team.yaml:2:1: robots has to name one',
        ),
        ('red: [DriveTo, TakeCup, LeaveCup]', 'red: DriveTo', "robot red has to be a list, not 'DriveTo'"),
        ('red: [', "'r d': [", "team.yaml:2:1: robots: 'r d' cannot name a robot"),
        ('robot_at(red', 'robot_at(rod', "team.yaml:4:1: start: robot_at(rod, office): 'rod' is not an object"),
    ],
)
def test_what_is_wrong_with_a_team_is_told(team: Path, wrong: str, right: str, message: str) -> None:
    team.write_text(TEAM.replace(wrong, right, 1))
    done = tool('plan', str(team))
    assert done.code == 3, done.err
    assert message in done.err


def test_json_has_all_of_it(mission: Path) -> None:
    told = json.loads(tool('plan', str(mission), '--json').out)
    assert (told['outcome'], told['cost'], told['bound'], len(told['actions'])) == ('solved', 61.0, 61.0, 6)
    assert told['coverage']['complete'] is True
    assert told['tree'].startswith('<?xml')


def test_no_plan_is_an_answer(mission: Path) -> None:
    done = tool('plan', str(mission), '--goal', 'cup_at(kitchen) & cup_at(office)')
    assert (done.code, done.out) == (1, '')
    assert done.err.startswith('there is no plan: cup_at(kitchen) and cup_at(office) can never hold at once')
    # Once the cup has fallen into a gap there is no way; all else is planned.
    lost = MISSION.replace('  - [not open(kitchen_door)]', '  - [not cup_at(kitchen), not holding_cup]')
    mission.write_text(lost)
    done = tool('plan', str(mission), '-o', str(mission.with_suffix('.xml')))
    assert done.code == 0
    assert 'no way to the goal after: not cup_at(kitchen), not holding_cup' in done.err


def test_a_goal_may_be_nested(mission: Path) -> None:
    def cost(goal: str) -> object:
        return json.loads(tool('plan', str(mission), '--goal', goal, '--json').out)['cost']

    assert cost('(cup_at(hall) | cup_at(office)) & !(open(kitchen_door) & robot_at(hall))') == 61.0


@pytest.mark.parametrize(
    ('wrong', 'right', 'message'),
    [
        ('goal: cup_at(office)', 'goal: (robot_at(hall) | holding_cup', "cup.yaml:10:1: goal '(robot_at(hall) | hol"),
        ('cup_at(office)', 'cup_at(offce)', "cup.yaml:10:1: goal: cup_at(offce): 'offce' is not an object"),
        ('goal: cup_at(office)', 'goal: robot_at(hall) &', 'cup.yaml:10:1: goal '),
        ('goal: cup_at(office)', 'goal: küche(hall)', "cup.yaml:10:1: goal: 'küche(hall)' is not a literal"),
        ('robot_at(office)', 'robot_at(office', "cup.yaml:3:1: 'robot_at(office' is not a literal"),
        (
            'start:',
            'start:\n  - robot_at(hall)',
            'cup.yaml:3:1: start: robot_at(hall) and robot_at(office) cannot hold at once (robot_at is exclusive)',
        ),
        ('robot_at(office)', 'robotatoffice', 'cup.yaml:3:1: start: robotatoffice: there is no predicate'),
        ('[not open(kitchen_door)]', '[not opn(kitchen_door)]', 'cup.yaml:12:1: disturbance: not opn(kitchen_door)'),
        ('[not open(kitchen_door)]', '[]', 'cup.yaml:12:1: disturbance without literals'),
        ('start:', 'begin:', "cup.yaml:2:1: a mission cannot have 'begin'"),
        ('[cup_skills.yaml]', '[cup_skill.yaml]', 'cup.yaml:1:1: skills: there is no file '),
        ('[cup_skills.yaml]', 'cup_skills.yaml', 'cup.yaml:1:1: skills has to be a list'),
        (MISSION, '', 'cup.yaml:1:1: the text is empty'),
        (MISSION, '[', 'cup.yaml:1:1: no YAML'),
    ],
)
def test_what_is_wrong_is_told_with_its_place(mission: Path, wrong: str, right: str, message: str) -> None:
    mission.write_text(MISSION.replace(wrong, right, 1))
    done = tool('plan', str(mission))
    assert done.code == 3, done.err
    assert message in done.err


def test_wrong_words_are_refused(mission: Path) -> None:
    assert tool('plan', str(mission.with_name('none.yaml'))).code == 2
    for word in ('--goal', '--start'):
        assert tool('plan', str(mission), word, 'küche(hall)').err.startswith(f"{word}: 'küche(hall)' is not a literal")
    for words in (['--time-limit', '0'], ['--time-limit', 'nan'], ['--disturbed', '-1'], ['--name'], ['--name', 'a/b']):
        assert tool('plan', str(mission), *words).code == 2
    for words in (['-o', '\0'], ['--name', '\udcff', '-o', str(mission.with_name('tree.xml'))]):
        assert 'cannot be written: ' in tool('plan', str(mission), *words).err
    mission.write_bytes(b'goal: \xff')
    assert f'{mission}: cannot be read: byte 7 is not UTF-8' in tool('plan', str(mission)).err
    mission.write_text('skills: [cup_skills.yaml]')
    assert 'names no goal' in tool('plan', str(mission)).err


def test_a_scene_of_btpg(tmp_path: Path) -> None:
    scene = tmp_path / 'S.json'
    scene.write_text(json.dumps({'initial': ['Near(door)']}))
    lines = [
        {'name': 'Walk(cup)', 'pre': [], 'add': ['Near(cup)'], 'del': ['Near(door)'], 'cost': 15},
        {'name': 'Grab(\u2028)', 'pre': ['Near(cup)'], 'add': ['Holding(cup)'], 'del': [], 'cost': 5},
    ]
    actions = tmp_path / 'S.actions.jsonl.gz'
    written = '\n'.join(json.dumps(line, ensure_ascii=False) for line in lines)
    actions.write_bytes(gzip.compress(written.encode()))
    told = json.loads(tool('plan', str(scene), '--goal', 'Holding(cup)', '--json').out)
    assert (told['cost'], told['actions']) == (20.0, ['Walk(cup)', 'Grab(\u2028)'])
    assert tool('plan', str(scene)).code == 2
    assert 'no action needs or changes it' in tool('plan', str(scene), '--goal', 'Holding(mug)').err
    for wrong in ({'name': 3}, {**lines[0], 'cost': 10**400}):
        actions.write_bytes(gzip.compress(json.dumps(wrong).encode()))
        assert 'action 1: expected JSON with name' in tool('plan', str(scene), '--goal', 'Holding(cup)').err
    actions.write_bytes(gzip.compress(b'')[:10] + b'\xff' * 10)
    assert f'{actions}: cannot be read: ' in tool('plan', str(scene), '--goal', 'Holding(cup)').err

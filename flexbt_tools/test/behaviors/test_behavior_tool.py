# SPDX-License-Identifier: BSD-3-Clause
"""``behavior_tool`` as a user calls it, on the behaviors of the demonstrations."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from flexbt_testing.behavior_trees.bt_tool import behavior_tool as tool


def test_the_demonstrations_are_without_fault() -> None:
    done = tool('check', '--strict')
    assert (done.code, done.out) == (0, ''), done.out + done.err
    report = json.loads(tool('check', '--json', 'Navigate Split').out)
    assert report['findings'] == [] and report['summary']['info'] == 0


def test_errors_come_first_and_remarks_only_when_they_are_asked_for(tmp_path: Path) -> None:
    asks, wrong = tmp_path / 'asks.yaml', tmp_path / 'wrong.yaml'
    state = '{state: WaitState, parameters: {wait_time: 1.0}, transitions: {done: %s}, autonomy: {done: full}}'
    asks.write_text('machine:\n  outcomes: [finished]\n  states:\n    A: ' + state % 'finished' + '\n')
    wrong.write_text('machine:\n  outcomes: [finished]\n  states:\n    A: ' + state % 'nowhere' + '\n')
    folded = tool('check', str(asks), str(wrong))
    assert folded.code == 1 and 'info' not in folded.out and "leads to 'nowhere'" in folded.out
    assert folded.err == '2 behaviors: 1 error, 1 info; --remarks prints the info\n'
    told = tool('check', '--remarks', str(asks), str(wrong)).out.splitlines()
    assert ': error: ' in told[0] and told[-1].endswith('[always-asks]')


def test_a_wrong_parameter_is_found() -> None:
    done = tool('check', 'Navigate', '--param', 'tree=flexbt_demo_behaviors/navigate/recovery.xml')
    assert done.code == 0  # a warning: the tree is not given its goal
    assert '/Drive' in done.out and "'goal'" in done.out and '[unread-key]' in done.out
    assert done.err == '1 behavior: 1 warning\n'
    twice = tool('check', 'Navigate', 'Navigate', '--param', 'tree=flexbt_demo_behaviors/navigate/recovery.xml')
    assert twice.err == '2 behaviors: 2 warnings\n'
    assert (
        tool('check', 'Navigate', '--strict', '--param', 'tree=flexbt_demo_behaviors/navigate/recovery.xml').code == 1
    )
    done = tool('check', 'Navigate', '--param', 'tree=flexbt_demo_behaviors/navigate/none.xml')
    assert done.code == 1 and 'no such file' in done.out and '[refused]' in done.out
    done = tool('check', 'Navigate', '--param', 'three=x')
    assert done.code == 1 and "no parameter 'three'" in done.out


@pytest.mark.parametrize('words', [['show', 'Navigat'], ['draw', 'Navigate', '--param', 'tree'], ['show']])
def test_wrong_usage(words: list[str]) -> None:
    done = tool(*words)
    assert done.code == 2
    assert done.err and not done.out


def test_show_tells_every_transition() -> None:
    shown = json.loads(tool('show', 'Navigate Split', '--json').out)['states']
    text = tool('show', 'Navigate Split').out
    for state in shown[1:]:
        for outcome, target in zip(state['outcomes'], state['targets'], strict=True):
            assert f'{outcome} -> {target.removeprefix("/")}' in text


def test_mermaid_has_states_and_trees(tmp_path: Path) -> None:
    file = tmp_path / 'split.mmd'
    assert tool('draw', 'Navigate Split', '-o', str(file)).code == 0
    text = file.read_text()
    assert 'PlanPath' in text and 'ComputePathToPose' in text and 'canceled (Full)' not in text.split('JudgePath')[0]
    assert text.count('subgraph') == text.count(' end\n') == 4
    assert 'ComputePathToPose' not in tool('draw', 'Navigate Split', '--format', 'mermaid', '--no-trees').out


SVG = '{http://www.w3.org/2000/svg}'


def test_svg_nests_the_trees_and_keeps_the_order_of_their_nodes() -> None:
    root = ElementTree.fromstring(tool('draw', 'Navigate Split', '--expand').out)  # noqa: S314 of this program
    frames = [group for group in root.iter() if group.get('class') == 'cluster']
    assert len(frames) == 4 and not any(frame.find(f'{SVG}text') is not None for frame in frames)
    places: dict[str, list[float]] = {}
    for text in root.iter(f'{SVG}text'):
        places.setdefault(text.text or '', []).append(float(text.get('x', '')))
    assert {'PlanPath', 'runs tree GlobalPlanner', '● Navigate Split', 'finished'} <= places.keys()
    steps = ['Spin', 'Wait', 'BackUp']
    assert [places[step] for step in steps] == sorted(places[step] for step in steps)
    assert places['ComputePathToPose'] < places['ClearGlobalCostmap']


def test_a_comment_behind_a_state_is_its_reason_in_the_picture_and_other_text_is_not(tmp_path: Path) -> None:
    file = tmp_path / 'round.yaml'
    wait = '{state: WaitState, parameters: {wait_time: 1.0}, transitions: {done: %s}}'
    file.write_text(
        'behavior:\n  description: |\n    "Ready:  # asked at every\n    @home:  # and elsewhere\n'
        'machine:\n  outcomes: [finished]\n  states:\n'
        f"    A:  # the first one\n      {wait % 'on'}\n    'on':  # a name in quotes\n      {wait % 'finished'}\n"
    )
    picture = tool('draw', str(file), '--format', 'mermaid')
    assert 'the first one' in picture.out and 'a name in quotes' in picture.out, picture.err


def test_a_transition_into_a_container_ends_at_its_title_and_crosses_none() -> None:
    dot = tool('draw', 'Night Watch', '--format', 'dot', '--no-trees').out
    titles = dict(re.findall(r'(\w+) \[shape=plaintext, id=\1, class=entry, .*label="● ([^"]+)"', dot))
    assert len(titles) == dot.count('subgraph cluster_m') > 1 and 'label=""; style=rounded' in dot
    begins = re.findall(r'(\w+) -> (\w+) \[id=\w+begin', dot)
    assert {start for start, _ in begins} == titles.keys()
    assert any(f'-> {title} [' in dot for title in titles)
    assert '\\n"' not in dot and '\\n\\n' not in dot  # no line of a label is empty


def test_svg_tells_the_autonomy_by_the_style_of_lines_and_in_a_legend() -> None:
    root = ElementTree.fromstring(tool('draw', 'Navigate Split', '--no-trees').out)  # noqa: S314 of this program
    lines = {group.get('id'): group for group in root.iter(f'{SVG}g') if (group.get('class') or '').startswith('edge')}
    shown = json.loads(tool('show', 'Navigate Split', '--json').out)['states']
    styles = {}
    for place, state in enumerate(shown):
        for number, level in enumerate(state['autonomy'] if place else ()):
            line = lines[f's{place}o{number}']
            path = line.find(f'{SVG}path')
            assert path is not None
            assert line.get('class') == f'edge level{max(0, level)}'
            styles[max(0, level)] = (path.get('stroke-dasharray'), path.get('stroke-width'))
    assert len(set(styles.values())) == len(styles) == 4  # without colours, too
    [legend] = [group for group in root.iter(f'{SVG}g') if group.get('class') == 'legend']
    told = [text.text for text in legend.iter(f'{SVG}text')]
    assert told[:2] == ['state', 'outcome of the machine'] and len(told) == 2 + len(styles)

# SPDX-License-Identifier: BSD-3-Clause
"""Plans and machines for goals, earlier versions from git, and models of node types, by the server of the studio."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest
from test_studio_server import Page, Refused, with_pages

from flexbt_studio.documents.xml_document import XmlDocument
from flexbt_studio.documents.yaml_document import YamlDocument
from flexbt_studio.errors import StudioError
from flexbt_studio.server import proposals
from flexbt_studio.server.proposals import with_result
from flexbt_studio.server.versions import revisions, text_at
from flexbt_studio.server.workbench import Workbench

TREE = '<root BTCPP_format="4">\r\n\t<BehaviorTree ID="Main">\r\n\t\t<Spin/>\r\n\t</BehaviorTree>\r\n</root>\r\n'
SKILLS = """\
objects: {hall: place, office: place, cellar: place}
predicates:
  at: {parameters: {where: place}, exclusive: where}
  joined: {parameters: {from: place, to: place}}
skills:
  GoTo:
    parameters: {from: place, to: place}
    preconditions: ['joined(from, to)', at(from)]
    outcomes: {SUCCESS: [at(to)]}
    arguments: {to: $to}
    cost: 10.0
"""
MISSION = 'skills: [skills.yaml]\nstart: [at(hall), "joined(hall, office)"]\ngoal: at(office)  # to work\n'
CAPABILITIES = """\
name: fetch
state_outcome_mappings: {done: completed, failed: failure}
sm_outcome_mappings: {finished: finished}
capabilities:
  drive:
    interface: OperatorDecisionState
    parameters: {outcomes: [done, failed], hint: 'There?'}
    postconditions: [drive]
  grasp:
    interface: OperatorDecisionState
    parameters: {outcomes: [done, failed], hint: 'Has it?'}
    preconditions: [drive]
    postconditions: [grasp]
"""
MACHINE = """\
# Ours.
behavior:
  name: Fetch
machine:
  outcomes: [finished]
  states:
    Wait:
      state: WaitState
      parameters: {wait_time: 1.0}
      transitions: {done: finished}
# The end.
"""
FOREIGN = """\
<root BTCPP_format="4">
  <BehaviorTree ID="Foreign"><Sequence><OpenGripper width="{w}"/></Sequence></BehaviorTree>
  <TreeNodesModel>
    <Action ID="OpenGripper">
      <input_port name="width" type="double" default="0.1">how wide, m</input_port>
    </Action>
    <Condition ID="IsOpen"/>
    <SubTree ID="Foreign"><input_port name="w"/></SubTree>
  </TreeNodesModel>
</root>
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    project = tmp_path / 'project'
    (project / 'goals').mkdir(parents=True)
    for name, text in (
        ('main.xml', TREE),
        ('machine.yaml', MACHINE),
        ('goals/skills.yaml', SKILLS),
        ('goals/mission.yaml', MISSION),
        ('goals/fetch.yaml', CAPABILITIES),
    ):
        (project / name).write_bytes(text.encode())
    return project


async def result_of(page: Page, **arguments: Any) -> dict[str, Any]:
    """Return the event of the end of a job."""
    number = (await page.ask('start_job', file='', version=0, **arguments))['number']
    return await page.event('job', number=number)


def test_a_plan_becomes_a_change_of_the_open_file(folder: Path) -> None:
    async def story(page: Page) -> None:
        asked = await page.ask('goals')
        assert [(one['job'], one['source'], one['goal'], one['words']) for one in asked] == [
            ('synthesize', 'goals/fetch.yaml', '', ['drive', 'grasp']),
            ('plan', 'goals/mission.yaml', 'at(office)', []),
        ]
        await page.ask('open', file='main.xml')
        for name, ids in (('', ['Main', 'Plan']), ('Main', ['Main'])):
            event = await result_of(page, job='plan', source='goals/mission.yaml', name=name)
            text = await page.ask('with_result', file='main.xml', result=event['result'][0]['tree'])
            document = XmlDocument(text)
            assert not document.problems and list(document.trees) == ids
            assert '<GoTo' in text and '<Action ID="GoTo">' in text and '\r' not in text
            assert ('<Spin/>' in text) == (name == '')
        assert (folder / 'main.xml').read_bytes() == TREE.encode()

    with_pages(folder, story)


def test_why_there_is_no_plan_is_told_with_its_place(folder: Path) -> None:
    async def story(page: Page) -> None:
        mission = {'job': 'plan', 'source': 'goals/mission.yaml'}
        (folder / 'goals' / 'wrong.yaml').write_text(MISSION.replace('start:', 'strat:').replace('goal', '\ngoal'))
        asked: list[tuple[dict[str, Any], str]] = [
            ({**mission, 'goal': 'at(cellar)'}, 'at(cellar)'),
            ({**mission, 'goal': '--help'}, "'--help'"),
            ({**mission, 'source': 'goals/wrong.yaml'}, 'goals/wrong.yaml:2 '),
            ({'job': 'synthesize', 'source': 'goals/fetch.yaml', 'goal': 'grasp & !grasp'}, 'grasp'),
        ]
        numbers = [(await page.ask('start_job', file='', version=0, **arguments))['number'] for arguments, _ in asked]
        for number, (_, told) in zip(numbers, asked, strict=True):
            event = await page.event('job', number=number)
            found = [f'{one["file"]}:{one["line"]} {one["message"]}' for one in event['result'][0]['findings']]
            assert told in ' '.join(found)
        for wrong in ({'source': '../secret.yaml'}, {'source': 'main.xml'}, {'goal': 'x' * 7_000_000}):
            with pytest.raises(Refused, match=r'choose another|at most'):
                await page.ask('start_job', file='', version=0, **{**mission, **wrong})
        with pytest.raises(Refused, match='unexpected keyword'):
            await page.ask('start_job', file='', version=0, **mission, command='x')

    with_pages(folder, story)


def test_a_synthesized_machine_takes_the_place_of_the_machine_and_leaves_the_rest(folder: Path) -> None:
    async def story(page: Page) -> None:
        (folder / 'goals' / 'request.yaml').write_text('goals: [grasp]\nsm_outcomes: [finished]\n')
        assert {'goals/request.yaml', ''} == {one['request'] for one in await page.ask('goals')}
        event = await result_of(page, job='synthesize', source='goals/fetch.yaml', request='goals/request.yaml')
        await page.ask('open', file='machine.yaml')
        text = await page.ask('with_result', file='machine.yaml', result=event['result'][0]['machine'])
        assert text.startswith(MACHINE[: MACHINE.index('machine:')]) and text.endswith('# The end.\n')
        assert 'grasp:' in text and 'WaitState' not in text
        await page.ask('open', file='main.xml')
        with pytest.raises(Refused):  # a machine has no place in a file of trees
            await page.ask('with_result', file='machine.yaml', result=event['result'][0]['machine'][:20])

    with_pages(folder, story)


def test_a_tool_that_is_killed_is_told_and_the_next_one_runs(folder: Path) -> None:
    async def story(page: Page) -> None:
        number = (await page.ask('start_job', file='', version=0, job='plan', source='goals/mission.yaml'))['number']
        children = Path(f'/proc/self/task/{os.getpid()}/children')
        while not (found := [int(one) for one in children.read_text().split() if b'plan' in _words(int(one))]):
            await asyncio.sleep(0.01)
        os.kill(found[0], signal.SIGKILL)
        event = await page.event('job', number=number)
        assert event['state'] == 'failed' and 'signal 9' in event['message']
        assert (await result_of(page, job='plan', source='goals/mission.yaml'))['state'] == 'done'

    with_pages(folder, story)


def _words(process: int) -> bytes:
    try:
        return Path(f'/proc/{process}/cmdline').read_bytes()
    except OSError:
        return b''


def test_without_flexbt_formal_the_command_says_what_to_install(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Nothing:
        names: frozenset[str] = frozenset()

    monkeypatch.setattr(proposals, 'entry_points', lambda group: Nothing())
    with pytest.raises(StudioError, match=r'needs the package flexbt_formal.*colcon build'):
        Workbench(folder).answer('goals', {})


def test_a_project_without_missions_says_what_is_needed(tmp_path: Path) -> None:
    (tmp_path / 'broken.yaml').write_bytes(b'goal: \xff\xfe')
    with pytest.raises(StudioError, match='a plan needs a mission'):
        Workbench(tmp_path).answer('goals', {})


@pytest.mark.parametrize('text', ['', '<root', '<root BTCPP_format="4"/>', '<root BTCPP_format="4"></root>\n', TREE])
def test_trees_are_put_into_any_text_that_has_a_root(text: str) -> None:
    trees = [
        '<BehaviorTree ID="A">\n    <Spin/>\n  </BehaviorTree>',
        '<BehaviorTree ID="B">\n    <Wait/>\n  </BehaviorTree>',
    ]
    made = '\n  '.join(['<root BTCPP_format="4">', *trees]) + '\n</root>\n'
    try:
        found = with_result(XmlDocument(text), made)
    except StudioError as error:
        assert '<root' in str(error) or 'cannot be' in str(error)
        return
    document = XmlDocument(found)
    assert not document.problems and {'A', 'B'} <= set(document.trees)
    assert with_result(document, made) == found  # once more changes nothing


SYNTHESIZED = '# made\nmachine:\n  outcomes: [ok]\n  states: {}\n'


@pytest.mark.parametrize(
    ('machine', 'rest'),
    [
        ('machine:\n  outcomes: [a]  # one\n  # two', '\n\n# three\n'),
        ('machine: {\n  outcomes: [a],\n  states: {}\n}', '\nbehavior: {name: X}\n'),
        ('"machine":\n  outcomes: [a]\n  states: {A: {state: S, parameters: {text: "x\n\ny"}}}', ''),
        ('machine:\r\n  outcomes:\r\n  - a', '\r\n...\r\n'),
    ],
)
def test_a_machine_takes_the_place_of_the_whole_machine_in_whatever_form(machine: str, rest: str) -> None:
    for before in ('', '\ufeff', '# a\n'):
        found = with_result(YamlDocument(f'{before}{machine}{rest}'), SYNTHESIZED)
        made = SYNTHESIZED.partition('\n')[2].rstrip('\n')
        assert found.replace('\r\n', '\n') == f'{before}{made}{rest}'.replace('\r\n', '\n')
        assert '\r' not in machine or before == '# a\n' or found.count('\n') == found.count('\r')
    for text in (f'{{{machine}}}', f'  {machine}\n', 'behavior: {}', f'{machine}\n - : ['):
        with pytest.raises(StudioError, match='make a new file'):
            with_result(YamlDocument(text), SYNTHESIZED)


# Versions from git.


def git(folder: Path, *words: str) -> None:
    author = ['-c', 'user.name=A', '-c', 'user.email=a@example.org', '-c', 'commit.gpgSign=false']
    subprocess.run(['git', *author, *words], cwd=folder, check=True, capture_output=True)


@pytest.fixture
def repository(folder: Path) -> Path:
    git(folder, 'init', '-q')
    git(folder, 'add', '.')
    git(folder, 'commit', '-q', '-m', 'First; "quoted"')
    git(folder, 'mv', 'main.xml', 'größer – .xml')
    git(folder, 'commit', '-q', '-m', 'Renamed')
    (folder / 'größer – .xml').write_bytes(TREE.replace('Spin', 'Wait').encode())
    git(folder, 'commit', '-q', '-a', '-m', 'Changed')
    return folder


def test_the_versions_of_a_file_are_found_also_under_its_former_name(repository: Path) -> None:
    file = repository / 'größer – .xml'
    for is_deleted in (False, True):
        if is_deleted:
            file.unlink()
        found = revisions(file)
        assert [(one['subject'], one['name']) for one in found] == [
            ('Changed', 'größer – .xml'), ('Renamed', 'größer – .xml'), ('First; "quoted"', 'main.xml'),
        ]  # fmt: skip
        texts = [text_at(file, one['revision'], one['name']) for one in found]
        now = TREE.replace('\r\n', '\n')
        assert texts == [now.replace('Spin', 'Wait'), now, now]
    for revision, name in (('HEAD', 'main.xml'), ('--help', 'main.xml'), (found[0]['revision'], 'goals/fetch.yaml')):
        with pytest.raises(StudioError, match='is no revision'):
            text_at(file, revision, name)
    with pytest.raises(StudioError, match='git: '):
        text_at(file, 'a' * 40, 'main.xml')


def test_a_merge_that_was_resolved_is_a_version_and_a_name_may_have_a_quote(folder: Path) -> None:
    file = folder / 'a "b".xml'
    git(folder, 'init', '-q', '-b', 'one')

    def commit(text: str, *words: str) -> None:
        file.write_text(text)
        git(folder, 'add', file.name)
        git(folder, 'commit', '-q', '-m', text, *words)

    commit('first')
    git(folder, 'branch', 'two')
    commit('ours')
    git(folder, 'checkout', '-q', 'two')
    commit('theirs')
    with pytest.raises(subprocess.CalledProcessError):
        git(folder, 'merge', 'one')
    commit('both')
    found = revisions(file)
    assert found[0]['subject'] == 'both' and {one['subject'] for one in found} == {'both', 'ours', 'theirs', 'first'}
    assert all(text_at(file, one['revision'], one['name']) == one['subject'] for one in found)


def test_what_git_has_no_version_of_says_so(tmp_path: Path, repository: Path) -> None:
    (repository / 'new.xml').write_text(TREE)
    with pytest.raises(StudioError, match='no revision in git yet'):
        revisions(repository / 'new.xml')
    with pytest.raises(StudioError, match='no git repository'):
        revisions(tmp_path / 'elsewhere.xml')
    (repository / 'goals' / 'mission.yaml').write_bytes(b'\xff\xfe')
    git(repository, 'commit', '-q', '-a', '-m', 'Binary')
    [last, _] = revisions(repository / 'goals' / 'mission.yaml')
    with pytest.raises(StudioError, match='no text in UTF-8'):
        text_at(repository / 'goals' / 'mission.yaml', last['revision'], last['name'])


def test_nothing_of_a_repository_is_executed(tmp_path: Path, repository: Path) -> None:
    mark = tmp_path / 'executed'
    program = repository / 'program.sh'
    program.write_text(f'#!/bin/sh\ntouch "{mark}"\ncat\n')
    program.chmod(0o755)
    found = revisions(repository / 'größer – .xml')
    (repository / '.gitattributes').write_text('* diff=evil filter=evil merge=evil textconv\n')
    for hook in ('post-checkout', 'post-index-change', 'reference-transaction', 'fsmonitor-watchman'):
        (repository / '.git' / 'hooks' / hook).write_bytes(program.read_bytes())
        (repository / '.git' / 'hooks' / hook).chmod(0o755)
    settings = (
        *('core.fsmonitor', 'core.pager', 'core.editor', 'core.sshCommand', 'core.askPass', 'pager.log', 'gpg.program'),
        *('diff.external', 'diff.evil.textconv', 'diff.evil.command', 'filter.evil.smudge', 'filter.evil.clean'),
        *('alias.log', 'alias.cat-file', 'remote.evil.uploadpack', 'filter.evil.process', 'credential.helper'),
    )
    for one in settings:
        git(repository, 'config', one, f'!{program}' if one.startswith('alias') else str(program))
    for key, value in (
        ('log.showSignature', 'true'), ('extensions.partialClone', 'evil'), ('remote.evil.promisor', 'true'),
        ('remote.evil.url', f'ext::{program}'), ('protocol.ext.allow', 'always'), ('core.repositoryFormatVersion', '1'),
    ):  # fmt: skip
        git(repository, 'config', key, value)
    assert not mark.exists()
    assert revisions(repository / 'größer – .xml') == found
    text_at(repository / 'größer – .xml', found[0]['revision'], found[0]['name'])
    with pytest.raises(StudioError):  # not even to fetch what is missing
        text_at(repository / 'größer – .xml', 'b' * 40, 'main.xml')
    assert not mark.exists()


def test_pages_ask_for_versions_and_their_picture(repository: Path) -> None:
    async def story(page: Page) -> None:
        opened = await page.ask('open', file='größer – .xml')
        [_, _, first] = await page.ask('revisions', file='größer – .xml')
        before = await page.ask('text_at', file='größer – .xml', revision=first['revision'], name=first['name'])
        found = await page.ask('compared', file='größer – .xml', before=before, after=opened['text'])
        assert [(one['path'], one['kinds'], one['lines']) for one in found['changes']] == [
            ('Main/0', ['changed'], ['type: Spin → Wait'])
        ]
        assert found['layout'] is None
        machine = MACHINE.replace('done: finished', 'done: Wait')
        found = await page.ask('compared', file='machine.yaml', before=MACHINE, after=machine)
        assert found['marks'] == {'/Wait#done': ['changed']} and '/Wait' in found['layout']['states']
        broken = await page.ask('compared', file='main.xml', before='<root', after='')
        assert broken['problems']
        for wrong in ({'file': '../x.xml'}, {'file': 1}, {}):
            with pytest.raises(Refused):
                await page.ask('revisions', **wrong)
        with pytest.raises(Refused, match='too many for a picture'):
            await page.ask('compared', file='main.xml', before='x' * 3_000_000, after='x' * 3_000_000)
        with pytest.raises(Refused, match='files of this kind'):
            await page.ask('compared', file='main.txt', before='', after='')

    with_pages(repository, story)


# Models of node types.


def test_models_are_written_for_other_editors(folder: Path) -> None:
    workbench = Workbench(folder)
    assert '<Action ID="Spin">' in workbench.answer('models', {'file': 'main.xml', 'into': False})
    text = workbench.answer('models', {'file': 'main.xml', 'into': True})
    assert [one['id'] for one in XmlDocument(text).view()['models']] == ['Spin']
    opened = workbench.project.open('main.xml')
    workbench.project.adopt('main.xml', text)
    assert workbench.answer('models', {'file': 'main.xml', 'into': True}) == text, 'they are there already'
    assert list(opened.document.problems) == []
    everything = XmlDocument(workbench.answer('models', {'file': '', 'into': False})).view()['models']
    assert {'Spin', 'FollowPath'} <= {one['id'] for one in everything} and 'Sequence' not in {
        one['id'] for one in everything
    }


def test_an_imported_palette_is_known_now_and_after_the_next_start(folder: Path) -> None:
    (folder / 'foreign.xml').write_text(FOREIGN)
    workbench = Workbench(folder)
    assert any(one['severity'] == 'error' for one in workbench.answer('findings', {'file': 'foreign.xml'}))
    made = workbench.answer('import_models', {'file': 'palette.xml', 'text': FOREIGN})
    assert made['added'] == ['OpenGripper', 'IsOpen'] and made['problems'] == []
    [gripper] = [one for one in made['types'] if one['id'] == 'OpenGripper']
    assert not gripper['installed'] and [port['name'] for port in gripper['ports']] == ['width']
    with pytest.raises(StudioError, match='exists already'):
        workbench.answer('import_models', {'file': 'palette.xml', 'text': FOREIGN})
    with pytest.raises(StudioError, match='no <TreeNodesModel>'):
        workbench.answer('import_models', {'file': 'other.xml', 'text': TREE})
    workbench.project.save('palette.xml', 1)
    (folder / 'broken.xml').write_text('<root><TreeNodesModel><Action ID="A"')
    for one in (workbench, Workbench(folder)):
        assert not any(found['severity'] == 'error' for found in one.answer('findings', {'file': 'foreign.xml'}))
        copy = one.job_copy('prove', 'foreign.xml')
        assert [one for one in copy.words if '.xml' in one] == ['--models=palette.xml', 'foreign.xml']
        assert (Path(copy.folder.name) / 'palette.xml').exists()
        copy.folder.cleanup()
    (folder / 'binary.xml').write_bytes(b'<root><TreeNodesModel>\xff')
    assert proposals.palette_files(workbench.project) == ['palette.xml']


def test_a_proof_is_about_all_files_that_it_reads(tmp_path: Path) -> None:
    tree = '<root BTCPP_format="4" main_tree_to_execute="{0}"><BehaviorTree ID="{0}">{1}</BehaviorTree>{2}</root>'
    other = '<BehaviorTree ID="Other"><SubTree ID="Far"/></BehaviorTree>'
    (tmp_path / 'main.xml').write_text(tree.format('Main', '<AlwaysSuccess/>', other))
    (tmp_path / 'far.xml').write_text(tree.format('Far', '<AlwaysSuccess/>', ''))
    (tmp_path / 'unused.xml').write_text(tree.format('Unused', '<AlwaysSuccess/>', ''))
    (tmp_path / 'palette.xml').write_text(FOREIGN.replace('BehaviorTree', 'Ignored'))
    package = tmp_path / 'ws' / 'rounds'
    package.mkdir(parents=True)
    for name in ('__init__.py', 'helper.py'):
        (package / name).write_text('')
    (package / 'watch.py').write_text('class Watch:\n    pass\n')
    workbench = Workbench(tmp_path)
    for file, expected in (
        ('main.xml', {'main.xml', 'far.xml', 'palette.xml'}),
        ('ws/rounds/watch.py', {f'ws/rounds/{one}' for one in ('__init__.py', 'helper.py', 'watch.py')}),
    ):
        copy = workbench.job_copy('prove', file)
        copy.folder.cleanup()
        assert set(copy.files) == expected

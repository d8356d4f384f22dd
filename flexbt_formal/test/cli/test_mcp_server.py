# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool mcp`` over real standard streams, with the client of the SDK: each tool, wrong calls, limits, faults."""

from __future__ import annotations

import asyncio
import json
import os
import re
import signal
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

mcp = pytest.importorskip('mcp')

from mcp.client.stdio import StdioServerParameters, stdio_client  # noqa: E402
from mcp.shared.exceptions import MCPError  # noqa: E402

from flexbt_testing.behavior_trees.bt_tool import document  # noqa: E402
from flexbt_testing.behavior_trees.bt_tool import tool as bt_tool  # noqa: E402
from flexbt_tools.cli.confined import MAX_FILE  # noqa: E402

DOCS = Path(__file__).parents[3] / 'docs' / 'how_to'
SKILLS, MISSION = re.findall(r'^```yaml\n(.*?)^```$', (DOCS / 'goals.md').read_text('utf-8'), re.M | re.S)[:2]
[CAPABILITIES] = re.findall(
    r'^```yaml\n(name: fetch\n.*?)^```$', (DOCS / 'synthesis.md').read_text('utf-8'), re.M | re.S
)
DELIVER = document(
    'Main: <Fallback><Sequence><ComputePathToPose goal="{goal}" path="{path}"/><FollowPath path="{path}"/></Sequence>'
    '<Wait wait_duration="2"/></Fallback>'
)
PATIENCE = 300.0
"""For what a busy machine may take long for, s."""


class Server:
    """A running server, and the client that calls it."""

    def __init__(self, client: Any, pid: int) -> None:
        self.client, self.pid = client, pid

    async def call(self, tool: str, **arguments: Any) -> Any:
        """Return what a tool answers. A refusal is an AssertionError with its text."""
        done = await self.client.call_tool(tool, arguments)
        text = '\n'.join(part.text for part in done.content)
        assert not done.is_error, text
        answer = done.structured_content
        return answer['result'] if set(answer) == {'result'} else answer

    async def refusal(self, tool: str, **arguments: Any) -> str:
        done = await self.client.call_tool(tool, arguments)
        assert done.is_error, done.structured_content
        return '\n'.join(part.text for part in done.content)

    async def child(self) -> int:
        """Wait for a process that works for the server, and has limited itself, and return it."""
        return (
            await until(lambda: [one for one in children(self.pid) if str(MAX_FILE) in text(f'/proc/{one}/limits')])
        )[0]


@asynccontextmanager
async def serving(folder: Path, seconds: int = 600) -> AsyncIterator[Server]:
    before = set(children(os.getpid()))
    words = ['mcp', str(folder), '--seconds', str(seconds)]
    async with mcp.Client(
        stdio_client(StdioServerParameters(command='bt_tool', args=words, env=dict(os.environ)))
    ) as client:
        [pid] = set(children(os.getpid())) - before
        yield Server(client, pid)


def children(pid: int) -> list[int]:
    with suppress(OSError):
        return [
            int(one) for task in Path(f'/proc/{pid}/task').iterdir() for one in (task / 'children').read_text().split()
        ]
    return []


def is_alive(pid: int) -> bool:
    return text(f'/proc/{pid}/stat').rpartition(')')[2].split()[:1] not in ([], ['Z'], ['X'])


def text(file: str) -> str:
    with suppress(OSError):
        return Path(file).read_text()
    return ''


async def until(condition: Callable[[], Any]) -> Any:
    end = time.monotonic() + PATIENCE
    while not (found := condition()):
        assert time.monotonic() < end, 'it has not come'
        await asyncio.sleep(0.02)
    return found


def run(test: Coroutine[Any, Any, None]) -> None:
    asyncio.run(test)


def test_each_tool(tmp_path: Path) -> None:
    async def test() -> None:
        async with serving(tmp_path) as server:
            call = server.call
            await call('write_file', file='a/deliver.xml', text=DELIVER)
            for name, text in (('cup_skills.yaml', SKILLS), ('cup.yaml', MISSION), ('fetch.yaml', CAPABILITIES)):
                await call('write_file', file=name, text=text)
            (tmp_path / 'no text \udcff.xml').touch()  # as a file of a computer that does not write UTF-8
            assert await call('list_files') == ['cup.yaml', 'cup_skills.yaml', 'fetch.yaml', 'a/deliver.xml']
            assert await call('read_file', file='a/deliver.xml') == DELIVER
            assert {'FollowPath', 'Sequence'} <= {one['name'] for one in await call('list_node_types')}
            [type] = await call('list_node_types', names=['FollowPath'])
            assert type['kind'] == 'Action'
            assert ('input', 'path') in {(port['direction'], port['name']) for port in type['ports']}
            assert all('batter' in json.dumps(one).lower() for one in await call('list_node_types', search='Batter'))
            skills = await call('list_skills', names=['GoThrough'], skills=['cup_skills.yaml'])
            assert skills['skills']['GoThrough']['cost'] == 15.0

            checked = await call('check_tree', files=['a/deliver.xml'])
            assert (checked['verdict'], checked['findings']) == ('ok', [])
            ran = await call('run_tree', files=['a/deliver.xml'], blackboard={'goal': 'g'})
            assert (ran['result'], ran['time'], ran['blackboard']['']['goal']) == ('SUCCESS', 0.0, 'g')
            given = {'goal': '\U0001f916\x85', 'least': 1e-07, 'all': [1e22, {'a': 'no'}, None]}
            board = (await call('run_tree', files=['a/deliver.xml'], blackboard=given))['blackboard']['']
            assert {key: board[key] for key in given} == given
            ran = await call(
                'run_tree',
                files=['a/deliver.xml'],
                mocks={'*': ['SUCCESS'], 'Follow*': ['FAILURE'], 'Wait': ['FAILURE']},
            )
            assert (ran['verdict'], ran['result']) == ('negative', 'FAILURE') and 'Wait' in ran['reasons'][0]
            proved = await call('prove_tree', files=['a/deliver.xml'], given=['goal'])
            assert (proved['verdict'], proved['findings']) == ('ok', [])
            proved = await call('prove_tree', files=['a/deliver.xml'], require=['never Wait'])
            assert proved['verdict'] == 'negative' and 'Wait' in proved['findings'][0]['message']
            assert proved['proofs'][0]['wrong'][0]['way']
            assert 'FollowPath' in await call('draw_tree', file='a/deliver.xml')

            planned = await call('plan_tree', mission='cup.yaml', output='cup.xml')
            assert planned['cost'] == 61.0 and await call('read_file', file='cup.xml') == planned['tree']
            planned = await call('plan_tree', mission='cup.yaml', goal='cup_at(office) & cup_at(hall)')
            assert planned['verdict'] == 'negative' and 'can never hold at once' in planned['findings'][0]['message']

            assert (await call('check_behavior', behavior='Navigate'))['verdict'] == 'ok'
            made = await call(
                'synthesize_machine',
                capabilities='fetch.yaml',
                goals=['hand_over'],
                initial=['place=dock'],
                retries=2,
                output='machine.yaml',
            )
            assert made['realizable'] and made['machine'] == await call('read_file', file='machine.yaml')
            proved = await call(
                'prove_behavior', behavior='machine.yaml', require=['/hand_over only after /grasp > done']
            )
            assert proved['verdict'] == 'ok'
            assert 'hand_over' in await call('draw_behavior', behavior='machine.yaml')

            tools = (await server.client.list_tools()).tools
            assert len(tools) == 14 and all(len(one.description) > 30 and '  ' not in one.description for one in tools)

    run(test())


def test_wrong_calls_say_what_to_do(tmp_path: Path) -> None:
    async def test() -> None:
        async with serving(tmp_path) as server:
            (tmp_path / 'deliver.xml').write_text(DELIVER)
            huge = 'x' * 10_000_000
            calls: list[tuple[str, dict[str, Any], str]] = [
                ('chek_tree', {}, "did you mean 'check_tree'?"),
                ('check_tree', {'file': 'deliver.xml'}, "did you mean 'files'?"),
                ('check_tree', {}, 'Field required'),
                ('check_tree', {'files': 'deliver.xml'}, 'should be a valid tuple'),
                ('check_tree', {'files': [huge]}, 'at most 500 characters'),
                ('check_tree', {'files': ['deliver.xml'] * 51}, 'at most 50 items'),
                ('check_tree', {'files': ['no\0.xml']}, 'not in the folder'),
                ('check_tree', {'files': ['deliver.xml'], 'inputs': ['\0']}, 'that no text may have'),
                ('check_tree', {'files': ['deliver.py']}, 'not a visible file that ends with .xml'),
                ('write_file', {'file': 'a.xml', 'text': huge}, 'at most 1000000 characters'),
                ('write_file', {'file': '.github/workflows/a.yml', 'text': ''}, 'not a visible file'),
                ('write_file', {'file': 'deliver.xml/a.xml', 'text': ''}, 'cannot be written: '),
                ('read_file', {'file': 'a.xml'}, 'cannot be read: No such file'),
                ('list_node_types', {'names': ['FolowPath']}, "did you mean 'FollowPath'?"),
                ('list_skills', {'names': ['Spn']}, "did you mean 'Spin'?"),
                ('run_tree', {'files': ['deliver.xml'], 'mocks': {'Wait': ['real']}}, "'SUCCESS', 'FAILURE'"),
                ('run_tree', {'files': ['deliver.xml'], 'timeout': -1}, 'greater than 0'),
                ('run_tree', {'files': ['deliver.xml'], 'blackboard': {'a': huge}}, 'longer than 100000 characters'),
                ('run_tree', {'files': ['deliver.xml'], 'mocks': {huge: ['SUCCESS']}}, 'at most 500 characters'),
                ('draw_tree', {'file': 'deliver.xml', 'tree': 'Man'}, 'Main'),
                ('check_behavior', {'behavior': '--help'}, 'not the name of a behavior'),
                ('check_behavior', {'behavior': 'below/code.py'}, 'not the name of a behavior'),
                ('prove_tree', {'files': ['deliver.xml'], 'faults': 4}, 'less than or equal to 3'),
            ]
            for tool, arguments, words in calls:
                refusal = await server.refusal(tool, **arguments)
                assert words in refusal and len(refusal) < 6000, (tool, words, refusal)
            calls = [
                ('check_tree', {'files': ['nowhere.xml']}, 'cannot be read: No such file'),
                ('check_tree', {'files': ['deliver.xml'], 'models': ['-']}, ''),
                ('run_tree', {'files': ['deliver.xml'], 'mocks': {'Wat': ['SUCCESS']}}, "did you mean 'Wait'?"),
                ('prove_tree', {'files': ['deliver.xml'], 'require': ['never Wat']}, "did you mean 'Wait'?"),
                ('plan_tree', {'mission': 'nowhere.yaml'}, 'cannot be read'),
                ('check_behavior', {'behavior': 'Navgate'}, 'Navigate'),
                ('synthesize_machine', {'capabilities': 'deliver.yaml', 'goals': ['x']}, 'cannot be read'),
            ]
            for tool, arguments, words in calls:
                if words:
                    answer = await server.call(tool, **arguments)
                    assert answer['verdict'] != 'ok' and words in json.dumps(answer['findings']), (tool, answer)
                else:
                    await server.refusal(tool, **arguments)
            assert sorted(tmp_path.iterdir()) == [tmp_path / 'deliver.xml']

    run(test())


def test_nothing_outside_of_the_folder_is_read_or_written(tmp_path: Path) -> None:
    """Neither by names of files, nor through what files in the folder make a command do."""
    folder, outside = tmp_path / 'missions', tmp_path / 'outside'
    folder.mkdir()
    outside.mkdir()
    for name in ('tree.xml', 'skills.yaml', 'machine.yaml'):
        (outside / name).write_text('SECRET of nobody else: [')
    (folder / 'link.xml').symlink_to(outside / 'tree.xml')
    (folder / 'below').symlink_to(outside)
    (folder / 'deliver.xml').write_text(DELIVER)
    (folder / 'include.xml').write_text(
        f'<root BTCPP_format="4" main_tree_to_execute="M"><include path="{outside}/tree.xml"/>'
        '<include path="../outside/tree.xml"/><BehaviorTree ID="M"><AlwaysSuccess/></BehaviorTree></root>'
    )
    (folder / 'root.xml').write_text(
        f'<root BTCPP_format="4" main_tree_to_execute="M"><include path="/proc/self/root{outside}/tree.xml"/>'
        '<BehaviorTree ID="M"><AlwaysSuccess/></BehaviorTree></root>'
    )
    (folder / 'reach.xml').write_text(document(f'Main: <ReachGoal mission="{outside}/skills.yaml" goal="x"/>'))
    (folder / 'mission.yaml').write_text(f'skills: [{outside}/skills.yaml]\ngoal: x\n')
    (folder / 'machine.yaml').write_text(
        'machine: {outcomes: [done, failed], states: {Load: {state: BtLoaderState, parameters: '
        f'{{filepaths: ["{outside}/tree.xml"]}}, transitions: {{done: done, failed: failed}}}}}}}}'
    )
    before = {path: path.read_bytes() for path in outside.iterdir()}

    async def test() -> None:
        async with serving(folder) as server:
            for tool, arguments in (
                ('read_file', {'file': '../outside/tree.xml'}),
                ('read_file', {'file': f'{outside}/tree.xml'}),
                ('read_file', {'file': 'link.xml'}),
                ('read_file', {'file': 'below/tree.xml'}),
                ('write_file', {'file': 'link.xml', 'text': 'x'}),
                ('write_file', {'file': 'below/new.xml', 'text': 'x'}),
                ('check_tree', {'files': ['below/tree.xml']}),
                ('check_tree', {'files': ['link.xml']}),
                ('check_tree', {'files': ['deliver.xml'], 'skills': ['below/skills.yaml']}),
                ('plan_tree', {'mission': 'mission.yaml', 'output': 'below/tree.xml'}),
                ('draw_behavior', {'behavior': 'below/machine.yaml'}),
            ):
                assert 'is not in the folder of this server' in await server.refusal(tool, **arguments), arguments
            found = []
            for tool, arguments in (
                ('check_tree', {'files': ['include.xml']}),
                ('check_tree', {'files': ['root.xml']}),
                (
                    'check_tree',
                    {'files': [f'package://flexbt_demo_behaviors/../../../../../../../../{outside}/tree.xml']},
                ),
                ('check_tree', {'files': ['reach.xml']}),
                ('plan_tree', {'mission': 'mission.yaml'}),
                ('check_behavior', {'behavior': 'machine.yaml'}),
            ):
                answer = await server.call(tool, **arguments)
                assert 'SECRET' not in json.dumps(answer) and answer['findings'], answer
                found.append(json.dumps(answer['findings']))
            reasons = ('not in the folder of this server', "must not contain '..'")
            assert [one for one in found if not any(reason in one for reason in reasons)] == []

    run(test())
    assert {path: path.read_bytes() for path in outside.iterdir()} == before


def test_several_at_once_and_one_that_is_canceled(tmp_path: Path) -> None:
    (tmp_path / 'deliver.xml').write_text(DELIVER)

    async def test() -> None:
        async with serving(tmp_path) as server:
            calls = (
                server.call('run_tree', files=['deliver.xml'], blackboard={'goal': str(number)}) for number in range(5)
            )
            answers = await asyncio.gather(*calls)
            assert [one['blackboard']['']['goal'] for one in answers] == ['0', '1', '2', '3', '4']
            call = asyncio.create_task(server.call('prove_tree', files=['deliver.xml']))
            child = await server.child()
            os.kill(child, signal.SIGSTOP)  # it hangs
            call.cancel()
            with suppress(asyncio.CancelledError):
                await call
            await until(lambda: not is_alive(child))
            assert await server.call('list_files') == ['deliver.xml']

    run(test())


def test_a_command_that_hangs_or_dies(tmp_path: Path) -> None:
    (tmp_path / 'deliver.xml').write_text(DELIVER)

    async def test() -> None:
        async with serving(tmp_path, seconds=20) as server:
            for fault, words in (
                (signal.SIGSTOP, 'was ended after 20 s without an answer'),
                (signal.SIGKILL, 'by SIGKILL'),
            ):
                call = asyncio.create_task(server.refusal('prove_tree', files=['deliver.xml']))
                child = await server.child()
                os.kill(child, fault)
                assert words in await call
                await until(lambda child=child: not is_alive(child))  # type: ignore[misc]
            assert await server.call('list_files') == ['deliver.xml']

    run(test())


def test_an_answer_that_is_too_long_is_refused(tmp_path: Path) -> None:
    tree = 'Main: <Repeat num_cycles="-1"><Delay delay_msec="100"><AlwaysSuccess/></Delay></Repeat>'
    (tmp_path / 'endless.xml').write_text(document(tree))

    async def test() -> None:
        async with serving(tmp_path) as server:
            told = await server.refusal('run_tree', files=['endless.xml'], timeout=86400)
            assert f'longer than {MAX_FILE} bytes; ask for less at once' in told

    run(test())


def test_the_way_to_what_is_wrong_is_told_also_if_it_is_long(tmp_path: Path) -> None:
    """The steps of it, which a page plays and no model reads, do not count."""
    waits = ''.join(f'<Wait name="{"w" * 250}_{number}" wait_duration="1"/>' for number in range(60))
    (tmp_path / 'long.xml').write_text(
        document(f'Main: <Sequence>{waits}<Wait name="last" wait_duration="1"/></Sequence>')
    )

    async def test() -> None:
        async with serving(tmp_path) as server:
            proved = await server.call('prove_tree', files=['long.xml'], require=['never last'])
            assert len(proved['proofs'][0]['wrong'][0]['way']) > 100 and 'left_out' not in proved

    run(test())


def test_no_process_survives_the_server(tmp_path: Path) -> None:
    (tmp_path / 'deliver.xml').write_text(DELIVER)

    async def test() -> None:
        async with serving(tmp_path) as server:
            call = asyncio.create_task(server.call('prove_tree', files=['deliver.xml']))
            child = await server.child()
            os.kill(child, signal.SIGSTOP)
            os.kill(server.pid, signal.SIGKILL)
            await until(lambda: not is_alive(child))
            with pytest.raises(MCPError):
                await call

    run(test())


def test_a_wrong_folder_is_refused() -> None:
    done = bt_tool('mcp', '/nowhere/at/all')
    assert (done.code, done.err) == (2, '/nowhere/at/all is not a folder; create it, or give another one\n')

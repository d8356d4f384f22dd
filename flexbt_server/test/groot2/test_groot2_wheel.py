# SPDX-License-Identifier: BSD-3-Clause
"""Groot2's protocol, reply by reply, next to the publisher of BehaviorTree.CPP itself on the same trees.

Wanted differences that are left out here: hooks after ticks (of which the library of the wheel, 4.8.2, makes hooks
before them), and results that replace those of RUNNING nodes, which this engine halts first.
"""

from __future__ import annotations

import itertools
import json
import os
import random
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgpack
import pytest
from groot2_host import Host

from flexbt_server.groot2.log_file import LogError, read_log
from flexbt_server.groot2.protocol import RequestType
from flexbt_testing.behavior_trees import wheel as bt_wheel
from flexbt_testing.system.processes import free_pair
from flexbt_testing.waiting import wait_until

pytestmark = [
    pytest.mark.skipif(not bt_wheel.available(), reason='behaviortreepy is not installed'),
    pytest.mark.dds('Groot2 talks by sockets of ZeroMQ'),
]


EVERYTHING = """<root BTCPP_format="4" main_tree_to_execute="Main">
<BehaviorTree ID="Main"><Sequence name="top" _skipIf="false" _onHalted="x:=1"><Script code="a:=1; b:='&lt;&amp;'"/>
  <Cond/><Cond name="q" _z="5"/><LoopInt queue="1;2" value="{v}"><AlwaysSuccess/></LoopInt>
  <Repeat num_cycles="2"><AlwaysSuccess/></Repeat><SetBlackboard value="2.5" output_key="d"/>
  <Parallel><Sync/></Parallel>
  <Fallback><RetryUntilSuccessful num_attempts="2"><Cond name="no" _script="F"/></RetryUntilSuccessful>
  <SubTree ID="S" k="{a}" c="7" _autoremap="true"/></Fallback><SubTree ID="S" name="two" k="{b}" _skipIf="false"/>
  <Act _script="RS" _onSuccess="done := true"/></Sequence></BehaviorTree>
<BehaviorTree ID="S"><Sequence><Script code="z:=k"/><SubTree ID="T" m="{=}"/></Sequence></BehaviorTree>
<BehaviorTree ID="T"><Fallback><AlwaysFailure/><Precondition if="true" else="SKIPPED"><AlwaysSuccess/></Precondition>
</Fallback></BehaviorTree>
<TreeNodesModel><SubTree ID="S"><input_port name="k" default="3"/><inout_port name="m" default="{=}"/></SubTree>
</TreeNodesModel></root>"""


@pytest.fixture
def pairs() -> Iterator[Any]:
    hosts: list[Host] = []

    def make(xml: str, silence: float = 60.0) -> tuple[Host, Host]:
        for kind in ('engine', 'wheel'):
            hosts.append(Host(kind, xml, free_pair(), silence))
        return hosts[-2], hosts[-1]

    yield make
    for host in hosts:
        host.close()


def canonical(element: ElementTree.Element) -> Any:
    """Return an element, without the order of its attributes."""
    return element.tag, element.attrib, [canonical(child) for child in element]


def test_the_tree_and_its_models(pairs: Any) -> None:
    """The same elements, attributes and uids; of the models those that are used, with the same ports."""
    replies = [host.ask(RequestType.FULL_TREE) for host in pairs(EVERYTHING)]
    ours, theirs = (ElementTree.fromstring(reply[1]) for reply in replies)  # noqa: S314 - made here
    assert [canonical(tree) for tree in ours.iter('BehaviorTree')] == [
        canonical(tree) for tree in theirs.iter('BehaviorTree')
    ]
    assert ours.attrib == theirs.attrib
    known = {model.get('ID'): model for model in theirs.iterfind('TreeNodesModel/*')}
    used = {element.tag for tree in ours.iter('BehaviorTree') for element in tree.iter()} - {'BehaviorTree'}
    models = ours.findall('TreeNodesModel/*')
    assert {model.get('ID') for model in models} == used
    for model in models:
        theirs_too = known[model.get('ID')]
        assert model.tag == theirs_too.tag
        if model.get('ID') != 'SubTree':
            assert {ports(port) for port in model if port.tag != 'MetadataFields'} == {
                ports(port) for port in theirs_too
            }, model.get('ID')


def ports(port: ElementTree.Element) -> tuple[Any, ...]:
    """Direction, name, default, and the type if it has the same name in both."""
    kind = port.get('type', '')
    return port.tag, port.get('name'), port.get('default'), kind if kind in ('int', 'bool', 'double') else ''


@pytest.mark.parametrize('seed', range(int(os.environ.get('FLEXBT_GROOT2_SEEDS', '5'))))
def test_random_requests(pairs: Any, seed: int) -> None:
    xml = random_xml(random.Random(seed))
    print(xml)
    Comparison(random.Random(seed), *pairs(xml)).run()


class Comparison:
    """Sends both the same requests, between ticks and while breakpoints hold one up, and compares what they say."""

    def __init__(self, chance: random.Random, ours: Host, theirs: Host) -> None:
        self.chance = chance
        self.ours = ours
        self.theirs = theirs
        self.held = False
        tree = ElementTree.fromstring(ours.ask(RequestType.FULL_TREE)[1])  # noqa: S314 - made here
        self.uids = [int(element.get('_uid', '0')) for element in tree.iter() if element.get('_uid')]
        self.boards = [element.get('_fullpath') or element.attrib['ID'] for element in tree.iter('BehaviorTree')]
        # Results replace those of leaves that never are RUNNING.
        quick = ('Sync', 'Cond', 'AlwaysSuccess')
        self.quick = [int(leaf.attrib['_uid']) for leaf in tree.iter() if leaf.tag in quick and leaf.get('_uid')]
        self.placed: set[int] = set()
        self.told = 0
        self.holding = 0

    def run(self) -> None:
        for _ in range(60):
            if not self.held and self.chance.random() < 0.4:
                for host in (self.ours, self.theirs):
                    host.send('tick')
                self.settle()
            else:
                self.request()
            self.compare(RequestType.STATUS)
        while self.held:
            self.remove(self.holding)
        self.both(RequestType.REMOVE_ALL_HOOKS)
        for host in (self.ours, self.theirs):
            host.send('halt')
            host.expect('halted')
        self.compare(RequestType.STATUS)

    def settle(self) -> None:
        """Wait until the tick is over, or held up. The engine says so; the library has to be at the same place."""
        line = self.ours.line()
        self.held = line == 'held'
        count, self.told = self.ours.told - self.told, self.ours.told
        notices = self.ours.notices(count)
        print(line, notices)
        assert self.theirs.notices(count) == notices
        if self.held:
            self.holding = int(notices[-1])
        else:
            assert self.theirs.line() == line
        assert self.theirs.more_notices() == []

    def both(self, type: int, *content: bytes) -> list[list[bytes]]:
        replies = [host.ask(type, *content) for host in (self.ours, self.theirs)]
        print(chr(type), content, replies[0][1:] == replies[1][1:])
        for reply in replies:
            assert len(reply) == len(replies[0]), (chr(type), content, replies)
        assert (replies[0][0] == b'error') is (replies[1][0] == b'error')
        if replies[0][0] == b'error':
            assert replies[0] == replies[1]
        return replies

    def compare(self, type: int, *content: bytes) -> None:
        ours, theirs = self.both(type, *content)
        assert ours[1:] == theirs[1:], (chr(type), content)

    def request(self) -> None:
        choice = self.chance.choice('IIIIIUUUDDBBRXrttAEE')
        match choice:
            case 'I':
                hooks = [self.hook() for _ in range(self.chance.choice((1, 1, 3)))]
                self.compare(RequestType.HOOK_INSERT, json.dumps(hooks if len(hooks) > 1 else hooks[0]).encode())
                self.follow()
            case 'U':
                self.unlock()
            case 'R':
                self.remove(self.uid())
            case 'A' | 'X':
                # While a breakpoint holds the tick up, the library lets it go on before all hooks are done with.
                if not self.held:
                    self.compare(ord(choice))
            case 'D':
                hooks, others = (json.loads(reply[1]) for reply in self.both(RequestType.HOOKS_DUMP))
                assert hooks == sorted(others, key=lambda hook: int(hook['uid']))
            case 'B':
                names = ';'.join(self.chance.choices([*self.boards, 'nobody', ''], k=self.chance.randrange(1, 4)))
                replies = self.both(RequestType.BLACKBOARD, names.encode())
                boards, other_boards = (msgpack.unpackb(reply[1]) for reply in replies)
                # Since 4.10 the topmost board comes with those of sub-trees.
                if boards is not None:
                    boards.pop('ROOT', None)
                assert boards == other_boards
            case 'r':
                command = self.chance.choice((b'start', b'start', b'stop', b'other'))
                ours, theirs = self.both(RequestType.TOGGLE_RECORDING, command)
                if command == b'start':
                    assert abs(int(ours[1]) - int(theirs[1])) < 5_000_000
            case 't':
                records, others = (transitions(reply[1]) for reply in self.both(RequestType.GET_TRANSITIONS))
                assert [record[1:] for record in records] == [record[1:] for record in others]
                times = [record[0] for record in records]
                assert times == sorted(times)
            case 'E':
                self.wrong()

    def wrong(self) -> None:
        header = self.chance.choice((b'', b'12345', b'1234567', None))
        if header is not None:
            replies = [host.ask(0, header=header) for host in (self.ours, self.theirs)]
            assert replies[0] == replies[1] == [b'error', b'wrong request header']
            return
        type = self.chance.choice(b'BIRUr')
        self.compare(type, *self.chance.choice(((), (b'1', b'2'))))
        self.compare(self.chance.choice(b'\0NQz\xff'), *self.chance.choice(((), (b'x',))))

    def uid(self) -> int:
        return self.chance.choice([*self.uids, *self.placed, 9999])

    def hook(self) -> dict[str, Any]:
        uid = self.uid()
        if self.held and uid in self.placed:
            # The library does not check what is changed of the hook that holds it up.
            uid = self.chance.choice([uid for uid in self.uids if uid not in self.placed] or [8888])
        status = self.chance.choice(('SUCCESS', 'FAILURE')) if uid in self.quick else 'SKIPPED'
        self.placed.add(uid)
        return {
            'enabled': self.chance.random() < 0.9,
            'uid': uid,
            'mode': self.chance.choice((0, 0, 1)),
            'once': self.chance.random() < 0.4,
            'desired_status': status,
            'position': 0,
        }

    def remove(self, uid: int) -> None:
        self.compare(RequestType.HOOK_REMOVE, json.dumps({'uid': uid, 'position': 0}).encode())
        self.follow()

    def unlock(self) -> None:
        uid = self.uid()
        document = {
            'uid': uid,
            'position': 0,
            'desired_status': self.chance.choice(('SUCCESS', 'FAILURE', 'SKIPPED')) if uid in self.quick else 'SKIPPED',
            'remove_when_done': self.chance.random() < 0.5,
        }
        self.compare(RequestType.BREAKPOINT_UNLOCK, json.dumps(document).encode())
        self.follow()

    def follow(self) -> None:
        """Wait for the tick after a request that may have let it go on."""
        if self.held and not self.ours.is_held():
            self.settle()


def transitions(data: bytes) -> list[tuple[int, int, int]]:
    assert len(data) % 9 == 0
    return [
        (int.from_bytes(data[at : at + 6], 'little'), int.from_bytes(data[at + 6 : at + 8], 'little'), data[at + 8])
        for at in range(0, len(data), 9)
    ]


def random_xml(chance: random.Random) -> str:
    """Return a tree without timers."""
    names = itertools.count()
    trees: list[str] = []

    def condition() -> str:
        choice = chance.random()
        if choice < 0.1:
            return ' _skipIf="n > 2"'
        if choice < 0.2:
            return ' _onSuccess="n := n + 1"'
        return ' _while="n &lt; 4"' if choice < 0.25 else ''

    def node(depth: int) -> str:
        name = f'name="n{next(names)}"{condition()}'
        choice = chance.random()
        if depth == 0 or choice < 0.35:
            kind = chance.choice(('Act', 'Act', 'Sync', 'Cond', 'Cond', 'AlwaysSuccess', 'AlwaysFailure', 'Script'))
            if kind == 'Script':
                return f'<Script {name} code="n := n + 1; t := \'text\'; r := 0.5"/>'
            letters = 'SFR' if kind == 'Act' else 'SF'
            script = f'_script="{"".join(chance.choices(letters, k=3))}"' if kind in ('Act', 'Sync', 'Cond') else ''
            return f'<{kind} {name} {script}/>'
        if choice < 0.45 and len(trees) < 3:
            id = f'Sub{len(trees)}'
            trees.append('')
            trees[int(id[3:])] = f'<BehaviorTree ID="{id}">{node(depth - 1)}</BehaviorTree>'
            return f'<SubTree ID="{id}" name="s{next(names)}" n="{{n}}" constant="7"/>'
        if choice < 0.6:
            kind, ports = chance.choice(
                (
                    ('Inverter', ''),
                    ('ForceSuccess', ''),
                    ('Repeat', 'num_cycles="2"'),
                    ('RetryUntilSuccessful', 'num_attempts="2"'),
                    ('Deco', '_map="S>F F>S"'),
                )
            )
            return f'<{kind} {name} {ports}>{node(depth - 1)}</{kind}>'
        kind = chance.choice(('Sequence', 'Fallback', 'ReactiveFallback', 'SequenceWithMemory', 'Parallel'))
        children = ''.join(node(depth - 1) for _ in range(chance.randrange(1, 4)))
        return f'<{kind} {name}>{children}</{kind}>'

    root = f'<Sequence name="root"><Script name="first" code="n := 0"/>{node(3)}{node(3)}{node(2)}</Sequence>'
    main = f'<BehaviorTree ID="Main">{root}</BehaviorTree>'
    return f'<root BTCPP_format="4" main_tree_to_execute="Main">{main}{"".join(trees)}</root>'


def test_log_files(pairs: Any, tmp_path: Path) -> None:
    """The same bytes, apart from times, and from what the library loses at the end."""
    hosts = pairs(EVERYTHING)
    logs = [tmp_path / 'ours.btlog', tmp_path / 'theirs.btlog']
    for host, path in zip(hosts, logs, strict=True):
        host.send(f'log {path}')
        host.expect('logging')
    for host in hosts:
        for _ in range(3):
            host.send('tick')
            assert host.line() in ('RUNNING', 'SUCCESS')
    ours = logs[0].read_bytes()
    # Its thread writes every 10 ms, and is not waited for at the end.
    wait_until(lambda: count(logs[1]) >= count(logs[0]), 'the log of the library')
    assert ours[:19] == logs[1].read_bytes()[:19] == b'BTCPP4-FileLogger2\x01'
    read = [read_log(path) for path in logs]
    assert read[0].nodes == read[1].nodes
    assert [entry[1:] for entry in read[0].transitions] == [entry[1:] for entry in read[1].transitions]
    assert read[0].left_over == read[1].left_over == 0
    assert abs(read[0].epoch - read[1].epoch) < 60.0
    assert all(0.0 <= entry.time < 60.0 for log in read for entry in log.transitions)


def count(log: Path) -> int:
    """Transitions in a log file. Of one that the library has begun not even the head may be there."""
    try:
        return len(read_log(log).transitions)
    except LogError:
        return 0


@pytest.mark.parametrize('type', 'AXR')
def test_a_held_tick_goes_on(pairs: Any, type: str) -> None:
    """When its hook is removed or disabled, and as if there had been none."""
    hook = {'enabled': True, 'uid': 3, 'mode': 0, 'once': False, 'desired_status': 'FAILURE', 'position': 0}
    seen = []
    for host in pairs(EVERYTHING):
        host.ask(RequestType.HOOK_INSERT, json.dumps(hook).encode())
        host.send('tick')
        assert host.notices(1) == [b'3']
        host.ask(ord(type), *([b'{"uid": 3, "position": 0}'] if type == 'R' else []))
        line = host.line()
        if line == 'held':
            line = host.line()
        seen.append([line, host.ask(RequestType.STATUS)[1], host.ask(RequestType.HOOKS_DUMP)[1]])
    assert seen[0][:2] == seen[1][:2]
    assert seen[0][0] == 'RUNNING'
    assert json.loads(seen[0][2]) == json.loads(seen[1][2])


def test_silence(pairs: Any) -> None:
    """After some time without a request breakpoints hold nothing up; hooks are back with the next request."""
    hosts = pairs(EVERYTHING, 1.5)  # a breakpoint has to be reached before, on a busy machine too
    hook = {'enabled': True, 'uid': 3, 'mode': 0, 'once': False, 'desired_status': 'SKIPPED', 'position': 0}
    for host in hosts:
        host.ask(RequestType.HOOK_INSERT, json.dumps(hook).encode())
        host.send('tick')
    hosts[0].expect('held')
    for host in hosts:
        assert host.notices(1) == [b'3']
        if host is hosts[0]:  # the library may lose the wake-up, and then waits for ever
            host.expect('RUNNING')
        (dumped,) = json.loads(host.ask(RequestType.HOOKS_DUMP)[1])
        assert dumped['uid'] == 3

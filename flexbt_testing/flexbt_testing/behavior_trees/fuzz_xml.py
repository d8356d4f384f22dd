# SPDX-License-Identifier: BSD-3-Clause
"""Damages behavior-tree files at random, and reads them: ``python bt_fuzz_xml.py --seconds 600 --seed 0``.

Whatever the text, reading it gives a document or errors with places in that text, in bounded time and memory; a
document that is read can be checked as ``bt_tool`` does it, made into a tree, and ticked. The texts are made of Nav2's
trees where they are at hand, of random trees of all nodes, and of hostile documents; those that lead to errors that
were not seen before are damaged further. Exit code 1, and the text in a file, when something else happens.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import faulthandler
import random
import re
import resource
import time
from pathlib import Path

from flexbt_core.behavior_tree import (
    BehaviorTreeError,
    Blackboard,
    NodeRegistry,
    NodeStatus,
    StatefulAction,
    Tree,
    TreeLibrary,
    TreeLoadError,
    load_xml,
    simple_action,
    simple_condition,
    simple_decorator,
)
from flexbt_core.clock import ManualClock
from flexbt_server.node_types import node_registry
from flexbt_tools.tree_checks import findings

from . import random_nodes as bt_random_nodes
from . import random_scripts as bt_random_scripts
from .bt_tool import STOCK_TREES
from .hostile_xml import ACCEPTED, CORPUS

SLOW = 2.0
"""Seconds of processor time that no text of this size may take."""
LONGEST = 60_000
MOST = 2000
"""Texts that are kept."""
TOKEN = re.compile(r'<!--|-->|<\?|\?>|</|/>|[<>="\'&;{}]|\w+|\s+|.', re.DOTALL)
WORDS = (
    r"""< > /> </ " ' & &lt; &#65; &#x110000; &#xD800; ; { } {=} {@a} {} = <!-- --> <![CDATA[ ]]> <?xml?> <!DOCTYPE ]>
    ID="Main" name="" _skipIf="a==1" _onHalted="b:=2" _while="true" _autoremap="true" num_cycles="3" BTCPP_format="3"
    -1 1e999 99999999999999999999 0x 1;2;3 json:[1 json:{'a':1} nan true := && || ? : ( ) += <TreeNodesModel>
    <SubTree_ID="Main"/> <include_path="a.xml"/> <Action_ID="AlwaysSuccess"/> <BehaviorTree_ID="T">
    <root_BTCPP_format="4"> <Sequence> </Sequence> </BehaviorTree> </root>""".replace('_ID', ' ID').split()
    + list('\0\x1f\ufeff\u2028\ud800é\U0001f600\n\r ')
)


class Act(StatefulAction):
    """A leaf of the random trees, as are those that follow."""

    def on_start(self) -> NodeStatus:
        return NodeStatus.RUNNING

    def on_running(self) -> NodeStatus:
        return NodeStatus.SUCCESS

    def on_halted(self) -> None:
        pass


def make_registry() -> NodeRegistry:
    """The nodes of the server, and those of the random trees."""

    def refuse(source: str, error: Exception) -> None:
        raise error

    registry = node_registry(refuse)
    registry.register('Act', Act)
    registry.register('Sync', simple_action(lambda node: NodeStatus.SUCCESS))
    registry.register('Cond', simple_condition(lambda node: False))
    registry.register('Deco', simple_decorator(lambda status, node: status))
    return registry


def seeds() -> list[str]:
    """Texts to begin with."""
    texts = [file.read_text() for file in STOCK_TREES]
    texts += [bt_random_nodes.make_case(seed)['xml'] for seed in range(40)]
    texts += [bt_random_scripts.make_case(seed)['xml'] for seed in range(40)]
    hostile = [content for content, _ in CORPUS.values()] + list(ACCEPTED.values())
    texts += [content.decode('utf-8', 'replace') for content in hostile if len(content) < 5000]
    return texts


class Fuzzer:
    """Texts, and what was found with them."""

    def __init__(self, seed: int) -> None:
        self._chance = random.Random(seed)
        self._seeds = seeds()
        self._texts = list(self._seeds)
        self._registry = make_registry()
        self._known: set[tuple[str, ...]] = set()
        self.counts: collections.Counter[str] = collections.Counter()
        self.slowest = 0.0

    def round(self) -> None:
        """Damages one text and reads it. Whatever is raised here is a defect; :attr:`text` is the text."""
        chance = self._chance
        self.text = self._damaged(chance.choice(self._seeds if chance.random() < 0.6 else self._texts))
        data = self.text.encode('utf-8', 'surrogatepass')
        if chance.random() < 0.1 and data:
            position = chance.randrange(len(data))
            data = data[:position] + chance.randbytes(chance.randint(1, 4)) + data[position + 1 :]
        began = time.process_time()
        shape = self._read(data, self.text.count('\n') + self.text.count('\r') + 1)
        self.slowest = max(self.slowest, time.process_time() - began)
        assert self.slowest < SLOW, f'{self.slowest:.1f} s'
        if shape not in self._known and len(self.text) < LONGEST:
            self._known.add(shape)
            if len(self._texts) < MOST:
                self._texts.append(self.text)
            else:
                self._texts[chance.randrange(MOST)] = self.text

    def _read(self, data: bytes, lines: int) -> tuple[str, ...]:
        """Reads a text; gives of what kind its errors are."""
        includes = dict.fromkeys(['a.xml', 'b.xml'], data)

        def include(path: str, package: str | None, including: str) -> tuple[str, bytes]:
            if path not in includes:
                raise FileNotFoundError(path)
            return path, includes[path]

        try:
            document = load_xml(data, 'file.xml', self._registry, include=include)
            library = TreeLibrary([document])
        except TreeLoadError as error:
            self.counts['refused'] += 1
            assert error.errors
            for reason in error.errors:
                assert 1 <= reason.line <= lines + 3 and reason.column >= 1, reason
                str(reason).encode()
            return tuple(sorted({' '.join(re.findall('[a-z]{3,}', reason.message)[:4]) for reason in error.errors})[:3])
        self.counts['read'] += 1
        self._run(library, document.main)
        return ('read', *(node.manifest.id for tree in document.trees.values() for node in tree.nodes()))

    def _run(self, library: TreeLibrary, main: str | None) -> None:
        if main is None or len(self.text) > LONGEST:
            return
        for finding in findings(library, (), shared=self._chance.random() < 0.5):
            assert finding.place.line >= 1
        with contextlib.suppress(BehaviorTreeError):
            clock = ManualClock()
            tree = Tree(library, main, blackboard=Blackboard(), clock=clock, max_rounds=20)
            try:
                for _ in range(3):
                    if tree.tick_once() is not NodeStatus.RUNNING:
                        break
                    clock.advance(0.1)
            finally:
                tree.halt()
            self.counts['ticked'] += 1

    def _damaged(self, text: str) -> str:
        chance = self._chance
        for _ in range(chance.choice([1, 1, 1, 2, 3, 6])):
            damage = chance.choice([self._cut, self._insert, self._swap, self._repeat, self._splice, self._flip])
            text = damage(text)[: 4 * LONGEST]
        return text

    def _span(self, text: str) -> tuple[int, int]:
        """A few tokens of a text."""
        start = self._chance.randrange(len(text) + 1)
        end = start
        for _ in range(self._chance.choice([1, 1, 2, 4, 30])):
            match = TOKEN.match(text, end)
            if match is None:
                break
            end = match.end()
        return start, end

    def _cut(self, text: str) -> str:
        start, end = self._span(text)
        return text[:start] + text[end:]

    def _insert(self, text: str) -> str:
        start, end = self._span(text)
        return text[:start] + self._chance.choice(WORDS) + text[self._chance.choice([start, end]) :]

    def _swap(self, text: str) -> str:
        (a, b), (c, d) = sorted([self._span(text), self._span(text)])
        return text if b > c else text[:a] + text[c:d] + text[b:c] + text[a:b] + text[d:]

    def _repeat(self, text: str) -> str:
        start, end = self._span(text)
        return text[:end] + text[start:end] * self._chance.choice([1, 2, 10, 300]) + text[end:]

    def _splice(self, text: str) -> str:
        other = self._chance.choice(self._texts)
        (start, end), (first, last) = self._span(text), self._span(other)
        return text[:start] + other[first:last] + text[end:]

    def _flip(self, text: str) -> str:
        if not text:
            return text
        position = self._chance.randrange(len(text))
        code = ord(text[position]) ^ (1 << self._chance.randrange(8))
        return text[:position] + chr(code) + text[position + 1 :]


def fuzz(seconds: float, seed: int, directory: Path) -> Fuzzer:
    """Fuzzes for a while. Raises what a text has led to, with the file where that text is."""
    fuzzer = Fuzzer(seed)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        fuzzer.counts['rounds'] += 1
        faulthandler.dump_traceback_later(60.0, exit=True)
        try:
            fuzzer.round()
        except Exception as error:
            file = directory / f'fuzz_{seed}_{fuzzer.counts["rounds"]}.xml'
            file.write_bytes(fuzzer.text.encode('utf-8', 'surrogatepass'))
            error.add_note(f'the text is in {file}')
            raise
        finally:
            faulthandler.cancel_dump_traceback_later()
    return fuzzer


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seconds', type=float, default=60.0)
    parser.add_argument('--seed', type=int, default=0)
    options = parser.parse_args()
    fuzzer = fuzz(options.seconds, options.seed, Path.cwd())
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000
    print(f'{dict(fuzzer.counts)}, slowest {fuzzer.slowest:.2f} s, at most {memory:.0f} MB')


if __name__ == '__main__':
    main()

# SPDX-License-Identifier: BSD-3-Clause
"""Random goals, cancels, takeovers, loads, edits of files, data and deaths of clients on a live server, held against a
model of what it may answer.

``FLEXBT_MODEL_STEPS=10000 FLEXBT_MODEL_SEED=1 pytest test_server_model.py -s`` takes more steps, and prints figures.
"""

from __future__ import annotations

import collections
import os
import random
import threading
import time
from pathlib import Path

import pytest
from server_model import NEVER, Model, ModelGoal, Plan, make_plan

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_common.lifecycle.liveliness import LivelinessToken
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.entries import Encoding, from_entry, to_entry
from flexbt_msgs.action import BtExecute, BtGetData, BtLoad, BtSetData
from flexbt_msgs.msg import BlackboardEntry
from flexbt_testing.behavior_trees.faulty_leaves import Work, tree_threads
from flexbt_testing.nodes import server_nodes
from flexbt_testing.nodes.clients import SentGoal
from flexbt_testing.nodes.server_world import ServerWorld, document, install_nodes, open_server_world
from flexbt_testing.waiting import DEADLINE, processor_time, wait_until

STEPS = int(os.environ.get('FLEXBT_MODEL_STEPS', '300'))
SEED = int(os.environ.get('FLEXBT_MODEL_SEED', '0'))
BOARDS = ['', 'a']
BROKEN = ['<root>', '<root BTCPP_format="4"><BehaviorTree ID="T0"><NoSuchNode/></BehaviorTree></root>', 'x' * 3000]
VALUES = [1, -(2**40), 2.5, 'text', 'ä\n"', True, [1.5, 2.5], 'x' * 5000]


@pytest.fixture(scope='session', autouse=True)
def nodes_of_ones_own(tmp_path_factory: pytest.TempPathFactory) -> None:
    install_nodes(tmp_path_factory.mktemp('site'), server_nodes.__name__)


class Walk:
    """A random walk on a server."""

    def __init__(self, world: ServerWorld, directory: Path, seed: int) -> None:
        self.world = world
        self.client = world.client
        self.chance = random.Random(seed)
        self.model = Model()
        self.counts: collections.Counter[str] = collections.Counter()
        self.log: collections.deque[str] = collections.deque(maxlen=40)
        self._goals = 0
        self._loaded: collections.deque[tuple[str, Plan]] = collections.deque(maxlen=12)
        self._files = {f'F{index}': directory / f'F{index}.xml' for index in range(2)}
        for tree in ('T0', 'T1', 'T2', *self._files):
            self._new_version(tree)
        self._steps = {
            self.send: 40, self.cancel: 22, self.load: 6, self.load_again: 3, self.load_broken: 3, self.data: 10,
            self.send_bad: 4, self.burst: 4, self.nothing: 8, self.death_of_an_owner: 0.4,
        }  # fmt: skip

    def step(self) -> None:
        """Something happens."""
        (action,) = self.chance.choices(list(self._steps), list(self._steps.values()))
        self.counts[action.__name__] += 1
        action()
        time.sleep(self.chance.choice([0.0, 0.0, 0.001, 0.004, 0.01]))

    def send(self) -> None:
        tree, board = self.chance.choice(list(self.model.trees)), self.chance.choice(BOARDS)
        self.model.supersede((tree, board))
        name = str(self._files.get(tree, tree))
        self._add((tree, board), self.client.execute(name, blackboard=board), self.model.trees[tree])

    def burst(self) -> None:
        """Several goals for one tree at once."""
        tree, board = self.chance.choice(['T0', 'T1', 'T2']), self.chance.choice(BOARDS)
        for _ in range(self.chance.randint(2, 5)):
            self.model.supersede((tree, board))
            self._add((tree, board), self.client.execute(tree, blackboard=board), self.model.trees[tree])

    def send_bad(self) -> None:
        """Send a goal that cannot run, and must not disturb those that do."""
        bad = BlackboardEntry(key='speed', type='float64', text='fast')
        goal = self.chance.choice(
            [
                BtExecute.Goal(behavior_tree='T0', inputs=[bad]),
                BtExecute.Goal(behavior_tree='NoSuchTree'),
                BtExecute.Goal(behavior_tree='/outside/of/all.xml'),
                BtExecute.Goal(),
            ]
        )
        self._add(('', ''), SentGoal(self.client.executor, goal), [])

    def cancel(self) -> None:
        if self.model.live:
            goal = self.chance.choice(self.model.live)
            self.log.append(f'cancel {goal.number}')
            goal.canceled = True
            goal.sent.call.cancel(DEADLINE)

    def load(self) -> None:
        self._new_version(self.chance.choice(list(self.model.trees)))

    def load_again(self) -> None:
        """Load a version that was loaded before."""
        tree, plan = self.chance.choice(self._loaded)
        self._load(tree, plan)

    def load_broken(self) -> None:
        result = self.client.load(xml=self.chance.choice(BROKEN))
        assert result.code == BtLoad.Result.FAILURE and result.message

    def data(self) -> None:
        board, key = self.chance.choice(BOARDS), f'd{self.chance.randrange(3)}'
        place = (board, f'{key}{self.chance.randrange(len(VALUES))}')
        if place not in self.model.entries or self.chance.random() < 0.3:
            value = VALUES[int(place[1][2:])]
            entry = to_entry(place[1], value, encoding=self.chance.choice(list(Encoding)))
            assert self.client.set(entry, blackboard=board).code == BtSetData.Result.SUCCESS
            self.model.entries[place] = value
        result = self.client.get(place[1], blackboard=board)
        assert result.code == BtGetData.Result.SUCCESS, result.message
        assert from_entry(result.entries[0]) == self.model.entries[place]

    def death_of_an_owner(self) -> None:
        with NodeRuntime.open(f'owner{self.counts["death_of_an_owner"]}') as owner:
            LivelinessToken(owner)
            name = f'/{owner.name}'
            goal = self.client.execute('Endless', blackboard=name, owner=name)
            wait_until(lambda: self.world.server.goals.owners.sees(name), 'the owner was seen')
        assert goal.wait().status is GoalStatus.ABORTED
        assert goal.result.code == BtExecute.Result.CANCELED and name in goal.result.message

    def nothing(self) -> None:
        time.sleep(self.chance.uniform(0.0, 0.05))

    def rest(self) -> None:
        """Everything ends as it may, and nothing is left."""
        model = self.model
        if self.chance.random() < 0.3:
            wait_until(lambda: all(goal.sent.ended for goal in model.live if self._ends(goal)), 'the ends')
        for goal in model.live:
            if not goal.sent.ended:
                goal.canceled = True
                goal.sent.call.cancel(DEADLINE)
        for goal in model.live:
            problem = goal.problem()
            assert not problem, f'goal {goal.number} {goal.slot}: {problem}\n{goal.plans}\n' + '\n'.join(self.log)
            result = goal.sent.wait().result
            self.counts['not sent' if result is None else f'code {result.code}'] += 1
        goals = self.world.server.goals
        wait_until(lambda: not tree_threads(), 'the end of the threads')
        assert not Work.running(), '\n'.join([str(Work.running()), *self.log])
        assert not goals.running.all() and not goals._goals
        wait_until(lambda: not any(action.running for action in self.world.navigation.actions.values()), 'the actions')
        model.rest()

    def _ends(self, goal: ModelGoal) -> bool:
        return not any(NEVER in plan.ends for plan in goal.plans)

    def _add(self, slot: tuple[str, str], sent: SentGoal, plans: list[Plan]) -> None:
        self._goals += 1
        self.log.append(f'send {self._goals} to {slot}')
        self.model.live.append(ModelGoal(self._goals, slot, sent, plans))

    def _new_version(self, tree: str) -> None:
        plan = make_plan(self.chance)
        self._loaded.append((tree, plan))
        self._load(tree, plan)

    def _load(self, tree: str, plan: Plan) -> None:
        self.log.append(f'load {tree}: {plan.xml}')
        # The model first: from now on goals that are under way may get it.
        self.model.load(tree, plan)
        text = document(plan.xml, tree)
        if tree in self._files:
            scratch = self._files[tree].with_suffix('.new')
            scratch.write_text(text)
            scratch.rename(self._files[tree])
        else:
            assert self.client.load(xml=text).code == BtLoad.Result.SUCCESS


def thread_names() -> collections.Counter[str]:
    return collections.Counter(thread.name for thread in threading.enumerate())


def resident_megabytes() -> float:
    """Memory of this process."""
    pages = int(Path('/proc/self/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 1e6


def test_a_random_walk_is_as_the_model_predicts(tmp_path: Path) -> None:
    with open_server_world(allowed_directories=[str(tmp_path)], cancel_timeout=10.0) as world:
        world.navigation.hold.add(names.BACKUP)
        world.client.load_tree('<Runs ms="1000000"/>', 'Endless')
        walk = Walk(world, tmp_path, SEED)
        began = time.monotonic()
        threads, memory = collections.Counter[str](), 0.0
        for step in range(1, STEPS + 1):
            walk.step()
            if step % 50 == 0:
                walk.rest()
            if step == min(500, STEPS // 2):
                walk.rest()
                threads, memory = thread_names(), resident_megabytes()
        walk.rest()
        new_threads = thread_names() - threads
        assert set(new_threads) <= {'steady_clock'} and new_threads.total() <= 3  # those of nodes start when needed
        grown = resident_megabytes() - memory
        busy = processor_time()
        time.sleep(1.0)  # during which nothing should happen
        busy = processor_time() - busy
        took = time.monotonic() - began
        print(f'\n{STEPS} steps, seed {SEED}, {took:.0f} s; memory {grown:+.1f} MB; at rest {busy:.1%} of a core')
        print(dict(walk.counts))
        assert grown < 5.0 + STEPS / 500
        assert busy < 0.2

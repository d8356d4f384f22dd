# SPDX-License-Identifier: BSD-3-Clause
"""A winning strategy as a graph: the system's answer to each move of the world.

The graph is deterministic. Among several answers, the criteria are, in this order: the nearest layer, the fewest steps
if the world helps (where outcomes have to follow at some time), a node that exists already, the same change as after
the same inputs before, the least change, and the order of the variables.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

from flexbt_core.values.text import truncate_middle

from .encoding import Diagram
from .errors import SynthesisError
from .formulas import Valuation, VariableName
from .solver import FAIR, Solution

MAX_NODES: Final = 20_000
"""Maximum number of nodes of a strategy."""

MAX_MOVES: Final = 4096
"""Maximum number of moves of the world in one state, or at the start."""


@dataclass(frozen=True, slots=True)
class StrategyNode:
    """A state of the game (``values`` of all variables) on the way to guarantee ``goal``.

    ``rank`` is the distance to the guarantee in layers. ``kind`` is the number of the assumption on which this step
    depends, or FAIR. ``moves`` are pairs: the next inputs by name, and the number of the node that answers them.
    """

    values: dict[str, int]
    goal: int
    rank: int
    kind: int
    moves: tuple[tuple[dict[str, int], int], ...]


@dataclass(frozen=True, slots=True)
class Strategy:
    """The nodes, and the numbers of the start nodes: one for each combination of initial inputs."""

    nodes: tuple[StrategyNode, ...]
    start: tuple[int, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the strategy as a certificate: plain data, which :func:`check_certificate` verifies."""
        return {
            'start': list(self.start),
            'nodes': [
                {
                    'values': node.values,
                    'goal': node.goal,
                    'rank': node.rank,
                    'kind': 'fair' if node.kind == FAIR else node.kind,
                    'moves': [{'inputs': inputs, 'to': to} for inputs, to in node.moves],
                }
                for node in self.nodes
            ],
        }


def strategy_of(solution: Solution) -> Strategy:
    """Return the strategy of a game that is won.

    Raises:
        SynthesisError: the world has more than MAX_MOVES moves somewhere, or the strategy more than MAX_NODES nodes.
    """
    return _Extraction(solution).strategy()


class _Extraction:
    def __init__(self, solution: Solution) -> None:
        self._solution = solution
        self._game = solution.game
        self._encoding = solution.game.encoding
        of = self._encoding
        self._layers = [[layer.states for layer in layers] for layers in solution.layers]
        self._layers_next = [[of.primed(states) for states in layers] for layers in self._layers]
        self._winning_next = of.primed(solution.winning)
        self._lucky = [self._with_luck(goal) if solution.game.live else [] for goal in range(len(self._layers))]
        self._lucky_next = [[of.primed(states) for states in layers] for layers in self._lucky]
        self._numbers: dict[tuple[tuple[int, ...], int], int] = {}
        self._states: list[tuple[dict[VariableName, int], int]] = []
        self._changed: dict[tuple[int, ...], dict[VariableName, int]] = {}  # by inputs, the outputs of the first answer

    def _with_luck(self, goal: int) -> list[Diagram]:
        """Return growing sets: the winning states from which a guarantee is met in 1, 2, 3 ... steps if the world
        helps."""
        game, of = self._game, self._encoding
        found = [of.false]
        meets = game.guarantees[goal] & self._winning_next
        while True:
            wider = self._solution.winning & game.with_luck(meets | of.primed(found[-1]))
            if wider == found[-1]:
                return found[1:]
            found.append(wider)

    def strategy(self) -> Strategy:
        game, of = self._game, self._encoding
        start = []
        for inputs in self._some_members(game.inputs, game.start_world, 'at the start'):
            choices = of.given(inputs, game.start_system & self._solution.winning)
            near = self._first(self._first(choices, inputs, self._layers[0]), inputs, self._lucky[0])
            outputs = of.nearest(game.outputs, near, {})
            start.append(self._number({**inputs, **outputs}, 0))
        nodes: list[StrategyNode] = []
        while len(nodes) < len(self._states):
            self._game.watch(f'{len(nodes)} nodes of the strategy')
            nodes.append(self._node(*self._states[len(nodes)]))
        return Strategy(tuple(nodes), tuple(start))

    def _node(self, state: dict[VariableName, int], goal: int) -> StrategyNode:
        game, of = self._game, self._encoding
        layers = self._solution.layers[goal]
        rank = next(rank for rank, layer in enumerate(layers) if of.has(state, layer.states))
        kind = layers[rank].kind
        moves = []
        world = of.given(state, game.world)
        for inputs in self._some_members(game.inputs_next, world, f'in {_shown(state)}'):
            moves.append(
                ({name.name: value for name, value in inputs.items()}, self._answer(state, goal, rank, inputs))
            )
        return StrategyNode({name.name: value for name, value in state.items()}, goal, rank, kind, tuple(moves))

    def _answer(self, state: dict[VariableName, int], goal: int, rank: int, inputs: dict[VariableName, int]) -> int:
        game, of = self._game, self._encoding
        here = {**state, **inputs}
        answers = of.given(here, game.system)
        after = (goal + 1) % len(game.guarantees)
        kind = self._solution.layers[goal][rank].kind
        met = answers & of.given(here, game.guarantees[goal]) & of.given(inputs, self._winning_next)
        for choices, then, last in (
            (met, after, None),
            (answers, goal, rank),
            (answers, goal, None)
            if kind == FAIR
            else (answers & ~of.given(here, game.assumptions[kind]), goal, rank + 1),
        ):
            if choices == of.false:
                continue
            for layer in self._layers_next[then][:last]:
                near = choices & of.given(inputs, layer)
                if near != of.false:
                    return self._chosen(self._first(near, inputs, self._lucky_next[then]), state, inputs, then)
        raise AssertionError('a winning state has an answer')

    def _first(self, choices: Diagram, inputs: dict[VariableName, int], layers: list[Diagram]) -> Diagram:
        """Return the choices in the first of the layers that has some; without one, all."""
        found = (choices & self._encoding.given(inputs, states) for states in layers)
        return next((near for near in found if near != self._encoding.false), choices)

    def _chosen(
        self, choices: Diagram, state: dict[VariableName, int], inputs: dict[VariableName, int], goal: int
    ) -> int:
        game, of = self._game, self._encoding
        now = {VariableName(name.name): value for name, value in inputs.items()}
        for number, (there, counter) in enumerate(self._states):
            if (
                counter == goal
                and all(there[name] == value for name, value in now.items())
                and of.has({VariableName(name.name, True): there[name] for name in game.outputs}, choices)
            ):
                return number
        idle = game.specification.idle
        told = tuple(inputs.values())
        usual = {name: 0 if name.name in idle else state[name] for name in game.outputs} | self._changed.get(told, {})
        outputs = of.nearest(
            game.outputs_next, choices, {VariableName(name.name, True): one for name, one in usual.items()}
        )
        after = {VariableName(name.name): value for name, value in outputs.items()}
        self._changed.setdefault(told, {name: one for name, one in after.items() if one != state[name]})
        return self._number({**now, **after}, goal)

    def _number(self, state: dict[VariableName, int], goal: int) -> int:
        key = (tuple(state[name] for name in (*self._game.inputs, *self._game.outputs)), goal)
        if key not in self._numbers:
            if len(self._states) == MAX_NODES:
                raise SynthesisError([f'the strategy has more than {MAX_NODES} nodes: use fewer variables'])
            self._numbers[key] = len(self._states)
            self._states.append((state, goal))
        return self._numbers[key]

    def _some_members(self, names: list[VariableName], of: Diagram, where: str) -> Iterator[dict[VariableName, int]]:
        for number, member in enumerate(self._encoding.members(names, of)):
            if number == MAX_MOVES:
                raise SynthesisError(
                    [
                        f'{truncate_middle(where)} the world has more than {MAX_MOVES} moves: '
                        'say in ENV_TRANS what inputs depend on'
                    ]
                )
            yield member


def _shown(state: Valuation) -> str:
    return ', '.join(f'{name}={value}' if value != 1 else str(name) for name, value in state.items() if value)

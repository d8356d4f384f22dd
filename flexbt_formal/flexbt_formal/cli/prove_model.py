# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool prove main.xml`` for a model in the format of AS2FM: the probabilities of its properties."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any, Final

from flexbt_core.values.findings import finding_record
from flexbt_core.values.text import did_you_mean, one_line
from flexbt_core.values.text_files import open_regular
from flexbt_formal.roaml.checking import CheckLimits, Method, Result, check
from flexbt_formal.roaml.model import RoamlModel, is_model
from flexbt_formal.roaml.properties import ModelProperty
from flexbt_formal.roaml.rounds import Order
from flexbt_formal.roaml.source_text import ModelFault
from flexbt_tools.cli import arguments
from flexbt_tools.errors import ExitCode, UnfitError, UsageError

from . import proof_arguments

_HEAD = 4096


def add_arguments(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group('of a model in the format of AS2FM (main.xml)')
    arguments.add_list(group, '--property', 'NAME', 'only this property')
    method = 'explore all states (exact), or make random runs (statistical); auto: random runs if states are too many'
    arguments.add_choice(group, '--method', Method, Method.AUTO.value, method)
    order = 'order of automata that can step at the same time'
    arguments.add_choice(group, '--order', Order, Order.TURNS.value, order)
    limits = CheckLimits()
    error = 'stop random runs when the probability is known within E ...'
    arguments.add_number(group, '--error', 'E', limits.error, error, _part)
    arguments.add_number(group, '--confidence', 'C', limits.confidence, '... with this confidence', _part)
    arguments.add_number(group, '--seed', 'N', limits.seed, 'seed of the random numbers', int)


def _part(text: str) -> float:
    value = arguments.positive(text)
    if value >= 1.0:
        raise argparse.ArgumentTypeError(f'{text!r} is not between 0 and 1')
    return value


def is_asked(files: Sequence[str]) -> bool:
    """Return whether a file is the main file of a model. Raises UsageError if other files are passed with it."""
    found = [file for file in files if _is_model(file)]
    if found and len(files) > 1:
        raise UsageError(f'{found[0]} is the main file of a model, and names all others: give it alone')
    return bool(found)


def _is_model(file: str) -> bool:
    try:
        with open(file, encoding='utf-8', errors='replace', opener=open_regular) as opened:
            return is_model(opened.read(_HEAD))
    except OSError:
        return False  # the reader of trees reports it


def run(options: argparse.Namespace) -> ExitCode:
    for_trees = ('tree', 'given', 'save_test', 'save_recording', 'draw', 'require', 'requirements', 'against')
    for name in for_trees:
        if getattr(options, name):
            raise UsageError(f'--{name.replace("_", "-")} is for files of trees, and {options.files[0]} is a model')
    file: str = options.files[0]
    with proof_arguments.proving(options):
        model = RoamlModel(file)
    asked = _asked(model, options.property)
    limits = CheckLimits(
        options.seconds / len(asked), options.situations, options.error, options.confidence, options.seed
    )
    results: list[Result] = []
    if not options.json:
        print(one_line(f'model {file}: {len(asked)} {"property" if len(asked) == 1 else "properties"}'))
    for one in asked:
        try:
            with proof_arguments.proving(options) as progress:
                result = check(
                    model,
                    one,
                    order=Order(options.order),
                    method=Method(options.method),
                    limits=limits,
                    on_progress=partial(progress.show, one.name),
                )
        except ModelFault as error:
            raise UnfitError(f'the property {one.name!r} cannot be decided: {error}') from error
        except ValueError as error:
            raise UsageError(str(error)) from error
        results.append(result)
        if not options.json:
            for line in result_lines(result):
                print(one_line(line, 2000), flush=True)
    if options.json:
        findings = [finding_record('property', 'error', _verdict(one)) for one in results if one.holds is False]
        print(json.dumps({'model': file, 'properties': [result_as_json(one) for one in results], 'findings': findings}))
    if any(one.holds is False for one in results):
        return ExitCode.NEGATIVE
    return ExitCode.OK if all(one.holds for one in results) else ExitCode.UNFINISHED


def _asked(model: RoamlModel, names: Sequence[str]) -> list[ModelProperty]:
    known = {one.name: one for one in model.properties}
    for name in names:
        if name not in known:
            raise UsageError(f'there is no property {name!r}{did_you_mean(name, known)}')
    return [known[name] for name in dict.fromkeys(names)] or model.properties


# The results for the properties of a model, for a mission engineer and for programs.

_FIRST: Final = 10
_LAST: Final = 50
"""Maximum number of lines printed of a path."""


def result_lines(result: Result) -> Iterator[str]:
    """Yield the lines of a result: the verdict, the method, and a path on which the property fails."""
    yield f'  {_verdict(result)}'
    yield f'    {result.asked.text}{_demanded(result)}'
    yield f'    {result.how}, {result.seconds:.1f} s'
    for note in result.notes:
        yield f'    note: {note}'
    if result.way and result.holds is not True:
        kind = 'the shortest way' if result.is_exact else 'the shortest way that was met'
        yield f'    {kind} to where it has failed:'
        yield from (f'      {line}' for line in _shown(result.way))


_VERDICTS: Final = {True: 'holds', False: 'CAN FAIL', None: 'NOT DECIDED'}


def _verdict(result: Result) -> str:
    return f'{result.asked.name}: {_VERDICTS[result.holds]}, probability {_probability(result)}'


def _probability(result: Result) -> str:
    if result.is_exact:
        return f'{result.value:.6g}'
    return f'{result.value:.4g} (between {result.low:.4g} and {result.high:.4g})'


def _demanded(result: Result) -> str:
    if result.asked.demand is None:
        return ''
    sign, value = result.asked.demand
    return f' {sign} {value:g}'


def _shown(way: Sequence[str]) -> Sequence[str]:
    hidden = len(way) - _FIRST - _LAST
    if hidden <= 1:
        return way
    return [*way[:_FIRST], f'... {hidden} lines, which --json has ...', *way[-_LAST:]]


def result_as_json(result: Result) -> dict[str, Any]:
    """Return a result as plain data for JSON."""
    own = ('value', 'low', 'high', 'how', 'size', 'notes', 'way')
    return {
        'name': result.asked.name,
        'text': result.asked.text,
        'demand': result.asked.demand,
        'holds': result.holds,
        'exact': result.is_exact,
        'complete': result.is_complete,
        'seconds': round(result.seconds, 3),
        **{name: getattr(result, name) for name in own},
    }

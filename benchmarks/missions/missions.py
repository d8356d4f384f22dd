# SPDX-License-Identifier: BSD-3-Clause
"""How many of 40 mission tasks, told in plain words, a person or a language model solves.

An answer is a file: a tree, a machine, a mission, skills, capabilities, or requirements. Checks, proofs, runs with
mocks, plans and syntheses decide. A task is solved if all that its entry in tasks.yaml demands holds.

Usage: python3 benchmarks missions --tasks > tasks.json       what to give to whoever answers
       python3 benchmarks missions --answers DIR [--only ID]  DIR has a file ID.xml, ID.yaml or ID.txt for each task
       python3 benchmarks missions                            the reference answers, and the wrong ones beside them
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import yaml
from _figures import write_figures

from flexbt_testing.behavior_trees.bt_tool import Done, behavior_tool, tool

HERE: Final = Path(__file__).resolve().parent
SUFFIXES: Final = {
    'tree': '.xml',
    'machine': '.yaml',
    'mission': '.yaml',
    'skills': '.yaml',
    'capabilities': '.yaml',
    'requirements': '.txt',
}
"""File name extension of an answer, by its kind."""

Task = Mapping[str, Any]


def tasks() -> dict[str, Task]:
    """Return the tasks by their IDs."""
    document = yaml.safe_load((HERE / 'tasks.yaml').read_text(encoding='utf-8'))
    nodes = {'nodes.xml': document['nodes']}
    return {id: {**task, 'files': nodes | task.get('files', {})} for id, task in document['tasks'].items()}


def references() -> dict[str, tuple[str, str]]:
    """Return an answer that solves each task, and a plausible one that does not."""
    found = {}
    for id, answer in yaml.safe_load((HERE / 'answers.yaml').read_text(encoding='utf-8')).items():
        wrong = answer['right']
        for old, new in answer['wrong'].items():
            assert old in wrong, (id, old)
            wrong = wrong.replace(old, new)
        found[id] = (answer['right'], wrong)
    return found


def problems(task: Task, answer: str) -> list[str]:
    """Return what is wrong with an answer; nothing if it solves the task."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, text in task['files'].items():
            (folder / file).write_text(text, encoding='utf-8')
        file = folder / f'{task["answer"]}{SUFFIXES[task["answer"]]}'
        file.write_text(answer, encoding='utf-8')
        return list(_SCORERS[task['answer']](task, folder, file))


def _tree(task: Task, folder: Path, file: Path) -> Iterator[str]:
    models = f'--models={folder}/nodes.xml'
    keys = task.get('keys', [])
    yield from _wrong(tool('check', '--json', models, *(f'--input={key}' for key in keys), str(file)))
    yield from _wrong(_proved(task, models, str(file), *(f'--given={key}' for key in keys)))
    for run in task.get('runs', []):
        mocks = [f'--mock={name}={steps}' for name, steps in {**run.get('mocks', {}), '*': 'SUCCESS'}.items()]
        values = [f'--set={key}={key}' for key in keys]
        done = tool('run', '--json', models, *mocks, *values, str(file))
        *changes, result = [json.loads(line) for line in done.out.splitlines()] or [{'result': done.err}]
        found: dict[str, Any] = {key: result.get(key) for key in ('result', 'time')}
        found['blackboard'] = {
            key: result.get('blackboard', {}).get('', {}).get(key) for key in run.get('blackboard', {})
        }
        found['begun'] = [
            name
            for one in changes
            if one['before'] == 'IDLE' and (name := one['path'].partition('::')[0]) in run.get('leaves', [])
        ]
        for key in found.keys() & run.keys():
            if found[key] != run[key]:
                yield f'run with {run.get("mocks", {})}: {key} is {found[key]}, not {run[key]}'


def _machine(task: Task, folder: Path, file: Path) -> Iterator[str]:
    yield from _wrong(behavior_tool('check', '--json', str(file)))
    words = [f'--require={text}' for text in task['require']]
    yield from _wrong(behavior_tool('prove', '--json', '--anew', '--quiet', *words, str(file)))


def _plan(task: Task, folder: Path, file: Path) -> Iterator[str]:
    """Compare the plans of the mission: the answer itself, or the given one with the skills of the answer."""
    for case in task['plans']:
        words = [*(f'--start={one}' for one in case.get('start', ())), f'--disturbed={case.get("disturbed", 1)}']
        words += [f'--goal={case["goal"]}'] if 'goal' in case else []
        done = tool('plan', '--json', '--quiet', *words, str(folder / 'mission.yaml'))
        found = json.loads(done.out) if done.out else {}
        if 'outcome' not in found:
            yield from _wrong(done)
        elif found['cost'] != case['cost']:
            yield f'the plan for {words} costs {found["cost"]}, not {case["cost"]}'
        elif found['hopeless']:
            yield f'no way to the goal after {found["hopeless"]}'
        elif 'states' in case and found['coverage']['states'] != case['states']:
            yield f'{found["coverage"]["states"]} states come with the disturbances, not {case["states"]}'


def _capabilities(task: Task, folder: Path, file: Path) -> Iterator[str]:
    machine = folder / 'machine.yaml'
    words = [*(f'--goal={one}' for one in task['goals']), *(f'--initial={one}' for one in task['initial'])]
    done = behavior_tool('synthesize', '--json', '--retries=1', f'--output={machine}', *words, str(file))
    yield from _wrong(done)
    if machine.exists():
        yield from _machine(task, folder, machine)


def _requirements(task: Task, folder: Path, file: Path) -> Iterator[str]:
    """Hold the trees of the task against the answer: the right ones keep it, and each wrong one breaks it."""
    texts = [line.strip() for line in file.read_text(encoding='utf-8').splitlines() if line.strip()]
    if len(texts) > task['most']:
        yield f'{len(texts)} requirements; {task["most"]} are allowed'
    for name in task['files']:
        if name != 'nodes.xml':
            done = _proved({'require': texts}, f'--models={folder}/nodes.xml', str(folder / name))
            if done.code != (0 if name.startswith('right') else 1):
                yield f'{name}: {"; ".join(_wrong(done)) or "it keeps the requirements, and should not"}'


_SCORERS: Final[dict[str, Callable[[Task, Path, Path], Iterator[str]]]] = {
    'tree': _tree,
    'machine': _machine,
    'mission': _plan,
    'skills': _plan,
    'capabilities': _capabilities,
    'requirements': _requirements,
}


def _proved(task: Task, *words: str) -> Done:
    required = (f'--require={text}' for text in task.get('require', []))
    return tool('prove', '--json', '--anew', '--quiet', '--seconds=60', *required, *words)


def _wrong(done: Done) -> list[str]:
    """Return what a command has found; nothing if its exit code is 0."""
    if done.code == 0:
        return []
    findings = json.loads(done.out)['findings'] if done.out else []
    return [one['message'] for one in findings if one['severity'] == 'error'] or [f'exit code {done.code}: {done.err}']


def score(chosen: Mapping[str, Task], answers: Mapping[str, str]) -> dict[str, str]:
    """Print and return the first thing that is wrong with each answer; '' if it solves its task."""
    found = {}
    for id, task in chosen.items():
        found[id] = next(iter(problems(task, answers[id])), '') if id in answers else 'no answer'
        print(f'{id:24} {f"no: {found[id][:150]}" if found[id] else "solved"}', flush=True)
    print(f'{list(found.values()).count("")}/{len(found)} solved')
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    what = parser.add_mutually_exclusive_group()
    what.add_argument('--tasks', action='store_true', help='print the tasks as JSON, without what decides')
    what.add_argument('--answers', type=Path, metavar='DIR', help='score the answers in this folder')
    parser.add_argument('--only', metavar='ID', help='only this task')
    parser.add_argument('--output', type=Path, default=Path('out/missions.json'))
    options = parser.parse_args()
    known = tasks()
    if options.only is not None and options.only not in known:
        parser.error(f'there is no task {options.only!r}; there are: {", ".join(known)}')
    chosen = {id: task for id, task in known.items() if options.only in (None, id)}
    files = {id: f'{id}{SUFFIXES[task["answer"]]}' for id, task in chosen.items()}
    if options.tasks:
        told = {id: {'text': task['text'], 'files': task['files'], 'answer': files[id]} for id, task in chosen.items()}
        print(json.dumps(told, indent=1))
        return 0
    if options.answers is not None:
        if not options.answers.is_dir():
            parser.error(f'{options.answers} is not a folder')
        places = {id: options.answers / file for id, file in files.items()}
        given = {id: place.read_text('utf-8', 'replace') for id, place in places.items() if place.is_file()}
        scores = {'answers': score(chosen, given)}
    else:
        right, wrong = ({id: pair[number] for id, pair in references().items()} for number in (0, 1))
        scores = {'reference': score(chosen, right), 'wrong': score(chosen, wrong)}
    write_figures(options.output, scores)
    is_right = all(not any(found.values()) for name, found in scores.items() if name != 'wrong')
    return 0 if is_right and all(scores.get('wrong', {'': 'none'}).values()) else 1


if __name__ == '__main__':
    sys.exit(main())

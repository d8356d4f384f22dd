# SPDX-License-Identifier: BSD-3-Clause
"""The tasks of ``benchmarks/missions``: each is solved by its reference answer, and not by a plausible wrong one."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[3] / 'benchmarks'
sys.path[:0] = [str(BENCHMARKS / 'missions'), str(BENCHMARKS / 'support')]
missions = importlib.import_module('missions')
del sys.path[:2]

TASKS, REFERENCES = missions.tasks(), missions.references()


def test_there_are_forty() -> None:
    assert len(TASKS) == 40 and list(TASKS) == list(REFERENCES)


@pytest.mark.parametrize('id', TASKS)
def test_a_task_is_solved_by_what_is_right_only(id: str) -> None:
    right, wrong = REFERENCES[id]
    assert missions.problems(TASKS[id], right) == []
    assert missions.problems(TASKS[id], wrong)
    assert missions.problems(TASKS[id], '') and missions.problems(TASKS[id], '<')


def test_answers_in_a_folder_are_scored(tmp_path: Path) -> None:
    def score(*words: str) -> tuple[int, list[str]]:
        output = f'--output={tmp_path}/out.json'
        command = [sys.executable, str(BENCHMARKS), 'missions', f'--answers={tmp_path}', output, *words]
        done = subprocess.run(command, capture_output=True, text=True)
        return done.returncode, done.stdout.splitlines()

    for id, one in list(zip(TASKS, REFERENCES.values(), strict=True))[:4]:
        right, wrong = one
        (tmp_path / f'{id}{missions.SUFFIXES[TASKS[id]["answer"]]}').write_text(wrong if id == 'fetch_cup' else right)
    (tmp_path / 'report_each_round.yaml').write_bytes(b'\xff\0machine: [')
    code, lines = score()
    assert (code, len(lines), lines[-1]) == (1, 41, '3/40 solved')
    solved = {line.split()[0] for line in lines[:-1] if line.endswith(' solved')}
    assert solved == {'plan_and_drive', 'photo_round', 'parts_for_both'}
    found = json.loads((tmp_path / 'out.json').read_text())['answers']
    assert found['plan_and_drive'] == '' and found['visit_all'] == 'no answer'
    assert score('--only', 'photo_round')[0] == 0
    told = json.loads(
        subprocess.run([sys.executable, str(BENCHMARKS), 'missions', '--tasks'], capture_output=True, text=True).stdout
    )
    assert list(told) == list(TASKS) and told['told_of_a_failure'].keys() == {'text', 'files', 'answer'}

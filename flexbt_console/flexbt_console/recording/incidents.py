# SPDX-License-Identifier: BSD-3-Clause
"""Incidents: folders with what a robot did before and after something went wrong, and a page that tells it.

A black box (:mod:`.black_box`) writes a *request*, a JSON file beside its ring of recordings. This module makes the
folder of it, in a process of its own that may take its time, and may be killed: a folder gets its name when it is
complete, and a request is removed after that. ``python3 -m flexbt_console.recording.incidents REQUEST`` makes one.
"""

from __future__ import annotations

import contextlib
import fcntl
import html
import json
import os
import platform
import re
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import distributions
from itertools import count
from pathlib import Path
from typing import Any, Final

from rcl_interfaces.msg import Log

from flexbt_common.files import alone_in
from flexbt_common.middleware.received_messages import Received
from flexbt_common.pictures.time_line import Bar, Look, time_line
from flexbt_console.errors import UsageError
from flexbt_console.mirror.lanes import Lane, LaneEntry
from flexbt_console.present.maps import save_map
from flexbt_console.present.rendering import status_lines
from flexbt_console.present.style import glyphs
from flexbt_console.present.tree_lines import whole_tree_lines
from flexbt_core.values.json_data import load_json
from flexbt_core.values.text import one_line
from flexbt_core.values.text_files import write_text

from .player import RunPlayer
from .run_file import RECORDING, RunWriter, read_run

FACTS: Final = 'incident.json'
PAGE: Final = 'incident.md'
ROSOUT: Final = '/rosout'

LED_SECONDS: Final = 60.0
"""Time before the incident of which the page shows each entry of the lanes, s."""

_MOST_ROSOUT: Final = 200
_MOST_COPIED: Final = 1_000_000
_MOST_FILES: Final = 20
_PART: Final = '.part_'
_LEVELS: Final = {10: 'debug', 20: 'info', 30: 'warn', 40: 'error', 50: 'fatal'}


@dataclass(frozen=True)
class Occurrence:
    """Something that makes an incident: when (s since the epoch), of what kind, and in words."""

    time: float
    kind: str
    text: str


@dataclass(frozen=True)
class Request:
    """What a black box wants kept.

    ``occurrences``: the first one names the incident. ``segments``: files of its ring, oldest first. ``records``:
    directories of event log, journal and log files of trees; what changed in them since ``since`` (s since the epoch)
    is copied. ``target``: the directory of the incidents, of which the newest ``keep`` stay, and at most ``size``
    bytes. ``number``: which one it is of those with the same kind in the same second, from 1.
    """

    robot: str
    occurrences: tuple[Occurrence, ...]
    segments: tuple[str, ...]
    target: str
    since: float
    records: tuple[str, ...] = ()
    parameters: dict[str, dict[str, Any]] = field(default_factory=dict)
    keep: int = 50
    size: int = 1_000_000_000
    number: int = 1

    def write(self, file: Path) -> None:
        """Replace the file as a whole. Raises OSError."""
        write_text(file, json.dumps(asdict(self), default=str))

    @classmethod
    def read(cls, file: Path) -> Request:
        """Read it. Raises OSError or ValueError."""
        known = load_json(file.read_text(encoding='utf-8'))
        try:
            tuples = {name: tuple(known[name]) for name in ('segments', 'records')}
            return cls(**known | tuples | {'occurrences': tuple(Occurrence(**one) for one in known['occurrences'])})
        except (TypeError, KeyError) as error:
            raise ValueError(f'{file}: is no request of a black box: {error}') from error

    @property
    def name(self) -> str:
        """Name of the folder: the time in UTC, the kind, and the robot, as several may have one directory."""
        first = self.occurrences[0]
        number = f'.{self.number}' if self.number > 1 else ''
        robot = f'_{self.robot.replace("/", ".")}' if self.robot else ''
        return f'{datetime.fromtimestamp(first.time, UTC):%Y%m%d_%H%M%S}{number}_{first.kind}{robot}'

    def unless(self, is_taken: Callable[[Request], bool]) -> Request:
        """Return it with the first number whose name is not taken."""
        return next(one for number in count(self.number) if not is_taken(one := replace(self, number=number)))


@dataclass(frozen=True)
class Incident:
    """An incident on disk."""

    folder: Path
    robot: str
    occurrences: tuple[Occurrence, ...]

    @property
    def first(self) -> Occurrence:
        """What made it."""
        return self.occurrences[0]

    @property
    def facts(self) -> dict[str, Any]:
        """What it is, for programs."""
        return {
            'folder': str(self.folder),
            'robot': self.robot,
            'occurrences': [asdict(one) for one in self.occurrences],
        }

    @property
    def line(self) -> str:
        """It in one line: name, robot and what happened."""
        return one_line(f'{self.folder.name}  {self.robot or "/"}  {self.first.text}', 300)


def files_in(folder: Path) -> list[str]:
    """Return the files of an incident, by their paths in its folder; no links."""
    found = (file for file in folder.rglob('*') if file.is_file() and not file.is_symlink())
    return sorted(str(file.relative_to(folder)) for file in found)


def incidents_in(directory: Path) -> list[Incident]:
    """Return the complete incidents in a directory, newest first; none if it is missing. Damaged ones are left out."""
    found = []
    for facts in directory.glob(f'*/{FACTS}'):
        one = _incident_in(facts.parent)
        if one is not None and not facts.parent.name.startswith(_PART):
            found.append(one)
    return sorted(found, key=lambda one: one.first.time, reverse=True)


def _incident_in(folder: Path) -> Incident | None:
    """Return the incident in a folder; None if it is missing or damaged."""
    with contextlib.suppress(OSError, ValueError, TypeError, KeyError, IndexError, RecursionError):
        known = load_json((folder / FACTS).read_text(encoding='utf-8'))
        happened = tuple(
            Occurrence(float(one['time']), str(one['kind']), str(one['text'])) for one in known['occurrences']
        )
        return Incident(folder, str(known['robot']), (happened[0], *happened[1:]))
    return None


def incident_named(directory: Path, name: str) -> Incident:
    """Return the incident of a name, or else the one whose name begins so; '' is the newest one.

    Raises:
        UsageError: there is none, or there are several.
    """
    known = incidents_in(directory)
    found = [one for one in known if one.folder.name == name]
    found = found or [one for one in known if one.folder.name.startswith(name)][: None if name else 1]
    if len(found) != 1:
        what = f'{len(found)} incidents begin with {name!r}' if name else 'there is no incident'
        raise UsageError(f'{directory}: {what}; "console incidents" lists them')
    return found[0]


def make(request: Request) -> Path:
    """Make the folder of an incident, and remove what is too much. One that is there already stays as it is.

    Raises:
        OSError: the disk does not take it; nothing of it stays.
    """
    target = Path(request.target)
    target.mkdir(mode=0o700, parents=True, exist_ok=True)
    with alone_in(target):  # several black boxes may share it
        request = request.unless(partial(_is_of_another, target))
        folder = target / request.name
        if not folder.exists():
            _fill(request, target, folder)
            _remove_old(target, request, folder)
    return folder


def _is_of_another(target: Path, request: Request) -> bool:
    """Return whether the name of a request is that of another incident, or of anything else."""
    folder = target / request.name
    there = _incident_in(folder)
    return folder.exists() and (there is None or there.first != request.occurrences[0])


def _fill(request: Request, target: Path, folder: Path) -> None:
    for left in target.glob(f'{_PART}*'):  # nobody else makes one now
        shutil.rmtree(left, ignore_errors=True)
    part = target / f'{_PART}{request.name}'
    part.mkdir(mode=0o700)
    try:
        lost = merge([Path(one) for one in request.segments], part / RECORDING)
        copied = _copy_records(request, part)
        write_text(part / 'parameters.json', json.dumps(request.parameters, indent=1, default=str))
        write_text(part / 'versions.txt', '\n'.join(_versions()) + '\n')
        _write_pages(request, part, [*lost, *copied])
        facts = Incident(folder, request.robot, request.occurrences).facts
        write_text(part / FACTS, json.dumps(facts, indent=1))
        part.replace(folder)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise


def merge(segments: Sequence[Path], file: Path) -> list[str]:
    """Write one recording of the segments of a ring, and return what could not be read.

    Each segment begins with what late subscribers would get: what an earlier one has of that is left out, and the rest,
    which is in none of them, gets the time at which the segment begins.
    """
    lost: list[str] = []
    latest = -1
    with contextlib.closing(RunWriter(file)) as writer:
        for segment in segments:
            begin, before = int(segment.stem), latest
            try:
                for one in read_run(segment, lambda name=segment.name: lost.append(f'{name} was cut off')):  # type: ignore[misc]
                    latest = max(latest, one.time)
                    if one.time >= begin or one.time > before:
                        writer.add_topic(one.topic, one.resolved, one.type, one.definition)
                        writer.add(one.topic, one.data, max(one.time, begin), one.sent)
            except UsageError as error:
                lost.append(one_line(str(error), 300))
    return [f'Recording: {one}' for one in lost]


def _copy_records(request: Request, part: Path) -> list[str]:
    """Copy the ends of the files that changed lately; return what could not be copied."""
    found: list[tuple[float, Path]] = []
    lost: list[str] = []
    for directory in map(Path, request.records):
        for file in directory.glob('*'):
            with contextlib.suppress(OSError):
                known = file.lstat()
                if known.st_mtime >= request.since and file.is_file() and not file.is_symlink():
                    found.append((known.st_mtime, file))
    for _, file in sorted(found, reverse=True)[:_MOST_FILES]:
        try:
            with file.open('rb') as source:
                size = source.seek(0, os.SEEK_END)
                source.seek(max(0, size - _MOST_COPIED))
                data = source.read(_MOST_COPIED)
            is_cut = size > _MOST_COPIED and file.suffix == '.jsonl'
            records = part / 'records'
            records.mkdir(mode=0o700, exist_ok=True)
            names = (f'{number}_{file.name}' if number > 1 else file.name for number in count(1))
            copy = next(records / name for name in names if not (records / name).exists())
            copy.write_bytes(data.partition(b'\n')[2] if is_cut else data)
        except PermissionError as error:
            lost.append(f'{file} was not copied: {error.strerror}')
    return lost


def _versions() -> Iterator[str]:
    known = {one.name: one.version for one in distributions() if one.name}
    yield f'python {platform.python_version()} on {platform.platform()}'
    yield f'ROS {os.environ.get("ROS_DISTRO", "?")} {os.environ.get("RMW_IMPLEMENTATION", "")}'.rstrip()
    yield from (f'{name} {version}' for name, version in sorted(known.items()) if 'flexbt' in name or name == 'rclpy')


def _remove_old(target: Path, request: Request, made: Path) -> None:
    """Remove the oldest incidents until those that stay are few and small enough. That which was made now always stays,
    whatever the clock was before."""
    left = request.size
    for number, one in enumerate(sorted(incidents_in(target), key=lambda one: one.folder != made)):
        left -= sum(file.stat().st_size for file in one.folder.rglob('*') if file.is_file())
        if number and (number >= request.keep or left < 0):
            shutil.rmtree(one.folder, ignore_errors=True)


# The page: what happened, what led to it, and what each part believed at that moment. Markdown and HTML say the same.


@dataclass(frozen=True)
class _Section:
    """A part of the page: a heading, and lines as they are, or a picture (its file name)."""

    heading: str
    lines: Sequence[str] = ()
    picture: str = ''


def _write_pages(request: Request, part: Path, lost: list[str]) -> None:
    first = request.occurrences[0]
    when = datetime.fromtimestamp(first.time, UTC)
    title = f'{first.kind}, robot {request.robot or "/"}, {when:%Y-%m-%d %H:%M:%S} UTC'
    told = [f'{one.time - first.time:+8.1f} s  {one.kind:8}  {one_line(one.text, 500)}' for one in request.occurrences]
    sections = [_Section('What happened', told)]
    try:
        sections += _sections_of(part, first)
    except UsageError as error:
        lost.append(one_line(str(error), 300))
    sections += [_Section('What is missing', lost)] if lost else []
    sections += [_Section('Files', [*files_in(part), 'console replay FOLDER shows the recording'])]
    write_text(part / PAGE, _markdown(title, sections))
    write_text(part / 'incident.html', _html(title, sections))


def _sections_of(part: Path, first: Occurrence) -> Iterator[_Section]:
    """Return the parts of the page that the recording tells. Raises UsageError if it tells nothing."""
    file = part / RECORDING
    player = RunPlayer(file)
    moment = min(max(0.0, first.time - player.begin * 1e-9), player.duration)
    entries = player.lanes().since(0)
    if entries:
        write_text(part / 'timeline.svg', lanes_svg(entries, player.duration, moment))
        yield _Section('Time line', picture='timeline.svg')
    shown = [one for one in entries if one.lane is not Lane.NODES and moment - LED_SECONDS <= one.begin]
    yield _Section(
        'What led to it (seconds before and after)',
        [
            f'{one.begin - moment:+8.1f} s  {one.lane.value:9}  '
            f'{one_line(one.text or one.label, 300)}{f": {one.word}" if one.word and one.word not in one.text else ""}'
            for one in sorted(shown, key=lambda one: one.begin)
        ]
        or ['nothing was recorded'],
    )
    player.go_to(moment)
    view = player.mirror.view()
    yield _Section('What the executive believed', [one_line(line, 500) for line in status_lines(view)])
    if view.guard.told:
        yield _Section('The stop guard', [view.guard.told])
    for run in view.trees[:5]:
        yield _Section(f'Tree {one_line(run.tree, 100)}', whole_tree_lines(run, glyphs())[:200])
    if view.surroundings.map is not None:
        save_map(part / 'map.png', view)
        yield _Section('Map', picture='map.png')
    said = list(_rosout(file))[-_MOST_ROSOUT:]
    if said:
        yield _Section(f'The last {len(said)} lines of {ROSOUT}', said)


def _rosout(file: Path) -> Iterator[str]:
    for one in read_run(file):
        if one.topic == ROSOUT:
            with contextlib.suppress(ValueError):
                line = Received(one.data, len(one.data), b'', 0.0).unpack(Log)
                when = datetime.fromtimestamp(one.time * 1e-9, UTC)
                level = _LEVELS.get(line.level, str(line.level))
                yield f'{when:%H:%M:%S.%f} {level:5} {one_line(line.name, 60)}: {one_line(line.msg, 500)}'


def _markdown(title: str, sections: Iterable[_Section]) -> str:
    shown = ['# Incident: ' + re.sub(r'[\\`*_\[\]<>#]', r'\\\g<0>', title)]
    for one in sections:
        longest = max((line.count('`') for line in one.lines), default=0)
        fence = '`' * max(3, longest + 1)
        body = f'![{one.heading}]({one.picture})' if one.picture else '\n'.join([fence, *one.lines, fence])
        shown.append(f'## {one.heading}\n\n{body}')
    return '\n\n'.join(shown) + '\n'


_STYLE: Final = (
    'body{font:14px/1.5 system-ui,sans-serif;margin:2em auto;max-width:70em;padding:0 1em;color:#1b1d21}'
    'pre{background:#f4f5f7;padding:1em;font-size:13px;white-space:pre-wrap;overflow-wrap:anywhere}'
    'img{max-width:100%}h1{font-size:1.5em}h2{margin-top:2em}'
    '@media (prefers-color-scheme:dark){body{background:#1b1d21;color:#e8e8e8}pre{background:#26292f}}'
)


def _html(title: str, sections: Iterable[_Section]) -> str:
    shown = [
        '<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">',
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src 'self'; "
        "style-src 'unsafe-inline'\">",
        f'<title>Incident: {html.escape(title)}</title><style>{_STYLE}</style><h1>Incident: {html.escape(title)}</h1>',
    ]
    for one in sections:
        picture = f'<p><img src="{html.escape(one.picture)}" alt="{html.escape(one.heading)}"></p>'
        body = picture if one.picture else f'<pre>{html.escape(chr(10).join(one.lines))}</pre>'
        shown.append(f'<h2>{html.escape(one.heading)}</h2>{body}')
    return '\n'.join(shown) + '\n'


_LOOKS: Final = {
    'plain': Look('#4c78a8', '#6fa0d6', 'was so'),
    'good': Look('#2a7d4f', '#4caf7d', 'went well'),
    'warning': Look('#b9770e', '#e0a040', 'warning'),
    'error': Look('#c0392b', '#ff8a80', 'wrong'),
    'now': Look('#c0392b', '#ff8a80', 'the incident'),
}
_MOST_ROWS: Final = 60


def lanes_svg(entries: Sequence[LaneEntry], duration: float, moment: float) -> str:
    """Return the lanes as a picture with a row for each thing; if there are too many, those of the latest entries."""
    order, entries = list(Lane), [one for one in entries if one.end is None or one.end >= 0.0]
    labels = {(one.lane, one.key): one.label for one in sorted(entries, key=lambda one: order.index(one.lane))}
    latest = {(one.lane, one.key): one.begin for one in entries}
    kept = set(sorted(labels, key=lambda row: latest[row], reverse=True)[:_MOST_ROWS])
    places = {row: place for place, row in enumerate(row for row in labels if row in kept)}
    rows = [(f'{lane.value}: {labels[lane, key]}'[:34], key) for lane, key in places]
    bars = [
        Bar(
            places[one.lane, one.key],
            one.begin,
            duration if one.end is None else one.end,
            one.tone or 'plain',
            f'{one.begin - moment:+.1f} s  {one.label} {one.word}  {one.text}',
        )
        for one in entries
        if (one.lane, one.key) in places
    ]
    bars.append(Bar(None, moment, moment, 'now', 'the incident'))
    begin = max(0.0, min(bar.begin for bar in bars))  # of a robot that did nothing before there is nothing to see
    return time_line([], rows, bars, _LOOKS, (begin, duration), moment)


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the incidents of requests, remove these, and print the folders. Return 1 if one is impossible now."""
    failures = 0
    for file in map(Path, sys.argv[1:] if arguments is None else arguments):
        try:
            request = Request.read(file)
            with file.open() as held:  # until the maker of a black box that has ended, which goes on, is ready
                fcntl.flock(held, fcntl.LOCK_EX)
                folder = make(request)
                file.unlink(missing_ok=True)
            print(folder)
        except (OSError, ValueError, UsageError) as error:
            print(one_line(f'{type(error).__name__}: {error}', 500), file=sys.stderr)
            failures += 1
    return int(failures > 0)


if __name__ == '__main__':
    sys.exit(main())

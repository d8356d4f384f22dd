# SPDX-License-Identifier: BSD-3-Clause
"""Runs as spans of OpenTelemetry: a trace for each run, a span for each visit of a state or machine.

They are sent by OTLP over HTTP in its JSON form (https://opentelemetry.io/docs/specs/otlp/), which collectors take at
``/v1/traces``. That form is simple, so this needs no library.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import urllib.error
import urllib.request
from collections.abc import Iterator, Mapping
from http.client import HTTPException, InvalidURL
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from .run_metrics import ROOT, LoggedEvent, OperatorWait, RunMetrics, events_in, metrics_of

SEND_SECONDS: Final = 10.0
"""Time for a collector to answer, s."""

MOST_EVENTS: Final = 50_000
"""Events of a run that are kept until it ends."""

_MOST_RUNS: Final = 16
_FINAL: Final = (400, 413)
"""HTTP codes of an answer to spans that a collector never takes, such as more than it allows."""

FAILED: Final = frozenset({'failed', 'error', 'preempted', 'canceled'})
"""Outcomes with which a span has the status ERROR."""

_INTERNAL: Final = 1
_OK: Final = 1
_ERROR: Final = 2


class SpanError(Exception):
    """A collector that cannot be reached, or refuses the spans. ``is_final``: it never takes these spans."""

    is_final = False


def ended_runs(file: Path) -> Iterator[RunMetrics]:
    """Yield each run that ends in an event log from now on, with wall times; also when the log is rotated meanwhile.

    A run that began before, or has more than MOST_EVENTS events, is told by those events that are known.
    """
    runs: dict[str, list[LoggedEvent]] = {}
    words = ['tail', '--lines=0', f'--pid={os.getpid()}', '-F', '--', str(file)]  # which ends with this process
    pipes: dict[str, Any] = {'stdout': subprocess.PIPE, 'stderr': subprocess.DEVNULL, 'text': True}
    with subprocess.Popen(words, errors='replace', **pipes) as log:  # noqa: S603
        assert log.stdout is not None
        for event in events_in(log.stdout):
            run = str(event.get('run', ''))
            if event['event'] == 'executive':
                for events in runs.values():
                    events.append(event)  # a run goes on after a crash
            if not run:
                continue
            known = runs.setdefault(run, [])
            known.append(event)
            del known[:-MOST_EVENTS]
            if event['event'] == 'ended':
                first = {**known[0], 'event': 'started', 'run': run, 'behavior': event.get('behavior', '')}
                has_start = known[0]['event'] in ('started', 'resumed')
                yield from metrics_of(known if has_start else [first, *known], wall=True)
                del runs[run]
            while len(runs) > _MOST_RUNS:
                del runs[next(iter(runs))]


def spans_of(run: RunMetrics, robot: str = '') -> dict[str, Any]:
    """Return the body of a request for a run with wall times. The same run always has the same identifiers."""
    trace = hashlib.sha256(run.run.encode(errors='replace')).hexdigest()[:32]
    root = _span(trace, f'behavior {run.behavior}', run.begin, run.end, '', trace[:16], run.outcome, run.message)
    root['attributes'] = _attributes({'flexbt.run': run.run, 'flexbt.by': run.by, 'flexbt.faults': run.faults})
    root['events'] = [
        _event(one.time, one.command.lower(), operator=one.operator, effect=one.effect, text=one.text)
        for one in run.interventions
    ]
    visits = sorted(run.visits, key=lambda visit: (visit.begin, visit.path.rstrip('/').count('/')))
    waits: dict[int, list[OperatorWait]] = {}
    for wait in run.waits:  # of the newest visit, if the next one begins at the end of one
        of = [at for at, one in enumerate(visits) if one.path == wait.path and one.begin <= wait.begin <= one.end]
        waits.setdefault(of[-1] if of else -1, []).append(wait)
    spans, open_visits = [root], {ROOT: (trace[:16], run.end)}
    for number, visit in enumerate(visits):
        own = hashlib.sha256(f'{run.run} {number} {visit.path}'.encode(errors='replace')).hexdigest()[:16]
        parent = (
            open_visits.get(visit.path.rpartition('/')[0], open_visits[ROOT])[0] if visit.path != ROOT else trace[:16]
        )
        span = _span(trace, visit.path, visit.begin, visit.end, parent, own, visit.outcome)
        span['attributes'] = _attributes({'flexbt.reason': visit.reason})
        told = waits.get(number, ())
        span['events'] = [_event(one.begin, 'waits', kind=one.kind, seconds=one.end - one.begin) for one in told]
        open_visits[visit.path] = own, visit.end
        spans.append(span)
    resource = {'service.name': 'flexbt', 'service.version': version('flexbt_onboard'), 'robot': robot}
    scope = {'scope': {'name': 'flexbt_onboard.run_spans'}, 'spans': spans}
    return {'resourceSpans': [{'resource': {'attributes': _attributes(resource)}, 'scopeSpans': [scope]}]}


def traces_address(url: str) -> str:
    """Return the address to which spans are sent, of a collector such as http://localhost:4318.

    Raises:
        argparse.ArgumentTypeError: it is no address of a collector.
    """
    if not url.startswith(('http://', 'https://')):
        raise argparse.ArgumentTypeError(f'{url!r}: give the address of a collector, such as http://localhost:4318')
    return url if url.rstrip('/').endswith('/v1/traces') else f'{url.rstrip("/")}/v1/traces'


def send_spans(address: str, body: Mapping[str, Any]) -> None:
    """Send the spans of a run to an address of :func:`traces_address`.

    Raises:
        SpanError: it cannot be reached, or refuses them.
    """
    headers = {'Content-Type': 'application/json'}
    try:
        request = urllib.request.Request(address, json.dumps(body).encode(), headers)  # noqa: S310 - checked above
        with urllib.request.urlopen(request, timeout=SEND_SECONDS):  # noqa: S310
            pass
    except urllib.error.HTTPError as error:
        refusal = SpanError(f'{address}: {error}')
        refusal.is_final = error.code in _FINAL
        raise refusal from error
    except (OSError, ValueError, InvalidURL) as error:
        cause = getattr(error, 'reason', error)  # urllib wraps what the system has told
        raise SpanError(f'{address}: {getattr(cause, "strerror", None) or cause}') from error
    except HTTPException as error:
        raise SpanError(f'{address}: the answer is not HTTP; a collector takes OTLP over HTTP at port 4318') from error


def _span(
    trace: str, name: str, begin: float, end: float, parent: str, own: str, outcome: str, message: str = ''
) -> dict[str, Any]:
    status = {'code': _ERROR if outcome in FAILED else _OK, 'message': message} if outcome else {}
    return {
        'traceId': trace,
        'spanId': own,
        'parentSpanId': parent,
        'name': name,
        'kind': _INTERNAL,
        'startTimeUnixNano': _nanoseconds(begin),
        'endTimeUnixNano': _nanoseconds(max(begin, end)),
        'status': status,
    }


def _event(time: float, name: str, **attributes: Any) -> dict[str, Any]:
    return {'timeUnixNano': _nanoseconds(time), 'name': name, 'attributes': _attributes(attributes)}


def _attributes(values: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [
        {'key': key, 'value': {'stringValue': value} if isinstance(value, str) else {'doubleValue': float(value)}}
        for key, value in values.items()
        if value != ''
    ]


def _nanoseconds(seconds: float) -> str:
    return str(round(seconds * 1e9))

# SPDX-License-Identifier: BSD-3-Clause
"""The program that calls people: look at the robots, decide, remember, and let processes send.

Nothing here waits for a service: each message is sent by a process of its own (:mod:`.sender`), a few at a time.
"""

from __future__ import annotations

import json
import random
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime
from itertools import chain
from pathlib import Path
from typing import Any, Final, Protocol

from flexbt_console.errors import ConsoleError, UsageError
from flexbt_console.mirror.fleet import Urgency
from flexbt_core.clock.clock import seconds_asleep
from flexbt_core.clock.rates import TokenBucket
from flexbt_core.values.text import one_line, pluralize
from flexbt_core.values.text_files import version_of

from .delivered import SEND_SECONDS
from .escalation import Call, SeenRobot
from .rules import AlertRules, Severity, load_rules, rule_text
from .store import Store

PERIOD: Final = 1.0
"""Time between two looks at the robots, s."""

SENDING_PERIOD: Final = 0.1
"""Time between two looks at processes that send, s."""

STILL_SECONDS: Final = 5.0
"""Time, s, by which a robot may be silent for longer than this program has listened. If it is more, the computer slept
or the process stood still, and the robot could not be heard."""
HEAR_SECONDS: Final = 30.0
"""Time for which this program listens to such a robot before it calls somebody about it, s."""

MOST_SENDERS: Final = 4
"""Maximum number of processes that send at the same time."""

BURST: Final = 5
BUNDLE_SECONDS: Final = 60.0
"""Messages to an address at once after a quiet time, and time between further ones, s: what comes meanwhile is one
message."""

FIRST_PAUSE: Final = 5.0
LONGEST_PAUSE: Final = 600.0
"""Pauses after a failed attempt, s: each is twice the one before."""

MOST_LISTED: Final = 20
"""Maximum number of things that a message lists; it counts the others."""

LONGEST_BODY: Final = 8_000
"""Maximum characters of a message."""

_TYPES: Final = {Severity.INFO: 'info', Severity.WARNING: 'warning', Severity.CRITICAL: 'failure'}
_SENDER: Final = (sys.executable, '-P', '-m', 'flexbt_console.alerts.sender')


class Log(Protocol):
    """A log."""

    def info(self, message: str) -> object: ...
    def warning(self, message: str) -> object: ...
    def error(self, message: str) -> object: ...


def _done(task: Mapping[str, Any], *locks: int) -> dict[str, Any]:
    """Let a process carry out one task of :mod:`.sender`, and return its answer. It holds the lock of the store, and
    goes on if this process ends."""
    try:
        ended = subprocess.run(  # noqa: S603 of our own
            _SENDER,
            input=json.dumps(task, ensure_ascii=False).encode(errors='replace'),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            pass_fds=locks,
            start_new_session=True,
            timeout=SEND_SECONDS + 5.0,  # it was stopped
        )
        found = json.loads(ended.stdout.splitlines()[-1])
    except (subprocess.TimeoutExpired, IndexError, ValueError):
        return {'reason': f'it did not answer within {SEND_SECONDS:g} s, or the process that sends was ended'}
    except (OSError, subprocess.SubprocessError) as error:
        return {'reason': f'no process could be started: {type(error).__name__}', 'is_certain': True}
    return found if isinstance(found, dict) else {'reason': 'apprise could not send it'}


@dataclass
class _Address:
    """An address with what was tried there. ``doubtful`` calls of the batch may have arrived by an earlier attempt."""

    bucket: TokenBucket
    failures: int = 0
    next_try: float = 0.0
    answer: Future[dict[str, Any]] | None = None
    batch: list[Call] = field(default_factory=list)
    doubtful: set[int] = field(default_factory=set)


class Calling:
    """The rules of a file at work on robots, which ``look`` returns; ``log`` gets what happens. ``unwatched`` returns
    how many other robots were found."""

    def __init__(
        self,
        file: Path,
        store: Store,
        look: Callable[[], Sequence[SeenRobot]],
        log: Log,
        unwatched: Callable[[], int] = lambda: 0,
    ) -> None:
        """Read the file. Raises UsageError as :func:`load_rules`."""
        self._file = file
        self._store = store
        self._look = look
        self._log = log
        self._unwatched = unwatched
        self.rules = load_rules(file)
        self._seen = self._versions()
        self.rules = load_rules(file)  # again: it may have changed in between
        self._addresses: dict[tuple[str, int], _Address] = {}
        self._problem = self._mistakes = ''
        self._left_out = self._unwatched_before = 0
        self._looked_at = self._steady()
        self._listened = 0.0
        self._heard: dict[str, float] = {}
        """For how long was listened until each robot was heard the last time, s."""
        # The time only grows, also when the clock of the computer is set.
        self._ahead = time.time() - self._steady()
        store.memory.resume(time.time())
        if store.set_aside:
            log.error(f'{store.file} was damaged, and is kept as {store.set_aside}; people may be called again')

    def run(self, until: Callable[[], bool] = lambda: False) -> None:
        """Work until interrupted, or ``until`` is true."""
        next_look = 0.0
        while not until():
            now = self._steady()
            if now >= next_look:
                next_look = now + PERIOD
                self._reload()
                self._decide()
            self._send()
            time.sleep(min(SENDING_PERIOD if self._sending else PERIOD, max(0.0, next_look - self._steady())))

    def _decide(self) -> None:
        memory = self._store.memory
        acknowledged = {}
        with suppress(sqlite3.Error):
            acknowledged = self._store.read('acknowledgment')
        for number in memory.acknowledge(acknowledged):
            self._log.info(f'{acknowledged[number]} has acknowledged {number}: {memory.things[number].robot}')
        memory.step(self._steady() + self._ahead, self._local(), self._robots(), self.rules)
        if memory.left_out and not self._left_out:
            self._log.error(f'{memory.left_out} needs of robots are too many to call about: acknowledge some')
        self._left_out = memory.left_out
        unwatched = self._unwatched()
        if unwatched > self._unwatched_before:
            told = f'{pluralize(unwatched, "more robot was", "more robots were")} found'
            self._log.error(f'{told}, and nobody is called about them: list all robots in "robots"')
        self._unwatched_before = unwatched
        for call in list(memory.calls.values()):
            if call.address >= len(self.rules.addresses.get(call.contact, ())):
                self._log.warning(f'{call.contact} has no such address any more; not sent: {call.title}')
                del memory.calls[call.id]
        self._save(acknowledged)

    def _robots(self) -> list[SeenRobot]:
        """Return the robots, with a mark at those that could not be heard, since computer or process stood still."""
        before, self._looked_at = self._looked_at, self._steady()
        self._listened += min(self._looked_at - before, 2.0 * PERIOD)
        robots = self._look()
        self._heard = {one.name: self._listened if one.is_live else self._heard.get(one.name, 0.0) for one in robots}

        def is_unheard(robot: SeenRobot) -> bool:
            listened = self._listened - self._heard[robot.name]
            silent = [need.seconds for need in robot.needs if need.condition is Urgency.UNREACHABLE]
            return listened < HEAR_SECONDS and max(silent, default=0.0) > listened + STILL_SECONDS

        return [one._replace(is_unheard=is_unheard(one)) for one in robots]

    def _save(self, acknowledged: Iterable[int] = ()) -> None:
        problem = self._store.save(acknowledged)
        if problem and problem != self._problem:
            self._log.error(f'{self._store.file}: {problem}; calls go on, but a restart may repeat them')
        elif self._problem and not problem:
            self._log.info(f'{self._store.file} is written again')
        self._problem = problem

    def _send(self) -> None:
        for (contact, number), at in self._addresses.items():
            if at.answer is not None and at.answer.done():
                self._note(contact, number, at, at.answer.result())
        waiting: dict[tuple[str, int], list[Call]] = {}
        local = self._local()
        for call in self._store.memory.calls.values():
            if not self.rules.is_held(Severity(call.severity), local):
                waiting.setdefault((call.contact, call.address), []).append(call)
        for key, batch in waiting.items():
            at = self._addresses.setdefault(key, _Address(TokenBucket(1.0 / BUNDLE_SECONDS, BURST, self._steady)))
            is_due = at.answer is None and self._steady() >= at.next_try and at.bucket.left >= 1.0
            if is_due and self._sending < MOST_SENDERS:
                self._begin(key, at, batch)

    @property
    def _sending(self) -> int:
        return sum(one.answer is not None for one in self._addresses.values())

    def _begin(self, key: tuple[str, int], at: _Address, batch: list[Call]) -> None:
        title, body, kind = message_of(batch)
        at.batch, at.doubtful = batch, {call.id for call in batch if call.is_begun}
        for call in batch:
            call.is_begun = True
        at.bucket.take(1.0)
        self._save()  # a program that is killed from now on knows that it may have been sent
        task = {
            'address': self.rules.addresses[key[0]][key[1]],
            'title': title,
            'body': body,
            'type': kind,
            'state': str(self._store.file.absolute()),
            'calls': [call.id for call in batch],
        }
        answer = at.answer = Future()
        try:
            threading.Thread(target=lambda: answer.set_result(_done(task, self._store.lock)), daemon=True).start()
        except RuntimeError:
            answer.set_result({'reason': 'no thread could be started', 'is_certain': True})

    def _note(self, contact: str, number: int, at: _Address, answer: Mapping[str, Any]) -> None:
        """Note how an attempt has ended."""
        batch, at.batch, at.answer = at.batch, [], None
        memory, failure = self._store.memory, answer.get('reason')
        left: Collection[int] = () if failure is None else {call.id for call in batch}
        if left and not self._problem:  # a process that was killed may have delivered
            with suppress(sqlite3.Error):
                left = self._store.read('call')
        for call in batch:
            if call.id not in left:
                memory.calls.pop(call.id, None)
            call.is_begun = call.id in at.doubtful or not answer.get('is_certain', False)
        self._save()
        if all(call.id not in left for call in batch):
            at.failures, at.next_try = 0, 0.0
            self._log.info(f'{contact} was called: {message_of(batch)[0]}')
            return
        pause = min(FIRST_PAUSE * 2.0 ** min(at.failures, 20), LONGEST_PAUSE) * random.uniform(0.8, 1.2)
        at.failures += 1
        at.next_try = self._steady() + pause
        at.bucket.take(-1.0)
        which = f'address {number + 1} of {contact}'
        self._log.warning(f'{which} was not reached: {failure}; attempt {at.failures}, the next in {pause:.0f} s')

    def _reload(self) -> None:
        if (changed := self._versions()) == self._seen and not self._mistakes:
            return
        self._seen = changed
        try:
            fresh = load_rules(self._file)
        except UsageError as error:  # what mends it may be in a file that only the changed rules name
            before, self._mistakes = self._mistakes, str(error)
            if self._mistakes != before:
                self._log.error(f'the changed rules cannot be used, those before count:\n{error}')
            return
        self._mistakes = ''
        if fresh.robots != self.rules.robots:
            self._log.warning('"robots" has changed: start "console alerts" again to watch other robots')
        self.rules = fresh
        self._log.info(f'{self._file} was read again: {pluralize(len(fresh.rules), "rule")}')

    def _versions(self) -> list[tuple[int, ...]]:
        return [version_of(file) for file in self.rules.files]

    def _steady(self) -> float:
        return time.monotonic() + seconds_asleep()

    def _local(self) -> datetime:
        return datetime.now(self.rules.zone).astimezone(self.rules.zone)


def message_of(batch: Sequence[Call]) -> tuple[str, str, str]:
    """Return title, body and type of a message about one thing or several, the most severe first."""
    calls = sorted(batch, key=lambda call: (call.is_over, -call.severity, call.id))
    worst = max((call.severity for call in calls if not call.is_over), default=None)
    type = 'success' if worst is None else _TYPES[Severity(worst)]
    again = ['This may be a repetition: an attempt to send it has not ended well.'] * any(one.is_begun for one in calls)
    title, lines = calls[0].title, calls[0].lines
    if len(calls) > 1:
        title = f'{len(calls)} things: {title}, ...'
        listed = [[f'- {call.title}', *(f'  {line}' for line in call.lines)] for call in calls[:MOST_LISTED]]
        lines = [*chain(*listed), *[f'and {len(calls) - MOST_LISTED} more'] * (len(calls) > MOST_LISTED)]
    return title, '\n'.join([*again, *lines])[:LONGEST_BODY], type


def check_lines(rules: AlertRules, robots: Sequence[SeenRobot]) -> list[str]:
    """Return the rules in words, the services of the contacts, and what would go out about the robots that are there.

    Raises:
        UsageError: apprise does not know an address.
    """
    lines = [f'line {rule.line}: {rule_text(rule)}' for rule in rules.rules]
    names = iter(_services([*chain(*rules.addresses.values())]))
    for contact, addresses in rules.addresses.items():
        services = [next(names) for _ in addresses]
        if '' in services:
            raise UsageError(
                f'{contact}: apprise does not know address {services.index("") + 1}; see its documentation'
            )
        lines.append(f'{contact}: {", ".join(services)}')
    for robot in robots:
        for need in robot.needs:
            rule = rules.rule_of(robot.name, need.condition)
            whom = f'call {", ".join(rule.steps[0].contacts)} (line {rule.line})' if rule else 'no rule: nobody'
            lines.append(f'now {one_line(robot.name)}: {need.text}: {whom}')
    if not any(robot.needs for robot in robots):
        lines.append('now nothing would go out' if robots else 'no robot was heard: now nothing would go out')
    return lines


def send_test(rules: AlertRules, contact: str) -> str:
    """Send a message to each address of a contact. Return how that went.

    Raises:
        ConsoleError: an address was not reached.
    """
    if not rules.addresses.get(contact):
        raise UsageError(f'no rule calls a contact of this name; there are {", ".join(rules.addresses) or "none"}')
    text = {'title': 'FlexBT: a test', 'body': f'This reaches {contact}.', 'type': 'info', 'state': '', 'calls': []}
    addresses = rules.addresses[contact]
    reasons = [_done({**text, 'address': address}).get('reason') for address in addresses]
    parts = zip(_services(addresses), reasons, strict=True)
    told = '\n'.join(f'{service or "unknown to apprise"}: {reason or "sent"}' for service, reason in parts)
    if any(reasons):
        raise ConsoleError(told)
    return told


def _services(addresses: Sequence[str]) -> list[str]:
    """Return the names of the services of addresses, '' for an address that apprise does not know."""
    found = _done({'addresses': [*addresses]}).get('services')
    return found if isinstance(found, list) else [''] * len(addresses)

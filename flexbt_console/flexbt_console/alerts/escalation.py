# SPDX-License-Identifier: BSD-3-Clause
"""Who has to be called now: pure rules over what is known of the robots, with their memory as plain data."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Final, NamedTuple
from urllib.parse import quote

from flexbt_console.mirror.fleet import RobotOverview, Urgency, needs_of
from flexbt_console.mirror.records import Decision
from flexbt_console.present.rendering import choice_line, need_text
from flexbt_core.values.text import one_line

from .rules import CONDITIONS, AlertRules, Rule, condition_name

MOST_THINGS: Final = 1000
"""Maximum number of things that are remembered."""

MOST_UNSAID: Final = 1000
"""Number of undelivered calls from which on the oldest of those whose thing is over are dropped."""

MOST_OF_ROBOT: Final = 100
"""Maximum number of needs of one robot that are looked at."""

TITLE_LENGTH: Final = 150
TEXT_LENGTH: Final = 500
"""Maximum characters of the title of a message, and of one of its lines."""

FIND_SECONDS: Final = 120.0
"""Time after the start in which robots are found that were heard before, s. Then they count as silent."""

REMEMBERED_ROBOTS: Final = 100
REMEMBERED_SECONDS: Final = 30 * 86_400.0
"""Number of robots that are remembered, and for how long after they were heard, s."""

INCIDENT_SECONDS: Final = 2 * 86_400.0
MOST_INCIDENTS: Final = 15
"""Time for which an incident is remembered, s, and how many of a robot: its black box reports the newest of a day, also
after a restart."""

LONGEST: Final = 1e8
"""Longest time for which a need is believed to have lasted, s: three years."""

_WORDS: Final = {
    Urgency.ALARM: 'moves though it should stand',
    Urgency.DECISION: 'waits for a decision',
    Urgency.FAILED: 'has failed',
    Urgency.UNREACHABLE: 'is silent',
    Urgency.DEGRADED: 'has a fault',
    Urgency.INCIDENT: 'has an incident',
}
_REMEDIES: Final = {
    Urgency.ALARM: 'Stop it again; if it does not stand then, use its emergency stop.',
    Urgency.DECISION: 'Answer on the page, or with "console confirm", "force" or "input".',
    Urgency.FAILED: 'Read "console log", mend the cause, then start or resume a run.',
    Urgency.UNREACHABLE: 'Check its power, its network and its onboard executive ("flexbt doctor").',
    Urgency.DEGRADED: 'See "console status" and "flexbt doctor".',
    Urgency.INCIDENT: 'Read it on the robot: "console incidents NAME", or its folder.',
}


class SeenNeed(NamedTuple):
    """A need that may be called about: what it is, for how many seconds already, and its texts."""

    condition: Urgency
    key: str
    seconds: float
    text: str
    choices: str = ''
    decision: str = ''


class SeenRobot(NamedTuple):
    """A robot with its needs. If it is not live, needs that are missing here may still be there. If it ``is_unheard``,
    it could not be heard for a while, and nobody is called about it yet."""

    name: str
    is_live: bool
    needs: tuple[SeenNeed, ...]
    is_unheard: bool = False


def seen(robot: RobotOverview) -> SeenRobot:
    """Return the needs of a robot that rules may be about, in the words of the list of robots."""
    view, needs = robot.view, []
    for need in needs_of(view)[:MOST_OF_ROBOT]:
        if condition_name(need.urgency) and not (need.urgency is Urgency.UNREACHABLE and view.listening):
            about = need.about if isinstance(need.about, Decision) else None
            text = one_line(need_text(need, view), TEXT_LENGTH)
            choices = one_line(choice_line(about), TEXT_LENGTH) if about is not None else ''
            decision = about.id[:TEXT_LENGTH] if about is not None else ''
            needs.append(SeenNeed(need.urgency, need.key, need.seconds, text, choices, decision))
    return SeenRobot(robot.name, view.live, tuple(needs))


@dataclass
class Thing:
    """One need of a robot, from when it is seen until it is over.

    ``since`` and ``called`` (the last call) are in s since 1970. ``step`` calls of its rule were made, to ``told``.
    ``acknowledged``: by whom.
    """

    id: int
    robot: str
    condition: str
    key: str
    since: float
    text: str
    choices: str
    decision: str
    step: int = 0
    called: float = 0.0
    told: list[str] = field(default_factory=list)
    acknowledged: str = ''


@dataclass
class Call:
    """A message that one address of a contact has to get. ``is_begun``: it may have been sent before a restart."""

    id: int
    contact: str
    address: int
    thing: int
    severity: int
    title: str
    lines: list[str]
    is_over: bool = False
    is_begun: bool = False


@dataclass
class Escalation:
    """The things that are there, and the calls that were decided and are not delivered yet, by identifier."""

    things: dict[int, Thing] = field(default_factory=dict)
    calls: dict[int, Call] = field(default_factory=dict)
    last_id: int = 0
    heard: dict[str, float] = field(default_factory=dict)
    """The robots, and in which hour they were last heard, in s."""
    started: float = math.inf
    left_out: int = 0
    """Needs for which there was no room in the last step."""

    def resume(self, now: float) -> None:
        """Continue after a restart. Times in the future, because the clock was set back, count as now."""
        for thing in self.things.values():
            thing.since, thing.called = min(thing.since, now), min(thing.called, now)

    def step(self, now: float, local: datetime, robots: Sequence[SeenRobot], rules: AlertRules) -> None:
        """Decide the calls at ``now``, s, which only grows; quiet hours are by the ``local`` time of the day."""
        known = {(thing.robot, thing.condition, thing.key): thing for thing in self.things.values()}
        self.left_out = 0
        missing = [one for one in self._missing(now, robots) if not rules.robots or one.name in rules.robots]
        robots = [*robots, *missing]
        needs: dict[int, SeenNeed] = {}
        for robot in robots:
            there = set()
            for need in robot.needs:
                name = condition_name(need.condition)
                key = robot.name, name, hashlib.sha256(need.key.encode(errors='replace')).hexdigest()[:32]
                if rules.rule_of(robot.name, need.condition) is None:
                    continue
                if key not in known:
                    if not self._has_room({one.name for one in robots}):
                        self.left_out += 1
                        continue
                    seconds = need.seconds if math.isfinite(need.seconds) else 0.0
                    since = now - min(max(seconds, 0.0), LONGEST)
                    known[key] = Thing(self._new_id(), *key, since, need.text, need.choices, need.decision)
                    self.things[known[key].id] = known[key]
                there.add(key)
                needs[known[key].id] = need
            incidents = [key for key, thing in known.items() if thing.robot == robot.name and _is_incident(thing)]
            kept = set(sorted(incidents, key=lambda key: known[key].since)[-MOST_INCIDENTS:])
            for key, thing in list(known.items()):
                lasts = INCIDENT_SECONDS if key in kept else 0.0
                is_gone = robot.is_live and thing.robot == robot.name and key not in there
                if is_gone and now >= thing.since + lasts:
                    self._end(known.pop(key), local, rules)
        unheard = {robot.name for robot in robots if robot.is_unheard}
        for thing in [one for one in self.things.values() if one.robot not in unheard]:
            self._call(thing, now, local, needs.get(thing.id), rules)

    def acknowledge(self, by: Mapping[int, str]) -> list[int]:
        """Note who has acknowledged which things. Return those that are new."""
        new = [number for number in by if number in self.things and not self.things[number].acknowledged]
        for number in new:
            self.things[number].acknowledged = by[number]
        return new

    def _missing(self, now: float, robots: Sequence[SeenRobot]) -> list[SeenRobot]:
        """Return the robots that were heard before, perhaps before a restart, and are not found any more."""
        self.started = min(self.started, now)
        present = {robot.name: robot.is_live for robot in robots}
        live = {name: now // 3600.0 * 3600.0 for name, is_live in present.items() if is_live}
        if any(self.heard.get(name) != hour for name, hour in live.items()):
            latest = sorted({**self.heard, **live}.items(), key=lambda one: one[1])[-REMEMBERED_ROBOTS:]
            self.heard = {name: hour for name, hour in latest if now - hour < REMEMBERED_SECONDS}
        if now - self.started < FIND_SECONDS:
            return []
        need = SeenNeed(Urgency.UNREACHABLE, '', 0.0, 'unreachable: not found')
        return [SeenRobot(name, False, (need,)) for name in self.heard if name not in present]

    def _has_room(self, present: Iterable[str]) -> bool:
        """Return whether one more thing may be remembered; forget one of a robot that is not there any more for it."""
        if len(self.things) < MOST_THINGS:
            return True
        gone = next((thing for thing in self.things.values() if thing.robot not in present), None)
        return gone is not None and self.things.pop(gone.id) is gone

    def _call(self, thing: Thing, now: float, local: datetime, need: SeenNeed | None, rules: AlertRules) -> None:
        rule = rules.rule_of(thing.robot, _condition(thing))
        if rule is None or thing.acknowledged or rules.is_held(rule.severity, local):
            return
        while thing.step < len(rule.steps):
            step = rule.steps[thing.step]
            if now < (thing.called if thing.step else thing.since) + step.after:
                return
            if need is not None:
                thing.text, thing.choices = need.text, need.choices
            thing.called, thing.step = now, thing.step + 1
            thing.told = list(dict.fromkeys([*thing.told, *step.contacts]))
            self._queue(thing, step.contacts, rules, rule, *_message(thing, now, local, rules))

    def _end(self, thing: Thing, local: datetime, rules: AlertRules) -> None:
        del self.things[thing.id]
        at = f'{local:%H:%M}'
        unsaid = [call for call in self.calls.values() if call.thing == thing.id]
        for call in unsaid:  # an attempt that has begun may fail, and be repeated hours later
            call.title = f'{call.title} (over since {at})'
        rule = rules.rule_of(thing.robot, _condition(thing))
        if rule is not None and rule.over and not _is_incident(thing):
            untold = {(call.contact, call.address) for call in unsaid if not call.is_begun}
            title = f'{_title(thing)}: over since {at}'
            self._queue(thing, thing.told, rules, rule, title, [thing.text], untold)
        over = sorted(number for number, call in self.calls.items() if call.thing not in self.things)
        for number in over[: max(0, len(self.calls) - MOST_UNSAID)]:
            del self.calls[number]

    def _queue(
        self,
        thing: Thing,
        contacts: Iterable[str],
        rules: AlertRules,
        rule: Rule,
        title: str,
        lines: list[str],
        untold: Container[tuple[str, int]] = (),
    ) -> None:
        for contact in contacts:
            for address in range(len(rules.addresses.get(contact, ()))):
                if (contact, address) not in untold:
                    number, is_over = self._new_id(), thing.id not in self.things
                    self.calls[number] = Call(number, contact, address, thing.id, rule.severity, title, lines, is_over)

    def _new_id(self) -> int:
        self.last_id += 1
        return self.last_id


def _condition(thing: Thing) -> Urgency:
    return CONDITIONS[thing.condition]


def _is_incident(thing: Thing) -> bool:
    """Return whether it is about what has happened, and is neither there nor over."""
    return _condition(thing) is Urgency.INCIDENT


def _title(thing: Thing) -> str:
    return f'{one_line(thing.robot, TITLE_LENGTH // 2)} {_WORDS[_condition(thing)]}'


def _message(thing: Thing, now: float, local: datetime, rules: AlertRules) -> tuple[str, list[str]]:
    """Return the title, and what, since when, what to do, where, and how to acknowledge."""
    since = datetime.fromtimestamp(local.timestamp() - (now - thing.since), local.tzinfo)
    link = f'{rules.page}/?robot={quote(thing.robot, safe="/")}' if rules.page else ''
    if link and thing.decision:
        link += f'&decision={quote(thing.decision, safe="", errors="replace")}'
    lines = [
        thing.text,
        f'Choices: {thing.choices}' if thing.choices else '',
        f'Since {since:%Y-%m-%d %H:%M %Z}'.rstrip(),
        _REMEDIES[_condition(thing)],
        link,
        f'To acknowledge, enter on the page: alerts acknowledge {thing.id}'
        if link
        else f'To acknowledge: console alerts acknowledge {thing.id}',
    ]
    return _title(thing), [line for line in lines if line]

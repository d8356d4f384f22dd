# SPDX-License-Identifier: BSD-3-Clause
"""The interactive prompt: what a line means, which decision it answers, and what is drawn."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import io
import re
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from typing import Any

import pytest
from prompt_toolkit.application import create_app_session
from prompt_toolkit.input import PipeInput, create_pipe_input
from prompt_toolkit.output import DummyOutput
from prompt_toolkit.output.plain_text import PlainTextOutput

from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.commands.completion import candidates
from flexbt_console.errors import RefusedError, UsageError
from flexbt_console.link.robot_link import RobotLink
from flexbt_console.mirror.command_tracker import CommandState, TrackedCommand
from flexbt_console.mirror.freshness import LinkState
from flexbt_console.mirror.mirror import Mirror, Transit
from flexbt_console.mirror.records import (
    ActiveState,
    Behavior,
    BehaviorParameter,
    CommandKind,
    CommandResult,
    Decision,
    DecisionKind,
    ExecutiveSnapshot,
    ExecutiveState,
    FramedPose,
    InputValue,
    LogLine,
    LogSeverity,
    OperatorCommand,
    ResultCode,
    UserdataScope,
)
from flexbt_console.mirror.view import View
from flexbt_console.ui.answers import Bound, Local, ShownDecision, interpret
from flexbt_console.ui.line.prompt import Prompt
from flexbt_console.ui.line.raw_input import MOST_TYPED, Typed
from flexbt_console.ui.line.toolbar import toolbar
from flexbt_console.ui.station import Attention, Station
from flexbt_core.clock.clock import Clock, ManualClock
from flexbt_testing.waiting import DEADLINE

TRANSITION = Decision('t1', DecisionKind.TRANSITION, '/Plan', 'done', ('done', 'canceled', 'failed'), 2)
ANOTHER = dataclasses.replace(TRANSITION, id='t2', path='/Other')
INPUT = Decision('i1', DecisionKind.INPUT, '/Ask', input_type='geometry_msgs/msg/PoseStamped', prompt='Where to?')
TEXT = Decision('i2', DecisionKind.INPUT, '/Ask', input_type='string')
NUMBERS = Decision('i3', DecisionKind.INPUT, '/Ask', input_type='int32', input_choices=('20', '10', '1'))
PLACES = {'kitchen': FramedPose(1.0, 2.0)}
MAKE = CommandBuilder('ann')


def station(mirror: Mirror, link: Any, clock: Clock) -> Station:
    return Station(mirror, link, MAKE, 5.0, Attention(clock), 'the robot continues')


def view(*decisions: Decision, link: LinkState = LinkState.LIVE) -> View:
    active = (ActiveState(decisions[0].path if decisions else '/Drive', 0.0, ('FollowPath', 'RateController')),)
    snapshot = ExecutiveSnapshot(
        'e',
        1,
        state=ExecutiveState.RUNNING,
        run_id='r1',
        behavior='Patrol',
        autonomy=2,
        active_states=active,
        decisions=decisions,
        robot_pose=FramedPose(1.0, 2.0, 0.5),
    )
    return View(link, 0.4, '', snapshot, places=PLACES)


def command(text: str, now: View, bound: str | None) -> OperatorCommand:
    meaning = interpret(text, now, MAKE, Bound(bound))
    assert meaning.command is not None
    return meaning.command


@pytest.mark.parametrize('text', ['1', 'done', 'confirm', 'confirm t1'])
def test_confirming(text: str) -> None:
    sent = command(text, view(TRANSITION), 't1')
    assert (sent.kind, sent.decision_id, sent.run_id) == (CommandKind.CONFIRM, 't1', 'r1')


@pytest.mark.parametrize('text', ['3', 'failed', 'force failed'])
def test_forcing(text: str) -> None:
    sent = command(text, view(TRANSITION), 't1')
    assert (sent.kind, sent.decision_id, sent.outcome) == (CommandKind.FORCE, 't1', 'failed')


@pytest.mark.parametrize('text', ['kitchen', '1 2 0', 'input kitchen', 'input i1 kitchen', '1.0 2.0'])
def test_answering(text: str) -> None:
    sent = command(text, view(INPUT), 'i1')
    assert (sent.kind, sent.decision_id) == (CommandKind.ANSWER, 'i1')
    assert '"x": 1.0, "y": 2.0' in sent.inputs[0].text


def test_a_number_picks_a_choice_and_asks_where_it_is_another_one_itself() -> None:
    assert command('10', view(NUMBERS), 'i3').inputs[0].text == '10'
    with pytest.raises(RefusedError, match="1 is an answer, and the number of '20'; write: input 1"):
        command('1', view(NUMBERS), 'i3')
    assert command('input 1', view(NUMBERS), 'i3').inputs[0].text == '1'
    assert command('2', view(NUMBERS), 'i3').inputs[0].text == '10'
    for none in ('4', '0', '01', '002'):
        with pytest.raises(RefusedError, match='1 to 3'):
            command(none, view(NUMBERS), 'i3')


def test_a_name_that_is_a_command_and_another_answer_is_refused() -> None:
    choice = Decision('c1', DecisionKind.CHOICE, '/Ask', 'reject', ('confirm', 'reject'))
    request = Decision('i4', DecisionKind.INPUT, '/Ask', input_type='string', input_choices=('accept', 'decline'))
    for decision, name, verb in ((choice, 'confirm', 'force'), (request, 'decline', 'input')):
        known, told = view(decision), f"'{name}' is an answer, and a command; write: {verb} {name}, or {name} "
        with pytest.raises(RefusedError, match=f'{told}{decision.id}$'):
            command(name, known, decision.id)
        answers = (f'{verb} {name}', f'{name} {decision.id}', f'{decision.choices.index(name) + 1}')
        force, alone, number = (command(text, known, decision.id) for text in answers)
        assert (force.kind, force.outcome, force.inputs) == (number.kind, number.outcome, number.inputs)
        assert alone.kind.name.lower() == name and alone.decision_id == decision.id
    wanted = dataclasses.replace(choice, outcome='confirm')
    assert command('confirm', view(wanted), 'c1').kind is CommandKind.CONFIRM


def test_a_mistyped_command_is_not_the_answer_to_a_request_for_text() -> None:
    with pytest.raises(RefusedError, match='input'):
        command('stpo', view(TEXT), 'i2')
    assert command('input stpo', view(TEXT), 'i2').inputs[0].text == '"stpo"'
    assert command('stop', view(TEXT), 'i2').kind is CommandKind.STOP


@pytest.mark.parametrize('text', ['1', 'done', 'confirm', 'force failed', 'failed'])
@pytest.mark.parametrize('bound', ['t1', None])
def test_an_answer_never_reaches_another_decision(text: str, bound: str | None) -> None:
    with pytest.raises(RefusedError, match='changed while you were typing'):
        command(text, view(ANOTHER), bound)


@pytest.mark.parametrize('text', ['kitchen', 'input kitchen', 'decline', '1 2 0'])
def test_a_value_never_reaches_another_decision(text: str) -> None:
    with pytest.raises(RefusedError, match='changed while you were typing'):
        command(text, view(INPUT), 'i0')


def test_the_decision_that_was_shown_is_answered_also_when_it_is_not_the_first_any_more() -> None:
    assert command('done', view(ANOTHER, TRANSITION), 't1').decision_id == 't1'


def test_a_hasty_key_is_not_taken() -> None:
    with pytest.raises(RefusedError, match='appeared just as'):
        interpret('1', view(TRANSITION), MAKE, Bound('t1', hasty=True))
    assert interpret('stop', view(TRANSITION), MAKE, Bound('t1', hasty=True)).command is not None


@pytest.mark.parametrize('link', [LinkState.STALE, LinkState.LOST])
def test_without_a_live_link_only_stop_is_sent(link: LinkState) -> None:
    for text in ('1', 'confirm', 'autonomy 1', 'force done', 'start Patrol'):
        with pytest.raises(RefusedError, match='no live link'):
            command(text, view(TRANSITION, link=link), 't1')
    assert command('stop', view(TRANSITION, link=link), 't1').kind is CommandKind.STOP


@pytest.mark.parametrize(
    'text', ["the robot's arm isn't ok", 'a  "word" -x', '--sim or --ros-args', "isn't", 'C:\\ #1']
)
def test_a_note_is_what_was_typed(text: str) -> None:
    assert command(f' note  {text} ', view(), '').text == text


def test_local_lines() -> None:
    for text, local in (
        ('', Local.NOTHING), ('  ', Local.NOTHING), ('quit', Local.QUIT), ('exit', Local.QUIT),
        ('help', Local.HELP), ('?', Local.HELP), ('help force', Local.HELP), ('status', Local.READ),
        ('userdata / goal', Local.READ), ('note --help', Local.HELP), ('note --help ', Local.HELP),
    ):  # fmt: skip
        assert interpret(text, view(), MAKE, Bound(None)).local is local
    for text in ('stpo', 'help stpo'):
        with pytest.raises(UsageError, match="did you mean 'stop'"):
            interpret(text, view(), MAKE, Bound(None))
    with pytest.raises(UsageError, match='for the command line: console watch'):
        interpret('watch', view(INPUT), MAKE, Bound('i1'))
    for text in ('stop --wait', 'stop --ros-args -r __ns:=/a'):
        with pytest.raises(UsageError, match='not for the prompt'):
            interpret(text, view(), MAKE, Bound(None))
    with pytest.raises(RefusedError, match='no decision is pending'):
        interpret('1', view(), MAKE, Bound(None))


def test_the_decision_is_bound_at_the_first_key() -> None:
    clock = ManualClock()
    shown = ShownDecision(clock)
    shown.drawn('a')
    shown.typed('d')
    shown.drawn('b')
    shown.typed('do')
    assert shown.take() == Bound('a', False)
    # Emptied and begun again: bound to what is shown then.
    clock.advance(1.0)
    shown.typed('x')
    shown.typed('')
    shown.typed('y')
    assert shown.take() == Bound('b', False)
    # A key right after the decision was replaced by another.
    shown.drawn('c')
    clock.advance(0.3)
    shown.typed('1')
    assert shown.take() == Bound('c', True)
    clock.advance(0.2)
    shown.typed('1')
    assert shown.take() == Bound('c', False)
    # So is a key for one that comes up soon after there was none; after a quiet time it may be answered at once.
    for decision, quiet, is_hasty in (('d', 0.3, True), ('e', 0.5, False)):
        shown.drawn(None)
        clock.advance(quiet)
        shown.drawn(decision)
        shown.typed('1')
        assert shown.take() == Bound(decision, is_hasty)


def text_of(now: View, width: int = 80, height: int = 12) -> str:
    return '\n'.join(line for _, line in toolbar(now, width, height))


def test_the_toolbar_shows_state_nodes_pose_and_decision() -> None:
    text = text_of(view(TRANSITION))
    for part in ('LIVE 0.4 s', 'Patrol', '2 High', '> /Plan', 'FollowPath', 'x 1.00', '/Plan wants done', '1 done*'):
        assert part in text
    assert '(place or x y yaw): Where to?' in text_of(view(INPUT))
    assert 'NOT LIVE' in text_of(view(link=LinkState.STALE))
    assert 'STALE 0.4 s' in text_of(view(link=LinkState.STALE))
    assert text_of(View(LinkState.LOST, None)) == 'NO EXECUTIVE'


def test_the_decision_stays_in_a_small_terminal() -> None:
    small = text_of(view(TRANSITION), 40, 4)
    assert 'LIVE' in small and 'wants done' in small and 'FollowPath' not in small


def test_completion() -> None:
    complete = candidates
    assert complete('k', view(INPUT)) == ['kitchen']
    assert complete('f', view(TRANSITION)) == ['failed', 'force']
    assert complete('autonomy h', view()) == ['high']
    assert complete('force c', view(TRANSITION)) == ['canceled']
    assert complete('confirm ', view(TRANSITION)) == ['t1']
    assert complete('confirm --r', view(TRANSITION)) == ['--reason']
    assert complete('start D --autonomy h', view()) == ['high']
    assert complete('input ', view(INPUT)) == ['kitchen', 'i1']
    navigate = dataclasses.replace(
        view(), behaviors=(Behavior('Navigate'), Behavior('Navigate Split', parameters=(BehaviorParameter('speed'),)))
    )
    assert complete('start Nav', navigate) == ['Navigate', 'Navigate Split']
    assert complete('start Navigate S', navigate) == ['Split']
    assert complete('start Navigate Split s', navigate) == ['speed=']
    hostile = dataclasses.replace(TRANSITION, outcomes=('a\rstop', 'a\x1b'))
    assert complete('a', view(hostile)) == ['autonomy', 'abort', 'alerts acknowledge']


class Loopback(RobotLink):
    """Answers each command at once: the link and the executive in one."""

    def __init__(self, mirror: Mirror, answer: Callable[[OperatorCommand], ExecutiveSnapshot]) -> None:
        self.sent: list[OperatorCommand] = []
        self.reads: list[str] = []
        self._mirror = mirror
        self._answer = answer

    def send(self, command: OperatorCommand, timeout: float, label: str) -> TrackedCommand:
        tracked = self._mirror.give(command, timeout, label)
        if tracked.state is CommandState.REFUSED:
            return tracked
        self.sent.append(command)
        self._mirror.receive_snapshot(self._answer(command), Transit(0.0, 0.0))
        return tracked

    def userdata(self, path: str, keys: Sequence[str], timeout: float) -> tuple[UserdataScope, ...]:
        assert (path, tuple(keys)) == ('/', ('goal',))
        self.reads.append(path)
        return (UserdataScope('/', (InputValue('goal', 'string', '"kitchen"'),)),)


def test_a_session_at_the_keyboard(capsys: pytest.CaptureFixture[str]) -> None:
    clock = ManualClock()
    mirror = Mirror(clock, PLACES)
    sequence = 1

    def snapshot(*decisions: Decision, results: tuple[CommandResult, ...] = ()) -> ExecutiveSnapshot:
        shown = view(*decisions).snapshot
        assert shown is not None
        return dataclasses.replace(shown, sequence=sequence, results=results)

    def answer(command: OperatorCommand) -> ExecutiveSnapshot:
        nonlocal sequence
        sequence += 1
        result = CommandResult(command.id, ResultCode.APPLIED)
        return snapshot(*([TRANSITION] if command.kind is CommandKind.ANSWER else []), results=(result,))

    mirror.receive_snapshot(snapshot(INPUT), Transit(0.0, 0.0))
    link = Loopback(mirror, answer)

    async def operate() -> None:
        with create_pipe_input() as keys, create_app_session(input=keys, output=DummyOutput()):
            prompt = Prompt(station(mirror, link, clock), clock, input=keys, output=DummyOutput())
            running = asyncio.create_task(prompt.run())

            async def until(count: int) -> None:
                while len(link.sent) < count:
                    await asyncio.sleep(0.01)

            await asyncio.sleep(0)
            while prompt.shown_decision is None:
                await asyncio.sleep(0.01)
            keys.send_text('kitchen\r')
            await until(1)
            while prompt.shown_decision != 't1':
                await asyncio.sleep(0.01)
            keys.send_text('done\r')  # too soon after the decision took the place of the other
            keys.send_text('userdata / goal\r')
            while not link.reads:
                await asyncio.sleep(0.01)
            assert len(link.sent) == 1
            clock.advance(1.0)
            keys.send_text('done\r')
            await until(2)
            keys.send_text('stop\r')
            await until(3)
            keys.send_text('\x03\x04')
            await running

    asyncio.run(asyncio.wait_for(operate(), DEADLINE))
    assert [entry.kind for entry in link.sent] == [CommandKind.ANSWER, CommandKind.CONFIRM, CommandKind.STOP]
    assert [entry.decision_id for entry in link.sent] == ['i1', 't1', '']
    waits = [(entry.wait_queue, entry.wait_interaction) for entry in link.sent]
    assert [min(pair) >= 0.0 for pair in waits] == [True, True, False]  # measured where there was something to answer


@pytest.mark.parametrize('piece', [1, 7, 1024])
def test_of_what_is_typed_or_pasted_no_more_is_parsed_than_a_line_has_room_for(piece: int) -> None:
    def paste(count: int) -> str:
        return '\x1b[200~' + 'l\n' * (count // 2) + '\x1b[201~'

    refused: list[int] = []
    typed = Typed(refused.append)
    flood = 'x' * (3 * MOST_TYPED)
    keys = '\x1b[1;5C', '\x1bOA', '\x1b[[A', '\x1bb', paste(2)  # behind each there is room for a line
    line, cut = flood[: MOST_TYPED + 2], flood[: MOST_TYPED + 1]
    sent = f'a{paste(MOST_TYPED)}\r{paste(100_000)}stop\r{flood}\r{flood}\x15ok\r' + line.join(['', *keys, ''])
    taken = ''.join(typed.take(sent[place : place + piece]) for place in range(0, len(sent), piece))
    if piece == 1024:  # what comes at once is one paste, as far as there is room
        assert taken.count('\x1b[200~') == taken.count('\x1b[201~') > 3 + 12
        taken = re.sub('\x1b\\[200~(x+)\x1b\\[201~', r'\1', taken)
    assert taken == f'a{paste(MOST_TYPED)}\r{paste(0)}stop\r{cut}\r{cut}\x15ok\r' + cut.join(['', *keys, ''])
    assert refused == [100_000]


@contextlib.asynccontextmanager
async def running_prompt(
    mirror: Mirror, link: Loopback, clock: ManualClock, screen: io.StringIO
) -> AsyncIterator[tuple[PipeInput, Callable[[str], Awaitable[None]]]]:
    """Run a prompt, and quit it at the end. Yield its keys, and a function that waits for a text on the screen."""
    output = PlainTextOutput(screen)
    with create_pipe_input() as keys, create_app_session(input=keys, output=output):
        prompt = Prompt(station(mirror, link, clock), clock, input=keys, output=output)
        running = asyncio.create_task(prompt.run())

        async def until(text: str) -> None:
            while text not in screen.getvalue():
                await asyncio.sleep(0.01)

        yield keys, until
        keys.send_text('quit\r')
        await running


@pytest.mark.parametrize('is_asleep', [False, True])
def test_a_line_that_waited_while_the_process_or_the_computer_stood_still_is_too_late(is_asleep: bool) -> None:
    clock, asleep = ManualClock(), [0.0]
    mirror = Mirror(clock, seconds_asleep=lambda: asleep[0])
    link = Loopback(mirror, lambda command: ExecutiveSnapshot('e', 2))
    screen = io.StringIO()

    async def operate() -> None:
        async with running_prompt(mirror, link, clock, screen) as (keys, until):
            keys.send_text('autonomy high\r')
            await until('autonomy high: waiting')
            if is_asleep:
                asleep[0] = 3600.0
            else:
                clock.advance(3600.0)
            mirror.receive_snapshot(ExecutiveSnapshot('e', 1), Transit(0.0, 0.0))  # before the prompt has its turn
            await until('autonomy high: there was no live link within 5 s; nothing was sent')
        assert link.sent == []

    asyncio.run(asyncio.wait_for(operate(), DEADLINE))


def test_a_fault_in_a_command_is_shown_and_the_prompt_goes_on() -> None:
    clock, screen = ManualClock(), io.StringIO()
    mirror = Mirror(clock)
    mirror.receive_snapshot(ExecutiveSnapshot('e', 1), Transit(0.0, 0.0))

    def fail(command: OperatorCommand) -> ExecutiveSnapshot:
        if command.kind is not CommandKind.STOP:
            raise OverflowError('injected')
        return ExecutiveSnapshot('e', 2, results=(CommandResult(command.id, ResultCode.APPLIED),))

    link = Loopback(mirror, fail)

    async def operate() -> None:
        async with running_prompt(mirror, link, clock, screen) as (keys, until):
            keys.send_text('autonomy high\r')
            await until('fault in the console, which continues:')
            keys.send_text('stop\r')
            await until('stop: applied')

    asyncio.run(asyncio.wait_for(operate(), DEADLINE))
    assert 'OverflowError: injected' in screen.getvalue()


def test_what_is_typed_before_the_link_is_up_waits_for_it_and_an_answer_comes_while_the_line_goes_on() -> None:
    clock = ManualClock()
    mirror = Mirror(clock)
    link = Loopback(
        mirror, lambda command: ExecutiveSnapshot('e', 2, results=(CommandResult(command.id, ResultCode.APPLIED),))
    )
    screen = io.StringIO()

    async def operate() -> None:
        async with running_prompt(mirror, link, clock, screen) as (keys, until):
            keys.send_text('autonomy high\r')
            await until('autonomy high: waiting for a live link, at most 5 s')
            clock.advance(5.0)
            await until('autonomy high: there was no live link within 5 s; nothing was sent')
            keys.send_text('autonomy low\r')
            await until('autonomy low: waiting')
            keys.send_text('\x03')
            await until('autonomy low: canceled')
            keys.send_text('autonomy full\r')
            await until('autonomy full: waiting')
            mirror.receive_snapshot(ExecutiveSnapshot('e', 1), Transit(0.0, 0.0))
            await until('autonomy full: applied')
            keys.send_text(f'\x1b[200~autonomy {"9" * 6000}\x1b[201~off\r')
            await until('was longer than 5000')
            screen.truncate(screen.seek(0))
            paste, erase = f'\x1b[200~{"9" * (MOST_TYPED - 9)}\x1b[201~', '\x7f' * 5
            keys.send_text(f'autonomy {paste}99{erase}\r')  # cut, and made short enough by hand
            await until('was longer than 5000')
            keys.send_text('\x1b[A\r')  # nor from the lines before
            while len(link.sent) < 2:
                await asyncio.sleep(0.01)
            keys.send_text('userdata / goal\r')
            await until('goal (string) = "kitchen"')

    asyncio.run(asyncio.wait_for(operate(), DEADLINE))
    assert [entry.autonomy for entry in link.sent] == [3, 3]


def test_a_stop_does_not_wait_until_a_long_log_is_printed() -> None:
    clock = ManualClock()
    mirror = Mirror(clock)
    typing, printed = list[PipeInput](), list[int]()

    class Terminal(io.StringIO):
        """Its user stops the robot when the first line is printed."""

        def write(self, text: str) -> int:
            if 'x' * 50 in text and typing:
                typing.pop().send_text('stop\r')
            return super().write(text)

    screen = Terminal()

    def answer(command: OperatorCommand) -> ExecutiveSnapshot:
        printed.append(screen.getvalue().count('x' * 50))
        return ExecutiveSnapshot('e', 2, results=(CommandResult(command.id, ResultCode.APPLIED),))

    link = Loopback(mirror, answer)

    async def operate() -> None:
        async with running_prompt(mirror, link, clock, screen) as (keys, until):
            mirror.receive_snapshot(ExecutiveSnapshot('e', 1), Transit(0.0, 0.0))
            await until('LIVE')
            typing.append(keys)
            for number in range(500):
                mirror.receive_log(LogLine('e', number, LogSeverity.INFO, 'x' * 2000))
            await until('stop: applied')

    asyncio.run(asyncio.wait_for(operate(), DEADLINE))
    assert printed[0] < 5000  # of more than 12,000 lines of the terminal


def test_what_waits_for_the_link_is_not_sent_after_a_stop() -> None:
    clock = ManualClock()
    mirror = Mirror(clock)
    link = Loopback(
        mirror, lambda command: ExecutiveSnapshot('e', 1, results=(CommandResult(command.id, ResultCode.APPLIED),))
    )
    screen = io.StringIO()

    async def operate() -> None:
        async with running_prompt(mirror, link, clock, screen) as (keys, until):
            for line, answer in (('autonomy high', 'autonomy high: waiting'), ('stop', 'stop: applied')):
                keys.send_text(f'{line}\r')
                await until(answer)
            await until('autonomy high: refused: a STOP was given while this waited; nothing was sent')

    asyncio.run(asyncio.wait_for(operate(), DEADLINE))
    assert [entry.kind for entry in link.sent] == [CommandKind.STOP]


@pytest.mark.parametrize('keys_to_quit', ['\x04', '\x03\x03\x04', 'half a line\x03quit\r', 'quit\r'])
def test_quitting_sends_nothing(keys_to_quit: str) -> None:
    mirror = Mirror(ManualClock())
    link = Loopback(mirror, lambda command: ExecutiveSnapshot('e', 1))

    async def operate() -> None:
        with create_pipe_input() as keys, create_app_session(input=keys, output=DummyOutput()):
            clock = ManualClock()
            prompt = Prompt(station(mirror, link, clock), clock, input=keys, output=DummyOutput())
            keys.send_text(keys_to_quit)
            await prompt.run()

    asyncio.run(asyncio.wait_for(operate(), DEADLINE))
    assert link.sent == []

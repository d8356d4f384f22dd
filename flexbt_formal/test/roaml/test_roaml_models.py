# SPDX-License-Identifier: BSD-3-Clause
"""Models in the format of AS2FM: small ones whose probabilities can be worked out by hand."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from flexbt_core.behavior_tree.model.errors import TreeLoadError
from flexbt_formal.roaml.checking import CheckLimits, Method, Result, check
from flexbt_formal.roaml.model import RoamlModel, is_model
from flexbt_formal.roaml.probabilities import BAD, GraphChoices, bounds_of, looks, reach
from flexbt_formal.roaml.probabilities import GOOD as MET
from flexbt_formal.roaml.rounds import Order
from flexbt_formal.roaml.source_text import ModelFault

HEAD = '<ascxml name="{}" version="1.0" initial="{}">{}</ascxml>'


def finally_(name: str | dict[str, Any], value: Any = True, extreme: str = 'Pmin') -> dict[str, Any]:
    """Return the formula that an atom will be equal to a value."""
    return {'op': extreme, 'exp': {'op': 'F', 'exp': {'op': '=', 'left': name, 'right': value}}}


def write(
    folder: Path,
    properties: dict[str, Any],
    *,
    nodes: dict[str, str] | None = None,
    plugins: dict[str, str] | None = None,
    tree: str = '',
    parameters: str = '',
    declarations: str = '',
) -> Path:
    """Return the files of a model. Of nodes and plugins: what <ascxml> has, after the name of the first state and
    '|'."""
    inputs: dict[str, list[str]] = {'behavior_tree': [], 'node_models': []}
    for section, kind, files in (
        ('node_models', 'node-ascxml', nodes or {}),
        ('behavior_tree', 'bt-plugin-ascxml', plugins or {}),
    ):
        for name, text in files.items():
            first, _, content = text.strip().partition('|')
            (folder / f'{name}.ascxml').write_text(HEAD.format(name, first, content))
            inputs[section].append(f'<input type="{kind}" src="./{name}.ascxml"/>')
    if tree:
        (folder / 'bt.xml').write_text(tree)
        inputs['behavior_tree'].append('<input type="bt.cpp-xml" src="bt.xml"/>')
    rows = [
        {'name': name, 'expression': one if one['op'] == 'filter' else _filter(one)} for name, one in properties.items()
    ]
    (folder / 'properties.jani').write_text(json.dumps({'properties': rows}))
    sections = ''.join(f'<{key}>{"".join(found)}</{key}>' for key, found in inputs.items() if found)
    main = folder / 'main.xml'
    main.write_text(
        f'<roaml><parameters><max_time value="10" unit="s"/>{parameters}</parameters>{declarations}{sections}'
        '<properties><input type="jani" src="properties.jani"/></properties></roaml>'
    )
    return main


def _filter(values: dict[str, Any]) -> dict[str, Any]:
    return {'op': 'filter', 'fun': 'values', 'values': values, 'states': {'op': 'initial'}}


def checked(main: Path, name: str = 'asked', **options: Any) -> Result:
    model = RoamlModel(str(main))
    (asked,) = (one for one in model.properties if one.name == name)
    return check(model, asked, **options)


COUNTER = """counting|
    <datamodel><data id="n" type="int16" expr="0"/></datamodel>
    <ros_topic_publisher name="out" topic="/count" type="std_msgs/Int16"/>
    <ros_time_rate name="clock" rate_hz="{rate}"/>
    <state id="counting"><ros_rate_callback name="clock" target="counting">
        <assign location="n" expr="n + 1"/>
        <ros_topic_publish name="out"><field name="data" expr="n"/></ros_topic_publish>
    </ros_rate_callback></state>"""
COUNT = 'topic_count_msg__ros_fields__data'


def test_a_timer_is_due_until_the_time_is_over(tmp_path: Path) -> None:
    properties = {
        'ten': finally_(COUNT, 10),
        'more': finally_(COUNT, 11),
        'as before 2025': finally_(COUNT.replace('__', '.', 1), 10),
        'always': {'op': 'Pmin', 'exp': {'op': 'G', 'exp': {'op': '<', 'left': COUNT, 'right': 10}}},
    }
    main = write(tmp_path, properties, nodes={'counter': COUNTER.format(rate=1)})
    assert [checked(main, name).value for name in properties] == [1.0, 0.0, 1.0, 0.0]
    assert 'counter sends topic_count_msg (data 10)' in checked(main, 'always').way[-2:]


@pytest.mark.parametrize(
    ('left', 'problem'),
    [
        ({'op': '/', 'left': 1, 'right': COUNT}, 'division by zero'),
        ({'op': 'log', 'exp': COUNT}, 'math domain error'),
        ({'op': '+', 'left': {'op': 'av', 'elements': [1]}, 'right': 1}, 'can only concatenate'),
    ],
)
def test_a_property_without_a_value_is_told(tmp_path: Path, left: dict[str, Any], problem: str) -> None:
    main = write(tmp_path, {'asked': finally_(left, 1)}, nodes={'counter': COUNTER.format(rate=1)})
    with pytest.raises(ModelFault, match=f'has no value: .*{problem}'):
        checked(main)


def test_until_counts_the_steps_of_its_bounds(tmp_path: Path) -> None:
    def until(**bounds: int) -> dict[str, Any]:
        right = {'op': '≥', 'left': COUNT, 'right': 2}
        return {'op': 'Pmin', 'exp': {'op': 'U', 'left': True, 'right': right, 'step-bounds': bounds}}

    # A round is: time, timer, sending. Nobody receives, so the second sending is step 6.
    properties = {'in 6': until(upper=6), 'in 5': until(upper=5), 'after 9': until(lower=9)}
    main = write(tmp_path, properties, nodes={'counter': COUNTER.format(rate=1)})
    assert [checked(main, name).value for name in properties] == [1.0, 0.0, 1.0]


def test_the_last_state_lasts_until_the_steps_of_a_bound(tmp_path: Path) -> None:
    bounds = {'lower': 1000, 'upper': 2000}
    wrong = {'op': '≥', 'left': COUNT, 'right': 10}
    never = {'op': 'Pmin', 'exp': {'op': 'G', 'exp': {'op': '¬', 'exp': wrong}, 'step-bounds': bounds}}
    result = checked(write(tmp_path, {'asked': never}, nodes={'counter': COUNTER.format(rate=1)}))
    assert (result.value, result.holds) == (0.0, False)


@pytest.mark.parametrize('is_least', [True, False])
@pytest.mark.parametrize('leaves', [1e-3, 1e-6, 1e-13])
def test_a_loop_that_is_rarely_left_is_left(leaves: float, is_least: bool) -> None:
    """And there is another way to stay in it, or none that is better."""
    other = [[(1.0, 2)]] if is_least else [[(1.0, 2)], [(0.5, 2), (0.5, BAD)]]
    graph: list[GraphChoices] = [[], [], [[(1.0 - leaves, 3), (leaves, MET)]], other]
    assert reach(graph, is_least) == ([0.0, 1.0, 1.0, 1.0], True)
    graph[3].append([(1.0, 3)])
    assert reach(graph, is_least=True) == ([0.0, 1.0, leaves, 0.0], True)


@pytest.mark.parametrize('order', list(Order))
def test_what_fails_however_rarely_does_not_hold(tmp_path: Path, order: Order) -> None:
    rare = DICE.replace('"0.25"', '"0.999"').replace('expr="3"', 'expr="5"')
    at_last = finally_('won__left', 1, extreme='Pmax')
    properties = {
        'won': finally_('won.valid'),
        'won, as a demand': {'op': '≥', 'left': finally_('won.valid'), 'right': 1},
        'never at last': {'op': '≤', 'left': at_last, 'right': 0},
        'rarely at last': {'op': '≤', 'left': at_last, 'right': 1e-6},
    }
    main = write(tmp_path, properties, nodes={'dice': rare})
    found = {name: checked(main, name, order=order) for name in properties}
    assert all(one.is_exact and min(one.value, 1.0 - one.value) < 1e-9 for one in found.values())
    assert [one.holds for one in found.values()] == [False, False, False, True]
    assert 'dice sends won (left 1)' in found['never at last'].way[-2]


@pytest.mark.parametrize('timer', ['', '<ros_time_rate name="clock" rate_hz="1"/>'], ids=['graph', 'rounds'])
@pytest.mark.parametrize(
    ('probability', 'sign', 'demanded', 'holds'),
    [
        ('0.000000002', '≤', 1.5e-9, False),
        ('0.000000002', '≤', 2e-9, True),
        ('0.999999998', '≥', 0.9999999985, False),
        ('0.999999998', '>', 0.9999999975, True),
        ('0.1 0.2', '>', 0.3, False),
        ('0.1 0.2', '≤', 0.3, True),
        ('0.000000002', '>', 0, True),
    ],
)
def test_a_demand_is_met_up_to_rounding(
    tmp_path: Path, probability: str, sign: str, demanded: float, holds: bool, timer: str
) -> None:
    sent = ''.join(f'<target id="end" prob="{one}"><send event="bad"/></target>' for one in probability.split())
    node = f'go|{timer}<state id="go"><transition>{sent}<target id="end"/></transition></state><state id="end"/>'
    asked = {'op': sign, 'left': finally_('bad.valid', extreme='Pmax'), 'right': demanded}
    assert checked(write(tmp_path, {'asked': asked}, nodes={'node': node})).holds is holds


@pytest.mark.parametrize('order', list(Order))
def test_what_goes_round_forever_however_rarely_does_not_hold(tmp_path: Path, order: Order) -> None:
    again = '{}|<state id="{}"><transition event="{}" target="{}"><send event="{}"/></transition></state>'
    begin = """go|<state id="go"><transition>
        <target id="end" prob="0.9999999999"><send event="done"/></target><target id="end"><send event="ping"/></target>
    </transition></state><state id="end"/>"""
    nodes = {'begin': begin, 'one': again.format('a', 'a', 'ping', 'a', 'pong')}
    nodes['other'] = again.format('b', 'b', 'pong', 'b', 'ping')
    result = checked(write(tmp_path, {'asked': finally_('done.valid')}, nodes=nodes), order=order)
    assert result.holds is False
    assert 'begin sends ping' in result.way
    assert 'goes round' in result.way[-1]


DICE = """throw|
    <datamodel><data id="left" type="int8" expr="3"/></datamodel>
    <state id="throw">
        <onentry><assign location="left" expr="left - 1"/></onentry>
        <transition><target id="won" prob="0.25"/><target id="lost"/></transition>
    </state>
    <state id="lost"><transition cond="left &gt; 0" target="throw"/></state>
    <state id="won"><onentry><send event="won"><param name="left" expr="left"/></send></onentry></state>"""


@pytest.mark.parametrize('order', list(Order))
def test_a_probability_is_exact(tmp_path: Path, order: Order) -> None:
    properties = {'asked': finally_('won.valid'), 'at first': finally_('won__left', 2)}
    main = write(tmp_path, properties, nodes={'dice': DICE})
    result = checked(main, order=order)
    assert result.is_exact
    assert result.value == pytest.approx(1 - 0.75**3)
    assert result.holds is False
    assert checked(main, 'at first', order=order).value == pytest.approx(0.25)


def test_random_runs_keep_the_error_that_they_state(tmp_path: Path) -> None:
    main = write(tmp_path, {'asked': finally_('won.valid')}, nodes={'dice': DICE})
    result = checked(main, method=Method.STATISTICAL, limits=CheckLimits(error=0.05, confidence=0.999, seed=7))
    assert result.size <= 1659  # ln(4/0.001) / (2 * 0.05**2)
    assert result.high - 0.05 <= result.value <= result.low + 0.05
    assert result.low <= 1 - 0.75**3 <= result.high
    assert not result.is_exact
    assert result.holds is False


def test_few_random_runs_are_enough_at_0_and_1(tmp_path: Path) -> None:
    properties = {'always': finally_(COUNT, 10), 'never': finally_(COUNT, 11)}
    main = write(tmp_path, properties, nodes={'counter': COUNTER.format(rate=1)})
    limits = CheckLimits(error=0.05)
    always, never = (checked(main, name, method=Method.STATISTICAL, limits=limits) for name in properties)
    assert (always.value, always.high, always.is_complete) == (1.0, 1.0, True)
    assert (never.value, never.low, never.is_complete) == (0.0, 0.0, True)
    # The value is one end of the bounds there: the error is all that is between them.
    assert always.low >= 0.95 and never.high <= 0.05
    assert always.size == never.size < 200 < max(looks(limits.error, limits.confidence))


@pytest.mark.parametrize('p', [0.0, 0.02, 0.3, 0.5, 1.0])
def test_the_bounds_of_random_runs_hold_with_their_confidence(p: float) -> None:
    # The probability that runs end with bounds that are wrong, exactly: all sequences of runs, by their counts.
    found = looks(error=0.08, confidence=0.9)
    assert sum(found.values()) == pytest.approx(0.1)
    whole, wrong = {0: 1.0}, 0.0
    for done in range(1, max(found) + 1):
        whole = {good: whole.get(good, 0.0) * (1.0 - p) + whole.get(good - 1, 0.0) * p for good in range(done + 1)}
        for good in list(whole) if done in found else ():
            bounds = bounds_of(good, 0, done, found[done])
            is_enough = bounds.error <= 0.08
            assert is_enough or done < max(found)
            if is_enough:
                wrong += whole.pop(good) * (not bounds.low - 1e-9 <= p <= bounds.high + 1e-9)
    assert wrong <= 0.1


def test_math_random_is_drawn_anew_in_each_run(tmp_path: Path) -> None:
    node = """draw|<datamodel><data id="x" type="float32" expr="0.0"/></datamodel>
        <state id="draw"><transition target="end"><assign location="x" expr="Math.random()"/></transition></state>
        <state id="end"><onentry><if cond="x &lt; 0.25"><send event="low"/></if></onentry></state>"""
    main = write(tmp_path, {'asked': finally_('low.valid')}, nodes={'one': node})
    assert checked(main, limits=CheckLimits(error=0.05, confidence=0.999)).value == pytest.approx(0.25, abs=0.05)
    with pytest.raises(ValueError, match='statistical'):
        checked(main, method=Method.EXACT)


@pytest.mark.parametrize(
    ('drawn', 'probabilities'),
    [
        ('Math.floor(Math.random() * 4)', {0: 0.25, 1: 0.25, 2: 0.25, 3: 0.25}),
        ('Math.floor(1 + n * Math.random()) - 2', {-1: 0.4, 0: 0.4, 1: 0.2}),
        ('Math.floor(Math.random() * 2 + 0.75)', {0: 0.125, 1: 0.5, 2: 0.375}),
        ('Math.round(Math.random() * 2)', {0: 0.25, 1: 0.5, 2: 0.25}),
        ('Math.floor(Math.random() * 2) + 10 * Math.floor(Math.random() * 2)', {0: 0.25, 1: 0.25, 10: 0.25, 11: 0.25}),
        ('Math.random() &lt; 0.125 ? 1 : 0.25 &gt; Math.random() ? 2 : 3', {1: 0.125, 2: 0.21875, 3: 0.65625}),
        ('0.125 &lt; Math.random() ? 1 : 0', {1: 0.875, 0: 0.125}),
        ('Math.floor(1 + 1e-17 * Math.random())', {1: 1.0}),
        ('Math.floor(Math.random() * 0) + (Math.random() &lt; 2 ? 1 : 0)', {1: 1.0}),
        ('Math.random() &lt; n * 1e308 * 0 ? 1 : 0', {0: 1.0}),  # not a number
    ],
)
def test_whole_numbers_drawn_by_lot_are_followed_exactly(
    tmp_path: Path, drawn: str, probabilities: dict[int, float]
) -> None:
    node = f"""draw|<datamodel><data id="x" type="int32" expr="0"/><data id="n" type="float32" expr="2.5"/></datamodel>
        <state id="draw"><transition target="end"><assign location="x" expr="{drawn}"/></transition></state>
        <state id="end"><onentry><send event="got"><param name="x" expr="x"/></send></onentry></state>"""

    def got(x: int) -> dict[str, Any]:
        is_x = {'op': '=', 'left': 'got__x', 'right': x}
        return {'op': 'Pmin', 'exp': {'op': 'F', 'exp': {'op': '∧', 'left': is_x, 'right': 'got.valid'}}}

    main = write(tmp_path, {str(x): got(x) for x in probabilities}, nodes={'one': node})
    for x, probability in probabilities.items():
        found = checked(main, str(x))
        assert found.is_exact and found.value == pytest.approx(probability)
    assert sum(probabilities.values()) == 1.0
    sampled = checked(main, str(x), method=Method.STATISTICAL, limits=CheckLimits(error=0.05, confidence=0.999))
    assert sampled.low <= probability <= sampled.high and not sampled.is_exact


def test_too_many_values_by_lot_are_drawn(tmp_path: Path) -> None:
    node = """draw|<datamodel><data id="x" type="int32" expr="0"/></datamodel><state id="draw"><transition target="end">
        <assign location="x" expr="Math.floor(Math.random() * 1e9)"/></transition></state>
        <state id="end"><onentry><if cond="x &lt; 5e8"><send event="low"/></if></onentry></state>"""
    main = write(tmp_path, {'asked': finally_('low.valid')}, nodes={'one': node})
    found = checked(main, limits=CheckLimits(error=0.05))
    assert not found.is_exact and found.low <= 0.5 <= found.high and 'too many values' in found.notes[0]
    with pytest.raises(ModelFault, match='too many values'):
        checked(main, method=Method.EXACT)


DRAW = """draw|<datamodel><data id="x" type="int32" expr="0"/></datamodel>{}
    <state id="draw"><{} target="end"><assign location="x" expr="Math.floor(Math.random() * 150)"/></{}></state>
    <state id="end"><onentry><if cond="x &lt; 75"><send event="{}"/></if></onentry></state>"""
RATE = '<ros_time_rate name="clock" rate_hz="1"/>'


@pytest.mark.parametrize(
    ('head', 'transition'),
    [('', 'transition'), ('', 'transition event="go"'), (RATE, 'ros_rate_callback name="clock"')],
    ids=['at first', 'by an event', 'by timers'],
)
def test_too_many_values_of_several_automata_are_drawn(tmp_path: Path, head: str, transition: str) -> None:
    nodes = {one: DRAW.format(head, transition, transition.split()[0], one) for one in ('a', 'b')}
    nodes['sender'] = (
        'go|<state id="go"><transition target="end"><send event="go"/></transition></state><state id="end"/>'
    )
    main = write(tmp_path, {'asked': finally_('a.valid')}, nodes=nodes)
    found = checked(main, limits=CheckLimits(error=0.05, states=1_000))
    assert not found.is_exact and found.low <= 0.5 <= found.high and 'too many' in found.notes[0]
    with pytest.raises(ModelFault, match='too many'):
        checked(main, method=Method.EXACT, limits=CheckLimits(states=1_000))


CHOICE = """draw|<datamodel><data id="x" type="int32" expr="0"/></datamodel>{}
    <state id="draw"><onentry><assign location="x" expr="Math.floor(Math.random() * {values})"/></onentry>
        <transition target="draws"/></state>
    <state id="draws"><onentry><send event="drawn"><param name="x" expr="x"/></send></onentry>
        <transition><target id="won" prob="0.5"/><target id="lost"/></transition></state>
    <state id="won"><onentry><send event="won"/></onentry></state><state id="lost"/>"""


@pytest.mark.parametrize(('head', 'values'), [('', 100), (RATE, 1_000)], ids=['graph', 'rounds'])
def test_it_is_looked_at_the_time_also_while_one_draws_many_values(tmp_path: Path, head: str, values: int) -> None:
    node = CHOICE.format(head, values=values)
    main = write(tmp_path, {'asked': finally_('won.valid')}, nodes={'one': node})
    found = checked(main, method=Method.EXACT, limits=CheckLimits(seconds=0.0))
    assert not found.is_complete and found.low < 0.5 < found.high and found.size < 200


@pytest.mark.parametrize('heard', ['<transition event="got" target="end"/>', ''])
def test_the_way_tells_the_value_that_was_sent(tmp_path: Path, heard: str) -> None:
    node = """draw|<state id="draw"><transition target="end"><send event="got">
        <param name="x" expr="Math.floor(Math.random() * 20)"/></send></transition></state><state id="end"/>"""
    isnt = {'op': '≠', 'left': 'got__x', 'right': 7}
    asked = {'op': 'Pmin', 'exp': {'op': 'G', 'exp': isnt}}
    nodes = {'one': node, 'two': f'wait|<state id="wait">{heard}</state><state id="end"/>'}
    found = checked(write(tmp_path, {'asked': asked}, nodes=nodes))
    assert found.is_exact and found.value == pytest.approx(0.95)
    assert 'one sends got (x 7)' in found.way


def test_the_order_of_automata_is_asked_for(tmp_path: Path) -> None:
    sender = 'go|<state id="go"><transition target="end"><send event="{0}"/></transition></state><state id="end"/>'
    judge = """wait|<state id="wait"><transition event="a" target="first"/><transition event="b" target="end"/></state>
        <state id="first"><onentry><send event="a_was_first"/></onentry></state><state id="end"/>"""
    nodes = {'x': sender.format('a'), 'y': sender.format('b'), 'judge': judge}
    properties = {extreme: finally_('a_was_first.valid', True, extreme) for extreme in ('Pmin', 'Pmax')}
    main = write(tmp_path, properties, nodes=nodes)
    # At random: a is sent first with 1/2; then of its delivery and the sending of b, and of both deliveries.
    found = {order: [checked(main, name, order=order).value for name in properties] for order in Order}
    assert found[Order.TURNS] == [1.0, 1.0]
    assert found[Order.ANY] == [0.0, 1.0]
    assert found[Order.RANDOM] == pytest.approx([0.5, 0.5])


def test_an_unhandled_message_is_discarded_and_a_request_waits(tmp_path: Path) -> None:
    server = """busy|<ros_service_server name="s" service_name="/add" type="x/Add"/>
        <ros_time_rate name="later" rate_hz="1"/>
        <ros_topic_subscriber topic="hello" type="std_msgs/Empty"/>
        <datamodel><data id="sum" type="int32" expr="0"/></datamodel>
        <state id="busy"><ros_rate_callback name="later" target="free"/></state>
        <state id="free">
            <ros_service_handle_request name="s" target="free">
                <assign location="sum" expr="_req.a + _req.b"/>
                <ros_service_send_response name="s"><field name="sum" expr="sum"/></ros_service_send_response>
            </ros_service_handle_request>
        </state>
        <state id="never"><ros_topic_callback name="hello" target="never"/></state>"""
    client = """ask|<ros_service_client name="s" service_name="/add" type="x/Add"/>
        <ros_topic_publisher topic="hello" type="std_msgs/Empty"/>
        <state id="ask">
            <onentry><ros_topic_publish name="hello"/>
                <ros_service_send_request name="s">
                    <field name="a" expr="{0}"/><field name="b" expr="10"/></ros_service_send_request></onentry>
            <ros_service_handle_response name="s" target="end">
                <send event="sum_{0}"><param name="is" expr="_res.sum"/></send></ros_service_handle_response>
        </state><state id="end"/>"""
    properties = {
        'one': finally_('sum_1__is', 11),
        'two': finally_('sum_2__is', 12),
    }
    nodes = {'server': server, 'first': client.format(1), 'second': client.format(2)}
    main = write(tmp_path, properties, nodes=nodes)
    # A request that waits keeps the time from going on, as in AS2FM: so nobody is ever served.
    stuck = checked(main, 'one')
    assert stuck.value == 0.0
    assert 'srv_add_request waits for server in busy' in stuck.notes[0]
    nodes['server'] = server.replace('busy|', 'free|')
    main = write(tmp_path, properties, nodes=nodes)
    assert [checked(main, name).value for name in properties] == [1.0, 1.0]


ACTION_SERVER = """idle|<ros_action_server name="go" action_name="/go" type="x/Go"/>
    <ros_action_thread name="go" n_threads="2" initial="rest">
        <datamodel><data id="id" type="int32" expr="-1"/><data id="way" type="int32" expr="0"/></datamodel>
        <state id="rest">
            <ros_action_handle_thread_start name="go" target="drive">
                <assign location="id" expr="_action.goal_id"/><assign location="way" expr="_goal.way"/>
            </ros_action_handle_thread_start></state>
        <state id="drive">
            <transition cond="way == 0" target="rest"><ros_action_aborted name="go" goal_id="id"/></transition>
            <transition target="rest">
                <ros_action_feedback name="go" goal_id="id"><field name="done" expr="way"/></ros_action_feedback>
                <ros_action_succeed name="go" goal_id="id"><field name="far" expr="way * 2"/></ros_action_succeed>
            </transition></state>
    </ros_action_thread>
    <datamodel><data id="thread" type="int32" expr="0"/><data id="id" type="int32" expr="0"/>
        <data id="way" type="int32" expr="0"/></datamodel>
    <state id="idle"><ros_action_handle_goal name="go" target="start">
        <assign location="id" expr="_action.goal_id"/><assign location="way" expr="_goal.way"/>
    </ros_action_handle_goal></state>
    <state id="start"><transition cond="way &lt; 0" target="idle">
            <ros_action_reject_goal name="go" goal_id="id"/></transition>
        <transition target="idle"><ros_action_accept_goal name="go" goal_id="id"/>
            <ros_action_start_thread name="go" goal_id="id" thread_id="thread"><field name="way" expr="way"/>
            </ros_action_start_thread><assign location="thread" expr="1 - thread"/></transition></state>"""
ACTION_CLIENT = """send|<ros_action_client name="go" action_name="/go" type="x/Go"/>
    <state id="send"><onentry><ros_action_send_goal name="go"><field name="way" expr="{0}"/></ros_action_send_goal>
        </onentry><ros_action_handle_goal_response name="go" accept="wait" reject="refused"/></state>
    <state id="wait">
        <ros_action_handle_feedback name="go" target="wait"><send event="feedback_{1}"/></ros_action_handle_feedback>
        <ros_action_handle_success_result name="go" target="end"><send event="done_{1}">
            <param name="far" expr="_wrapped_result.result.far"/></send></ros_action_handle_success_result>
        <ros_action_handle_aborted_result name="go" target="end"><send event="aborted_{1}"/>
        </ros_action_handle_aborted_result></state>
    <state id="refused"><onentry><send event="refused_{1}"/></onentry></state><state id="end"/>"""


@pytest.mark.parametrize('order', [Order.TURNS, Order.RANDOM])
def test_each_client_of_an_action_gets_its_own_result(tmp_path: Path, order: Order) -> None:
    ways = {'a': 4, 'b': 5, 'c': 0, 'd': -1}
    nodes = {'server': ACTION_SERVER} | {f'client_{key}': ACTION_CLIENT.format(way, key) for key, way in ways.items()}
    properties = {
        'a': finally_('done_a__far', 8),
        'b': finally_('done_b__far', 10),
        'c': finally_('aborted_c.valid'),
        'd': finally_('refused_d.valid'),
        'none': finally_('feedback_c.valid'),
    }
    if order is Order.RANDOM:
        nodes = {name: nodes[name] for name in ('server', 'client_a', 'client_b')}
        properties = {'a': properties['a'], 'b': properties['b']}
    main = write(tmp_path, properties, nodes=nodes)
    values = {name: checked(main, name, order=order).value for name in properties}
    assert values == pytest.approx({name: 0.0 if name == 'none' else 1.0 for name in properties})


def test_data_of_all_types(tmp_path: Path) -> None:
    (tmp_path / 'types.xml').write_text(
        '<types><struct id="P"><member id="x" type="float32"/><member id="name" type="string"/></struct>'
        '<struct id="Ps"><member id="all" type="P[]"/></struct></types>'
    )
    node = """go|<datamodel>
            <data id="p" type="P" expr="{'name': 'a', 'x': 1}"/>
            <data id="ps" type="Ps" expr="{'all': [{'x': 1.5, 'name': 'b'}]}"/>
            <data id="grid" type="int32[][]" expr="[[1], [2, 3]]"/>
            <data id="n" type="int32[4]" expr="[7]"/>
            <data id="t" type="string" expr="'it'"/>
        </datamodel>
        <state id="go"><onexit><assign location="n[n.length]" expr="grid[1][1] * 3"/></onexit>
            <transition target="end">
                <assign location="ps.all[2]" expr="p"/>
                <assign location="ps.all[0].x" expr="ps.all[0].x + ps.all.length"/>
                <assign location="p.name" expr="t + &quot;'s&quot;"/>
                <assign location="grid[3][1]" expr="grid.length &gt; 1 ? 9 : 0"/>
            </transition></state>
        <state id="end"><onentry><send event="out">
            <param name="n" expr="n"/><param name="p" expr="p"/><param name="x" expr="ps.all.x"/>
            <param name="grid" expr="grid"/><param name="name" expr="ps.all[2].name"/></send></onentry></state>"""

    def has(left: Any, right: Any) -> dict[str, Any]:
        return {'op': 'Pmin', 'exp': {'op': 'F', 'exp': {'op': '=', 'left': left, 'right': right}}}

    def at(array: Any, index: int) -> dict[str, Any]:
        return {'op': 'aa', 'exp': array, 'index': index}

    properties = {
        'length': has('out__n.d1_len', 2),
        'appended': has(at('out__n', 1), 9),
        'behind the end': has(at('out__n', 3), 0),
        'member': has('out__p__x', 1.0),
        'text': has('out__p__name', {'op': 'av', 'elements': [*b"it's"]}),
        'members of all': has(at('out__x', 0), 4.5),
        'filled': has(at(at('out__grid', 3), 1), 9),
        'record': has(at('out__name', 0), ord('a')),
    }
    declarations = '<data_declarations><input type="xml" src="types.xml"/></data_declarations>'
    main = write(
        tmp_path, properties | {'unknown': has('out__p__y', 1)}, nodes={'one': node}, declarations=declarations
    )
    assert {name: checked(main, name).value for name in properties} == dict.fromkeys(properties, 1.0)
    with pytest.raises(ModelFault, match="has no value: there is no member 'y'; there are x, name"):
        checked(main, 'unknown')


def test_a_record_is_sent_as_a_whole_or_by_its_members(tmp_path: Path) -> None:
    (tmp_path / 'types.xml').write_text('<types><struct id="P"><member id="x" type="int32"/></struct></types>')
    node = """go|<datamodel><data id="p" type="P" expr="{{'x': 1}}"/></datamodel>
        <ros_topic_publisher name="out" topic="/out" type="P"/>
        <state id="go"><transition target="end"><ros_topic_publish name="out">
            <field name="{}" expr="{}"/></ros_topic_publish></transition></state><state id="end"/>"""
    declarations = '<data_declarations><input type="xml" src="types.xml"/></data_declarations>'
    nodes = {'whole': node.format('p', 'p')}
    properties = {'asked': finally_('topic_out_msg__ros_fields__p__x', 1)}
    assert checked(write(tmp_path, properties, nodes=nodes, declarations=declarations)).value == 1.0
    # The receivers could not know which of the two was sent.
    main = write(tmp_path, properties, nodes=nodes | {'member': node.format('p.x', '1')}, declarations=declarations)
    with pytest.raises(TreeLoadError, match='topic_out_msg is sent with ros_fields__p as a whole'):
        RoamlModel(str(main))


def test_a_file_of_a_model_that_never_ends_is_refused() -> None:
    with pytest.raises(TreeLoadError, match='it is a pipe or device; give a regular file'):
        RoamlModel('/dev/zero')


# -- trees -----------------------------------------------------------------------------------------------------------

TRY = """idle|<bt_declare_port_in key="chance" type="float32"/>
    <state id="idle">
        <bt_tick><target id="idle" prob="0.7"><bt_return_status status="SUCCESS"/></target>
            <target id="idle"><bt_return_status status="FAILURE"/></target></bt_tick>
        <bt_halt target="idle"><bt_return_halted/></bt_halt></state>"""
ROOT = 'bt_1000_response__status'


def test_a_plugin_is_a_leaf_of_a_real_tree(tmp_path: Path) -> None:
    tree = """<root BTCPP_format="4"><BehaviorTree ID="T"><RetryUntilSuccessful num_attempts="3">
        <Action ID="Try" chance="0.7"/></RetryUntilSuccessful></BehaviorTree></root>"""
    properties = {
        'asked': finally_(ROOT, 1),
        'fails': finally_(ROOT, 2),
        'child': finally_('bt_1001_response__status', 2),
    }
    main = write(tmp_path, properties, plugins={'Try': TRY}, tree=tree)
    found = [checked(main, name).value for name in properties]
    assert found == pytest.approx([1 - 0.3**3, 0.3**3, 0.3])
    way = checked(main).way
    assert [line for line in way if 'ticks' in line] == ['the tree ticks Try::2'] * 3
    assert way[-1] == 'the tree gives FAILURE' or 'the tree gives FAILURE' in way


PROBE = """idle|<bt_declare_port_in key="runs" type="int8"/><bt_declare_port_in key="topic" type="string"/>
    <datamodel><data id="ticks" type="int16" expr="0"/><data id="halts" type="int16" expr="0"/>
        <data id="runs" type="int8"><expr><bt_get_input key="runs"/></expr></data></datamodel>
    <ros_topic_publisher name="t" type="std_msgs/Int16"><topic><bt_get_input key="topic"/></topic></ros_topic_publisher>
    <state id="idle">
        <bt_tick target="idle"><assign location="ticks" expr="ticks + 1"/>
            <ros_topic_publish name="t"><field name="data" expr="ticks"/><field name="halts" expr="halts"/>
            </ros_topic_publish>
            <if cond="ticks % (runs + 1) &gt; 0"><bt_return_status status="RUNNING"/><else/>
                <bt_return_status status="SUCCESS"/></if></bt_tick>
        <bt_halt target="idle"><assign location="halts" expr="halts + 1"/><bt_return_halted/></bt_halt></state>"""


@pytest.mark.parametrize(('control', 'ticks'), [('Sequence', 1), ('ReactiveSequence', 3), ('SequenceWithMemory', 1)])
def test_controls_are_those_of_the_engine(tmp_path: Path, control: str, ticks: int) -> None:
    tree = f"""<root><BehaviorTree ID="T"><{control}>
        <Probe topic="first" runs="0"/><Probe topic="second" runs="2"/></{control}></BehaviorTree></root>"""
    first = 'topic_first_msg__ros_fields__data'
    done = {
        'op': '∧',
        'left': {'op': '=', 'left': ROOT, 'right': 1},
        'right': {'op': '=', 'left': first, 'right': ticks},
    }
    properties = {'asked': {'op': 'Pmin', 'exp': {'op': 'F', 'exp': done}}, 'more': finally_(first, ticks + 1)}
    main = write(tmp_path, properties, plugins={'Probe': PROBE}, tree=tree)
    assert [checked(main, name).value for name in properties] == [1.0, 0.0]


def test_what_is_set_back_is_told_also_when_it_does_not_run(tmp_path: Path) -> None:
    tree = """<root><BehaviorTree ID="T"><Repeat num_cycles="3"><Sequence>
        <Probe topic="one" runs="1"/></Sequence></Repeat></BehaviorTree></root>"""
    halts = 'topic_one_msg__ros_fields__halts'
    main = write(
        tmp_path, {'asked': finally_(halts, 2), 'more': finally_(halts, 3)}, plugins={'Probe': PROBE}, tree=tree
    )
    assert [checked(main, name).value for name in ('asked', 'more')] == [1.0, 0.0]


def test_plugins_share_the_blackboard(tmp_path: Path) -> None:
    put = """idle|<bt_declare_port_out key="to" type="int32"/>
        <datamodel><data id="n" type="int32" expr="0"/></datamodel>
        <state id="idle"><bt_tick target="idle"><assign location="n" expr="n + 5"/>
            <bt_set_output key="to" expr="n"/><bt_return_status status="SUCCESS"/></bt_tick>
            <bt_halt target="idle"><bt_return_halted/></bt_halt></state>"""
    get = """idle|<bt_declare_port_in key="from" type="int32"/>
        <datamodel><data id="n" type="int32" expr="0"/></datamodel>
        <state id="idle"><bt_tick target="idle">
            <assign location="n"><expr><bt_get_input key="from"/></expr></assign>
            <send event="got"><param name="n" expr="n"/></send><bt_return_status status="SUCCESS"/></bt_tick>
            <bt_halt target="idle"><bt_return_halted/></bt_halt></state>"""
    tree = """<root BTCPP_format="4"><BehaviorTree ID="T"><Sequence>
        <Get from="{x}"/><Put to="{x}"/><Get from="{x}"/><SetBlackboard output_key="{x}" value="7"/><Get from="{x}"/>
        <BlackboardCheckInt value_A="{x}" value_B="8" return_on_mismatch="2"><AlwaysSuccess/></BlackboardCheckInt>
        </Sequence></BehaviorTree></root>"""
    properties = {f'got {n}': finally_('got__n', n) for n in (0, 5, 7, 8)}
    properties |= {'written': finally_('bt_blackboard_set_x__value', 7), 'checked': finally_(ROOT, 2)}
    main = write(tmp_path, properties, plugins={'Put': put, 'Get': get}, tree=tree)
    values = {name: checked(main, name).value for name in properties}
    assert values == dict.fromkeys(properties, 1.0) | {'got 8': 0.0}


@pytest.mark.parametrize('last', ['<ScriptCondition code="x == 2"/>', '<AlwaysSuccess _failureIf="x == 1"/>'])
def test_a_script_reads_what_is_written_on_its_own_way(tmp_path: Path, last: str) -> None:
    way = '<IfThenElse><Action ID="Try" chance="0.7"/><Script code="x := 1"/><Script code="x := 2"/></IfThenElse>'
    tree = f'<root BTCPP_format="4"><BehaviorTree ID="T"><Sequence>{way}{last}</Sequence></BehaviorTree></root>'
    main = write(tmp_path, {'asked': finally_(ROOT, 1)}, plugins={'Try': TRY}, tree=tree)
    assert checked(main).value == pytest.approx(0.3)


def test_the_tree_is_ticked_on_only_if_it_is_asked(tmp_path: Path) -> None:
    tree = '<root><BehaviorTree ID="T"><Probe topic="one" runs="0"/></BehaviorTree></root>'
    properties = {'asked': finally_('topic_one_msg__ros_fields__data', 5)}
    for value, expected in (('false', 0.0), ('true', 1.0)):
        parameters = f'<bt_tick_rate value="2"/><bt_tick_if_not_running value="{value}"/>'
        main = write(tmp_path, properties, plugins={'Probe': PROBE}, tree=tree, parameters=parameters)
        assert checked(main).value == expected


def test_a_plugin_that_never_answers_is_refused(tmp_path: Path) -> None:
    tree = '<root><BehaviorTree ID="T"><Mute/></BehaviorTree></root>'
    plugins = {'Mute': 'idle|<state id="idle"><transition event="bt_tick" target="idle"/></state>'}
    main = write(tmp_path, {'asked': finally_(ROOT, 1)}, plugins=plugins, tree=tree)
    with pytest.raises(TreeLoadError, match='no state of this plugin has <bt_tick>'):
        RoamlModel(str(main))


def test_a_halt_that_nobody_answers_is_told(tmp_path: Path) -> None:
    tree = '<root><BehaviorTree ID="T"><Inverter><Deaf/></Inverter></BehaviorTree></root>'
    deaf = 'idle|<state id="idle"><bt_tick target="idle"><bt_return_status status="SUCCESS"/></bt_tick></state>'
    main = write(tmp_path, {'asked': finally_(ROOT, 2)}, plugins={'Deaf': deaf}, tree=tree)
    result = checked(main)
    assert (result.value, result.notes) == (0.0, ('stuck: the tree waits for the answer of Deaf::2',))


def test_a_plugin_may_be_a_control(tmp_path: Path) -> None:
    either = """idle|<bt_declare_port_in key="CHILDREN_COUNT" type="int8"/>
        <datamodel><data id="at" type="int8" expr="0"/><data id="count" type="int8">
            <expr><bt_get_input key="CHILDREN_COUNT"/></expr></data></datamodel>
        <state id="idle"><bt_tick target="asking"><assign location="at" expr="0"/></bt_tick>
            <bt_halt target="idle"><bt_return_halted/></bt_halt></state>
        <state id="asking"><onentry><bt_tick_child id="at"/></onentry>
            <bt_child_status id="at" cond="_bt.status == SUCCESS" target="idle"><bt_return_status status="SUCCESS"/>
            </bt_child_status>
            <bt_child_status id="at" cond="at + 1 == count" target="idle"><bt_return_status status="FAILURE"/>
            </bt_child_status>
            <bt_child_status id="at" target="asking"><assign location="at" expr="at + 1"/></bt_child_status></state>"""
    tree = """<root><BehaviorTree ID="T"><Inverter><Either><Try/><Try/><Inverter><Try/></Inverter></Either></Inverter>
        </BehaviorTree></root>"""
    main = write(tmp_path, {'asked': finally_(ROOT, 2)}, plugins={'Either': either, 'Try': TRY}, tree=tree)
    assert checked(main).value == pytest.approx(1 - 0.3 * 0.3 * 0.7)


# -- what is refused -------------------------------------------------------------------------------------------------

GOOD = """go|<datamodel><data id="n" type="int16" expr="0"/></datamodel>
<ros_topic_publisher name="out" topic="/count" type="std_msgs/Int16"/>
<state id="go">
<transition target="end">
<assign location="n" expr="n + 1"/>
<ros_topic_publish name="out"><field name="data" expr="n"/></ros_topic_publish>
</transition>
</state>
<state id="end"/>"""
HALVES = '><target id="end" prob="0.5"/><target id="go" prob="0.6"/>'


@pytest.mark.parametrize(
    ('old', 'new', 'line', 'words'),
    [
        ('<state id="end"/>', '<stat id="end"/>', 9, "did you mean 'state'"),
        ('target="end"', 'target="ende"', 4, "there is no state 'ende'; did you mean 'end'?"),
        ('expr="n + 1"', 'expr="n +"', 5, "a value is missing after '+'"),
        ('expr="n + 1"', 'expr="m + 1"', 5, 'm is not known here'),
        ('expr="n + 1"', 'expr="Math.foo(1)"', 5, 'there is no function Math.foo'),
        ('expr="n + 1"', '', 5, '[expr] is missing'),
        ('location="n"', 'location="x"', 5, 'is not data of one'),
        ('type="int16"', 'type="int15"', 1, "did you mean 'int16'"),
        ('expr="0"', 'expr="\'a\'"', 1, "'a' is not of type int16"),
        ('publish name="out"', 'publish name="oot"', 6, "did you mean 'out'"),
        ('</transition>', '</transition><transition event="x" target="end"/>', 3, 'others are never taken'),
        (GOOD[GOOD.index('target=') : GOOD.index('</transition>')], HALVES, 4, 'more than the 0.5 left'),
        ('<state id="end"/>', '<state id="end"/><state id="end"/>', 9, 'declared twice'),
        ('<state id="go">', '<state id="go"><onentry><bt_return_halted/></onentry>', 3, 'for plugins of a tree'),
    ],
)
def test_an_error_tells_file_line_and_remedy(tmp_path: Path, old: str, new: str, line: int, words: str) -> None:
    assert old in GOOD
    main = write(tmp_path, {'asked': finally_(COUNT, 1)}, nodes={'one': GOOD})
    assert checked(main).value == 1.0
    main = write(tmp_path, {'asked': finally_(COUNT, 1)}, nodes={'one': GOOD.replace(old, new, 1)})
    with pytest.raises(TreeLoadError, match=re.escape(words)) as raised:
        RoamlModel(str(main))
    assert raised.value.errors[0].file == str(tmp_path / 'one.ascxml')
    assert raised.value.errors[0].line == line


@pytest.mark.parametrize(
    ('expression', 'words'),
    [
        (finally_('nothing.valid'), "there is no event 'nothing'"),
        (finally_('topic_count_msg__ros_fields__dato'), 'topic_count_msg carries ros_fields__data'),
        ({**_filter(finally_('topic_count_msg.valid')), 'states': {'op': 'deadlock'}}, 'in the initial states'),
        ({**_filter(finally_('topic_count_msg.valid')), 'fun': 'count'}, 'in the initial states'),
        ({'op': 'Emin', 'exp': 1}, "'Emin' is not known where a probability is asked"),
        ({'op': '>', 'left': {'op': 'Pmin', 'exp': True}, 'right': 10**400}, 'is compared with a number'),
        ({'op': 'Pmin', 'exp': {'op': 'F', 'exp': 10**400}}, 'is not a number'),
        ({'op': 'Pmin', 'exp': {'op': 'X', 'exp': True}}, "'X' is not known of a path"),
        ({'op': 'Pmin', 'exp': {'op': 'F', 'exp': {'op': 'xor', 'left': 1, 'right': 2}}}, "'xor' is not known"),
    ],
)
def test_a_property_that_means_nothing_is_refused(tmp_path: Path, expression: dict[str, Any], words: str) -> None:
    main = write(tmp_path, {'asked': expression}, nodes={'one': GOOD})
    with pytest.raises(TreeLoadError, match=re.escape(words)):
        RoamlModel(str(main))


@pytest.mark.parametrize(
    ('body', 'words'),
    [
        ('<assign location="a[0]" expr="a[3]"/>', 'there is no element 3'),
        ('<assign location="a[9]" expr="1"/>', 'no element 9: int32[4] has 4 at most'),
        ('<assign location="a[1 / 2]" expr="1"/>', 'no element 0.5'),
        ('<assign location="a[1e200 * 1e200]" expr="1"/>', 'no element inf'),
        ('<assign location="n" expr="1 / n"/>', 'division by zero'),
    ],
)
def test_what_has_no_value_is_told_with_its_place(tmp_path: Path, body: str, words: str) -> None:
    node = f"""go|<datamodel><data id="n" type="int32" expr="0"/><data id="a" type="int32[4]" expr="[1]"/></datamodel>
        <state id="go"><transition target="end">
        {body}</transition></state><state id="end"><onentry><send event="e"/></onentry></state>"""
    main = write(tmp_path, {'asked': finally_('e.valid')}, nodes={'one': node})
    with pytest.raises(ModelFault, match=re.escape(words)) as raised:
        checked(main)
    assert f'{tmp_path / "one.ascxml"}:3' in str(raised.value)


def test_an_automaton_that_keeps_itself_busy_is_told(tmp_path: Path) -> None:
    node = """go|<datamodel><data id="n" type="int64" expr="0"/></datamodel><state id="go">
        <transition target="go"><assign location="n" expr="n + 1"/></transition></state>"""
    main = write(
        tmp_path,
        {'asked': finally_('e.valid')},
        nodes={'one': node, 'two': 'x|<state id="x"><onentry><send event="e"/></onentry></state>'},
    )
    with pytest.raises(ModelFault, match='one keeps itself busy'):
        checked(main)


def test_the_main_file_is_known_by_its_first_element() -> None:
    assert is_model('\ufeff<?xml version="1.0"?>\n<!-- <root> -->\n<roaml>')
    assert is_model('<convince_mc_tc>')
    assert not is_model('<!-- <roaml> --><root/>')
    assert not is_model('')


def test_a_value_that_grows_without_bound_is_told(tmp_path: Path) -> None:
    node = """go|<datamodel><data id="n" type="int64" expr="9"/></datamodel><state id="go">
        <transition target="go"><assign location="n" expr="n * n"/></transition></state>"""
    nodes = {'one': node, 'two': 'x|<state id="x"><onentry><send event="e"/></onentry></state>'}
    main = write(tmp_path, {'asked': finally_('e.valid')}, nodes=nodes)
    with pytest.raises(ModelFault, match='too large for n'):
        checked(main)


def test_a_port_that_no_tree_can_have_is_refused(tmp_path: Path) -> None:
    tree = '<root><BehaviorTree ID="T"><Try/></BehaviorTree></root>'
    plugins = {'Try': TRY.replace('key="chance"', 'key="1.0"')}
    main = write(tmp_path, {'asked': finally_(ROOT, 1)}, plugins=plugins, tree=tree)
    with pytest.raises(TreeLoadError, match=re.escape("port name '1.0' has to begin with a letter")):
        RoamlModel(str(main))

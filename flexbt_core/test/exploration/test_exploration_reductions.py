# SPDX-License-Identifier: BSD-3-Clause
"""What a proof leaves out makes no difference: the same is found, and the same ends, with it and without."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as some

from flexbt_core.behavior_tree import TreeKey, TreeLibrary, builtin_registry, input_port, load_xml, output_port
from flexbt_core.behavior_tree.model import STRING, UINT16
from flexbt_core.exploration import Limits, Report, TreeSystem, explore
from flexbt_core.skills import Skill
from flexbt_testing.behavior_trees.seeded_trees import IsClear, StandIn, Turn


class Plan(StandIn):
    ports = {'path': output_port(STRING), 'error_code_id': output_port(UINT16)}


class Drive(StandIn):
    skill = Skill.of(resources=['base'])
    ports = {'path': input_port(STRING), 'error_code_id': output_port(UINT16)}


class Clear(StandIn):
    skill = Skill.of(ignores_cancel=True)


REGISTRY = builtin_registry()
REGISTRY.register_classes([Plan, Drive, Turn, Clear, IsClear])
KEYS = some.sampled_from('ab')
LEAVES = some.one_of(
    some.sampled_from(('<IsClear/>', '<Turn/>', '<Clear/>', '<AlwaysSuccess/>')),
    KEYS.map('<Plan path="{{{0}}}" error_code_id="{{{0}_code}}"/>'.format),
    KEYS.map('<Drive path="{{{0}}}" error_code_id="{{drive_code}}"/>'.format),
    KEYS.map('<ScriptCondition code="{0}_code == 0"/>'.format),
)
DECORATORS = ('Inverter', 'RetryUntilSuccessful num_attempts="2"', 'Timeout msec="50"', 'Delay delay_msec="5"')
CONTROLS = ('Sequence', 'Fallback', 'ReactiveSequence', 'ReactiveFallback', 'Parallel success_count="1"')


def around(inner: some.SearchStrategy[str]) -> some.SearchStrategy[str]:
    return some.one_of(
        some.builds(element, some.sampled_from(DECORATORS), some.tuples(inner)),
        some.builds(element, some.sampled_from(CONTROLS), some.lists(inner, min_size=2, max_size=3)),
    )


def element(name: str, children: list[str]) -> str:
    return f'<{name}>{"".join(children)}</{name.split()[0]}>'


TREES = some.recursive(LEAVES, around, max_leaves=6)


def proved(body: str, *, reduces: bool) -> Report:
    xml = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    library = TreeLibrary([load_xml(xml, 'main.xml', REGISTRY)])
    key = TreeKey('main.xml', 'Main')
    limits = Limits(seconds=600, configurations=300)
    return explore(lambda: TreeSystem(library, key, reduces=reduces), '', limits=limits)


def verdict(report: Report) -> object:
    found = sorted((one.violation.property.name, one.violation.where) for one in report.counterexamples)
    return found, sorted(report.ends), report.uncovered, report.depth


@settings(max_examples=30, deadline=None, derandomize=True)
@given(TREES)
def test_keys_that_nothing_reads_make_no_difference(body: str) -> None:
    without = proved(body, reduces=False)
    reduced = proved(body, reduces=True)
    assert reduced.configurations <= without.configurations
    if without.is_complete:
        assert verdict(reduced) == verdict(without)


def test_keys_that_nothing_reads_do_not_tell_situations_apart() -> None:
    body = '<Fallback><Drive path="{a}" error_code_id="{c}"/><Plan path="{b}" error_code_id="{d}"/><Turn/></Fallback>'
    body = f'<RetryUntilSuccessful num_attempts="-1"><ForceFailure>{body}</ForceFailure></RetryUntilSuccessful>'
    assert proved(body, reduces=True).configurations < proved(body, reduces=False).configurations

# SPDX-License-Identifier: BSD-3-Clause
"""Registration of Nav2's nodes: the branches of Nav2 whose nodes differ, and how to detect the branch of a file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from typing import Final, Literal, get_args

from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.engine.registry import NodeRegistry, declared_id

from . import conditions, controls, decorators

FAMILIES: Final = (controls, decorators, conditions)


def register_nav2(registry: NodeRegistry, nav2_branch: Nav2Branch = 'jazzy') -> None:
    """Register all nodes of Nav2; ``nav2_branch`` is the default for files whose branch cannot be detected."""
    for family in FAMILIES:
        register_branches(registry, family.NODES, nav2_branch)


# The branches of Nav2 whose nodes differ, and how to detect the branch of a file.
#
# ``nav2_branch`` of a class is its branch, that of a port the only branch that has the port.

Nav2Branch = Literal['jazzy', 'main']
"""A branch of Nav2 whose nodes differ from the other's. Nodes and ports of only one branch work in both."""

NAV2_BRANCHES: Final[tuple[Nav2Branch, ...]] = get_args(Nav2Branch)

JAZZY_TREE: Final = 'MainTree'
"""Name of Nav2's own trees in jazzy."""

MAIN_TREES: Final = frozenset(
    (
        'FollowPoint',
        'NavToPoseWithConsistentReplanningAndIfPathBecomesInvalid',
        'NavigateOnRouteGraphWRecovery',
        'NavigateThroughPosesWReplanningAndRecovery',
        'NavigateToPoseWBoundsCheck',
        'NavigateToPoseWReplanningAndRecovery',
        'NavigateToPoseWReplanningGoalPatienceAndRecovery',
        'NavigateWRecoveryAndReplanningOnlyIfPathBecomesInvalid',
        'NavigateWReplanningOnlyIfGoalIsUpdated',
        'NavigateWReplanningOnlyIfPathBecomesInvalid',
        'NavigateWRoutingGlobalPlanningAndControlWRecovery',
        'NavigateWithReplanningDistance',
        'NavigateWithReplanningSpeed',
        'NavigateWithReplanningTime',
        'OdometryCalibration',
    )
)
"""Names of Nav2's own trees in main."""


class _BranchOf:
    """The branch of Nav2 for which a file was written, by the names and attributes of its elements; None if unknown.

    Nodes that only one branch has identify it first. The names of trees come next: each of Nav2's trees in jazzy has
    the main tree ``MainTree``, those of main have other names. Ports that only one branch has come last, of Nav2's
    nodes only, since a user's class inherits the ports of its base. The trees of kilted, whose nodes behave as those of
    jazzy, have the names of jazzy and some ports of main.
    """

    def __init__(self, registry: NodeRegistry) -> None:
        self.nodes = set[str]()
        """Names of Nav2's nodes."""
        self._registry = registry

    def __call__(self, elements: Iterable[tuple[str, Mapping[str, str]]]) -> str | None:
        by_nodes, by_ports = set[str](), set[str]()
        named: Nav2Branch | None = None
        for id, attributes in elements:
            if id == 'root' and attributes.get('main_tree_to_execute') == JAZZY_TREE:
                named = 'jazzy'
            elif id == 'BehaviorTree' and attributes.get('ID') in MAIN_TREES:
                named = 'main'
            elif (manifest := self._registry.get(id)) is not None:
                by_nodes.add(manifest.nav2_branch)
                if id in self.nodes:
                    ports = manifest.ports
                    by_ports.update(ports[name].nav2_branch for name in attributes.keys() & ports.keys())
        return _the_only(by_nodes) or named or _the_only(by_ports)


def _the_only(branches: set[str]) -> str | None:
    """Return the only known branch in ``branches``; None if they have none or several."""
    known = branches & {*NAV2_BRANCHES}
    return known.pop() if len(known) == 1 else None


def register_branches(
    registry: NodeRegistry, node_classes: Collection[type[TreeNode]], nav2_branch: Nav2Branch
) -> None:
    """Register node classes as they are in ``nav2_branch``, and, for files of another branch, as they are there.

    Of two classes with one name, each is for the branch in its ``nav2_branch``. A class without a counterpart works in
    both branches; if it has a branch, a file that uses it is of that branch.
    """
    if not isinstance(registry.nav2_branch_of, _BranchOf):
        registry.nav2_branch_of = _BranchOf(registry)
    classes = Counter(map(declared_id, node_classes))
    registry.nav2_branch_of.nodes.update(classes)
    for node_class in node_classes:
        branch = vars(node_class).get('nav2_branch', '')
        if classes[declared_id(node_class)] == 1:
            registry.register_class(node_class, only=branch)
        else:
            registry.register_class(node_class, '' if branch == nav2_branch else branch)

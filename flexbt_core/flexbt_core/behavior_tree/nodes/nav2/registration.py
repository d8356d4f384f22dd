# SPDX-License-Identifier: BSD-3-Clause
"""Registration of Nav2's nodes: the branches of Nav2 whose nodes differ, and how a file shows its branch."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from typing import Final, Literal, get_args

from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.engine.registry import NodeRegistry, declared_id

from . import conditions, controls, decorators

FAMILIES: Final = (controls, decorators, conditions)


def register_nav2(registry: NodeRegistry, nav2_branch: Nav2Branch = 'jazzy') -> None:
    """Register all nodes of the families, as they are in that branch of Nav2 where a file does not show its own."""
    for family in FAMILIES:
        register_branches(registry, family.NODES, nav2_branch)


# The branches of Nav2 whose nodes differ, and how a file shows of which it is.
#
# A class says for which branch it is, and a port which branch alone has it: ``nav2_branch``.

Nav2Branch = Literal['jazzy', 'main']
"""A branch of Nav2 whose nodes differ from the other's. Nodes and ports that only one has are known in both."""

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

    Nodes that only one branch has identify it. If there are none, the names of trees do: all of Nav2's own in jazzy are
    the main tree ``MainTree``, those of main have different names. Then ports that only one branch has, of Nav2's
    own nodes: a user's class that derives from one inherits them. The trees of kilted, whose nodes behave as those
    of jazzy, have its names, and some ports of main.
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


def _the_only(told: set[str]) -> str | None:
    """Return the branch, if only one is indicated."""
    branches = told & {*NAV2_BRANCHES}
    return branches.pop() if len(branches) == 1 else None


def register_branches(
    registry: NodeRegistry, node_classes: Collection[type[TreeNode]], nav2_branch: Nav2Branch
) -> None:
    """Make node classes known as they are in ``nav2_branch``, and for files of another branch as they are there.

    Of two classes of one name each is for the branch that it names, as ``nav2_branch``. One that is alone is known in
    both, and if it names a branch, a file that uses it shows that.
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

# SPDX-License-Identifier: BSD-3-Clause
"""The files for RViz and Foxglove: installed, and of topics that there are."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml
from ament_index_python.packages import get_package_share_directory

from flexbt_common.interfaces import INTERFACES, InterfaceKind

SHARE = Path(get_package_share_directory('flexbt_sim'))
TOPICS = {one.name for one in INTERFACES if one.kind is InterfaceKind.TOPIC}
CLICKED = 'clicked_point'
"""What Foxglove publishes for those who want it."""


def topics_of_rviz(node: Any) -> Iterator[str]:
    """Yield each ``Topic`` and ``Description Topic`` of a configuration."""
    for key, value in node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ():
        if str(key).endswith('Topic') and isinstance(value, dict):
            yield value['Value']
        else:
            yield from topics_of_rviz(value)


def test_rviz_shows_topics_that_there_are() -> None:
    configuration = yaml.safe_load((SHARE / 'rviz' / 'robot.rviz').read_text())
    shown = set(topics_of_rviz(configuration))
    assert len(shown) > 8
    assert shown <= TOPICS


def test_foxglove_shows_topics_that_there_are() -> None:
    layout = json.loads((SHARE / 'foxglove' / 'robot.json').read_text())
    panels = layout['configById']
    scene = panels['3D!world']
    shown = {*scene['topics'], scene['layers']['robot']['topic']}
    shown |= {value for key, value in scene['publish'].items() if key.endswith('Topic')}
    shown |= {f'/{path["value"].split(".")[0].strip("/")}' for path in panels['Plot!speed']['paths']}
    shown |= {f'/{panels[name]["path"].split(".")[0].strip("/")}' for name in panels if name.startswith('Indicator')}
    assert {topic.strip('/') for topic in shown} - {CLICKED} <= TOPICS

# SPDX-License-Identifier: BSD-3-Clause
"""The control node of Nav2 that is paused and resumed by services."""

from __future__ import annotations

from typing import Final

from flexbt_core.behavior_tree import NodeConfig, NodeStatus
from flexbt_core.behavior_tree.nodes.nav2 import pause_resume as nav2_pause

from .leaf_services import LeafServices


class PauseResumeController(nav2_pause.PauseResumeController):
    __doc__ = nav2_pause.PauseResumeController.__doc__
    __slots__ = ('__weakref__', '_offered')

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._offered = False

    def tick(self) -> NodeStatus:
        if not self._offered:
            self._offered = True
            services: LeafServices = self.services
            for port, request in (('pause_service_name', self.pause), ('resume_service_name', self.resume)):
                name = self.get_input_or(port, '')
                if name:
                    services.triggers.offer(name, request)
        return super().tick()


NODES: Final = (PauseResumeController,)

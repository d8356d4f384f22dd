# SPDX-License-Identifier: BSD-3-Clause
"""What the robot can do with things and doors. Each action ends when the sensors tell its effect."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

from std_srvs.srv import SetBool

from flexbt_common import names
from flexbt_core.behavior_tree import NodeStatus, input_port
from flexbt_core.behavior_tree.model import STRING
from flexbt_server.leaves import SERVICE_PORTS, ServiceLeaf, SubscribedTopic

from .scene import DOORS, THINGS, is_held, is_open, position_of


class _Switched(ServiceLeaf):
    """Switches something by SetBool, and waits until what it brings about is told on the topic ``tells``."""

    __slots__ = ('_cache',)

    service_type = SetBool
    wanted: ClassVar[bool] = True
    tells: ClassVar[SubscribedTopic]

    @classmethod
    def subscribes_to(cls) -> Sequence[SubscribedTopic]:
        return [cls.tells]

    def make_request(self) -> Any:
        self._cache = self.host.topics.cache(self.tells)
        self._cache.on_message(self.context)
        return SetBool.Request(data=self.wanted)

    def on_response(self, response: Any) -> NodeStatus:
        if not response.success:
            return self.fail(response.message)
        return NodeStatus.SUCCESS if self.is_done(self._cache.latest) else NodeStatus.RUNNING

    @abstractmethod
    def is_done(self, message: Any | None) -> bool:
        """Whether it is so, by the last message, or None."""


class PickUp(_Switched):
    """Picks up the thing that is nearest to the gripper, and waits until it is held."""

    __slots__ = ()

    default_service = names.GRIPPER
    tells = THINGS
    ports = SERVICE_PORTS | {'thing': input_port(STRING, description='name of the thing')}

    def is_done(self, message: Any | None) -> bool:
        return is_held(message, str(self.get_input('thing')))


class PutDown(_Switched):
    """Puts down what is in the gripper, and waits until it is seen."""

    __slots__ = ()

    default_service = names.GRIPPER
    tells = THINGS
    wanted = False
    ports = PickUp.ports

    def is_done(self, message: Any | None) -> bool:
        return position_of(message, str(self.get_input('thing'))) is not None


class OpenDoor(_Switched):
    """Has a door opened, and waits until it is."""

    __slots__ = ()

    tells = DOORS
    ports = SERVICE_PORTS | {'door': input_port(STRING, description='name of the door')}

    @property
    def service_name(self) -> str:
        return str(self.get_input_or('service_name', '') or f'simulator/doors/{self.get_input("door")}')

    def is_done(self, message: Any | None) -> bool:
        return is_open(message, str(self.get_input('door')))

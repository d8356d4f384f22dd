# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's proxy for transforms."""

from __future__ import annotations

from typing import Any

from flexbt_flexbe.errors import ProxyError
from flexbt_onboard.behaviors import RunContext

from .run_proxy import RunProxy


class _RunTransforms:
    """The buffer and the listener of a run."""

    def __init__(self, run: RunContext) -> None:
        try:
            import tf2_ros
        except ImportError as error:
            raise ProxyError(f'transforms need the package tf2_ros: {error}') from None
        runtime = run.services.runtime
        self.buffer: Any = tf2_ros.Buffer()
        self.listener: Any = runtime.call(
            lambda: tf2_ros.TransformListener(self.buffer, runtime.node, spin_thread=False)
        )
        run.at_end(lambda: runtime.call(self.listener.unregister))


class ProxyTransformListener(RunProxy):
    """Listens to transforms from its construction on. ``buffer.lookup_transform`` without a timeout does not wait."""

    def __init__(self) -> None:
        super().__init__()
        self._transforms = self._run.shared(_RunTransforms)

    @property
    def listener(self) -> Any:
        """The listener of tf2_ros."""
        return self._transforms.listener

    @property
    def buffer(self) -> Any:
        """The buffer of tf2_ros."""
        return self._transforms.buffer

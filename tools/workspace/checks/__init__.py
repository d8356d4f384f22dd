# SPDX-License-Identifier: BSD-3-Clause
"""What the workspace is checked by: `make lint`, `make test`, `make bench`."""

from . import bench, lint, test_run

__all__ = ['bench', 'lint', 'test_run']

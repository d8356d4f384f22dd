# SPDX-License-Identifier: BSD-3-Clause
"""Set-up, build, checks and tests of the workspace. Standard library only: it runs before anything is installed."""

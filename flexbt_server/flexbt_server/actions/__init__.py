# SPDX-License-Identifier: BSD-3-Clause
"""The actions and services of the BT server."""

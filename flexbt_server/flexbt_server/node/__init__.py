# SPDX-License-Identifier: BSD-3-Clause
"""The managed node bt_server and its parameters."""

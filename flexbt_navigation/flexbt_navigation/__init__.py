# SPDX-License-Identifier: BSD-3-Clause
"""Navigation servers with the interfaces of Nav2, for the simulated robot."""

# SPDX-License-Identifier: BSD-3-Clause
"""The operator's page in a browser, and its server on aiohttp."""

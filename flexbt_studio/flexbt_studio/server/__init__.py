# SPDX-License-Identifier: BSD-3-Clause
"""The studio's web server: the page, its connection, layouts, and jobs in processes of their own."""

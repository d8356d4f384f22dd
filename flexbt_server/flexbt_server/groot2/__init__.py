# SPDX-License-Identifier: BSD-3-Clause
"""What Groot2 understands: its protocol for running trees, the XML that describes them, and log files (``.btlog``)."""

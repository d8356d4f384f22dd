# SPDX-License-Identifier: BSD-3-Clause
"""From capabilities and a request to a supervised machine with a proof, or to an explanation why there is none."""

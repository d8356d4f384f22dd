# SPDX-License-Identifier: BSD-3-Clause
"""States, userdata, autonomy, and machines as written and as checked."""

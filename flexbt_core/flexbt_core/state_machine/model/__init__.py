# SPDX-License-Identifier: BSD-3-Clause
"""States, userdata, autonomy, and the definitions of machines."""

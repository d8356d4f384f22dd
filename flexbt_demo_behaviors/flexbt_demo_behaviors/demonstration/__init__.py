# SPDX-License-Identifier: BSD-3-Clause
"""What the demonstrations share: options, processes, session, scripted operator, report and picture."""

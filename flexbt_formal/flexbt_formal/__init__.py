# SPDX-License-Identifier: BSD-3-Clause
"""What an engineer runs at a desk: planning, synthesis, proofs of trees and behaviors, models of AS2FM.

Nothing that a robot runs imports this package. What a robot can use of it (the leaf ``ReachGoal``, the search of
``console synthesize``) and what it adds to ``bt_tool`` and ``behavior_tool`` come by entry points.
"""

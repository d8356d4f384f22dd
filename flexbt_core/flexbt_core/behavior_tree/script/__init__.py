# SPDX-License-Identifier: BSD-3-Clause
"""The scripting language of BehaviorTree.CPP: parser, values, interpreter."""

# SPDX-License-Identifier: BSD-3-Clause
# The commands of the workspace; the work is done by tools/workspace.sh. Each command sets up what it needs.
SHELL := /bin/sh
.DEFAULT_GOAL := help
N ?= 20000
SEED ?= 0
SECONDS ?= 300
AREA ?= nodes
MINUTES ?= 20
DEMO_3 = night_watch
DEMO_4 = nav2_robot
DEMO_5 = goals
PROJECT ?= flexbt_demo_behaviors
export PROJECT WORLD
.PHONY: help setup demo studio test fuzz mutants nemesis lint bench conformance docs clean distclean
.NOTPARALLEL:

help:  ## this text
	@echo 'FlexBT. The commands (each does the set-up by itself, and only what is missing of it):'
	@echo
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "  make %-12s %s\n", $$1, $$2 }' Makefile
	@echo
	@echo '  . tools/env.sh   a shell with everything of the workspace: bt_server, console, colcon, Python imports'
	@echo
	@echo 'ROS 2 is used when it is sourced; otherwise the PyPI wheels of ROS 2 Jazzy, in .venv.'
	@echo 'ROS_WHEELS=kilted uses those of ROS 2 Kilted, in .kilted, whatever is sourced.'
	@echo 'PYTHON=/path/to/python3.12 chooses the Python of these. The logs are in log/.'

setup:  ## install what is missing, build what has changed
	@tools/workspace.sh setup

demo:  ## the demonstration: DEMO=1 (one tree), DEMO=2 (three trees under one HFSM), DEMO=3 (two robots on night watch), DEMO=4 (a robot of Nav2), DEMO=5 (a robot that plans); scripted when not in a terminal
	@tools/workspace.sh run $(or $(DEMO_$(DEMO)),demo)

studio:  ## the studio, for the trees and machines below PROJECT=flexbt_demo_behaviors
	@tools/workspace.sh run studio "$$PROJECT"

test:  ## lint and all tests; DDS=1: also on the middleware what else runs in one process
	@tools/workspace.sh test

fuzz:  ## what reads texts of others (XML, YAML, scripts, values, commands, journals), with damaged texts for SECONDS=300; then the property tests with new examples
	@tools/workspace.sh run python3 -m flexbt_testing.fuzzing --seconds $(SECONDS)
	@FLEXBT_FUZZ=1 tools/workspace.sh run python3 -m pytest -q -m hypothesis flexbt_*/test

mutants:  ## changes of the product that no test notices (mutmut): AREA=nodes, model, engine, commands or stop, for MINUTES=20
	@tools/workspace.sh run python3 tools/mutants.py --area $(AREA) --minutes $(MINUTES) --seed $(SEED)

nemesis:  ## missions in one process under faults that a seed draws: SEEDS=100 from SEED=0 on, or only SEED=7, or MUTANTS=1 (changes of the product that the invariants have to find); WORLD=navigate, MOTION=full or abstract, SECONDS=10 of faults, JOBS=2
	@tools/workspace.sh run python3 -m flexbt_testing.one_process.nemesis $(if $(WORLD),--world "$$WORLD") $(if $(MOTION),--motion $(MOTION)) $(if $(SEEDS),--seeds $(SEEDS)) --seed $(SEED) $(if $(filter file,$(origin SECONDS)),,--seconds $(SECONDS)) --jobs $(or $(JOBS),2) $(if $(MUTANTS),--mutants)

lint:  ## ruff, mypy, the contracts of the architecture, shellcheck
	@tools/workspace.sh lint

bench:  ## the benchmarks; figures into out/bench
	@tools/workspace.sh bench

conformance:  ## the BT engine, with scripts interpreted and as Python code, against BehaviorTree.CPP, event by event: N=20000 random trees of each profile, from SEED=0 on
	@FLEXBT_ACCELERATION=0 tools/workspace.sh run python3 -m flexbt_testing.behavior_trees.conformance --count $(N) --seed $(SEED)
	@tools/workspace.sh run python3 -m flexbt_testing.behavior_trees.conformance --count $(N) --seed $(SEED)

docs:  ## the documentation as a site in out/docs/html
	@tools/workspace.sh run python3 docs/tools/build.py

clean:  ## remove what was built: build, install, log, out
	@tools/workspace.sh clean

distclean:  ## clean, and remove .venv and the caches of the tools
	@tools/workspace.sh clean --all

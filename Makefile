# SPDX-License-Identifier: Apache-2.0
# MERLIN: every target prepares what it needs (apt, venv, catkin build) and cleans up after itself.
#   make demo RTF=5 SEED=7 MISSION=1 APPROACH=merlin

RTF ?= 3
SEED ?= 1
MISSION ?= 1
APPROACH ?= merlin
CYCLES ?= 10000
ROBOT_CYCLES ?= 1100
JOINED_CYCLES ?= 1000
CANCEL_AFTER ?= 10
RECORD ?= false
GUESTS ?= 6
DISTURBANCES ?= 5
HASTE ?= 1
# Whether the page stays when the run has ended: true, false, auto: on a terminal, until a key.
LINGER ?= auto

# Else each pytest compiles what its plugins bring, again and again.
unexport PYTHONDONTWRITEBYTECODE

IN := tools/in_workspace.sh
RUN := $(IN) rosrun merlin run

.PHONY: help build imports demo experiment restaurant deliberation fleet fleet-chaos try check test repeat lint docs bench chaos chaos-table mutants pins soak screenshots film debian deb clean

help:
	@echo "make demo   Mission 1 of the paper in the simulated apartment (RTF= SEED= MISSION= APPROACH= CANCEL_AFTER= RECORD= LINGER=)"
	@echo "make experiment   Missions 1, 2, 3, naive and MERLIN, and a report (MISSION= APPROACH= RUNS= SEED= RTF= SWEEPS= WORLDS= CHECK=1)"
	@echo "make restaurant   an evening in the simulated restaurant (ROBOTS= GUESTS= DISTURBANCES= HASTE= SEED= RTF= RECORD= LINGER=)"
	@echo "make deliberation   four problems of deliberation in pyrobosim, and their table (PROBLEM= SEED= SEEDS= CANCELS= RTF= WORLD= GOALS= URGENT= KNOWN=1 PLANNER=)"
	@echo "make fleet  a fleet on this machine: a hub, robots, a link that is cut, a robot that is killed (ROBOTS=)"
	@echo "make fleet-chaos  its fault campaign (TRIALS= of each FAULT=, CLOCKS=same|apart, SEED=)"
	@echo "make try    a new application on simulated action servers: what a robot's computer runs"
	@echo "make check  lint, and the unit tests of what has changed (ALL=1: all of them; SINCE=revision)"
	@echo "make test   all that a user relies on, from a bare machine (JOBS=)"
	@echo "make repeat runs tests again and again beside a load, and prints how often each failed (TESTS= TIMES= LOAD=)"
	@echo "make bench  benchmarks"
	@echo "make chaos  the fault campaign (TRIALS= MINUTES= SEED= FAULT= MOMENT= RESPAWN=yes|no)"
	@echo "make chaos-table   its table into docs/reliability-measurements.md (RESULTS='folder folder …')"
	@echo "make mutants  which small changes of the cores no unit test notices (MODULES='pattern …' SAMPLE= SEED= MINUTES=)"
	@echo "make pins   which pinned packages of profile robot can be had for which Python and processor (PROFILE= DOCS=1)"
	@echo "make soak   10 000 cancels and interruptions, 1 000 with robots that come and go, 1 000 with requests that join, the long tests, unit tests with other random examples, mutants, an hour of faults, 3 000 goals (CYCLES= ROBOT_CYCLES= JOINED_CYCLES= MINUTES=)"
	@echo "make lint   ruff, mypy, vermin, the map of imports, tests that assert nothing, catkin_lint, roslaunch-check"
	@echo "make docs   the documents and an API reference as a site in results/docs/html, links checked"
	@echo "make screenshots  the monitor's pictures in docs/images, over a running mission"
	@echo "make film   the monitor's page while a robot of examples/deliberation solves a problem, as docs/images/deliberation.png (PROBLEM= SEED=)"
	@echo "make debian  build and demo in a bare root of another Debian (VERSION=11|12|13 TARGET='build demo test' PROFILE= PYTEST='FILE …' AS=root|user)"
	@echo "make deb    a Debian package of the install space, in results/deb (PROFILE=robot|simulation|all)"
	@echo "make imports  import every module that is built (PROFILE=), with the Python of this system"
	@echo "make build  only what the others need (PROFILE=robot|simulation|all; robot+fleet, simulation+fleet; +deliberation behind each)"

# The profile that a target needs; PROFILE=, which make passes on, may ask for more.
NEEDS = $(if $(filter-out build,$(MAKECMDGOALS)),all)
deb imports: NEEDS = $(PROFILE)
demo experiment restaurant: NEEDS = simulation
try: NEEDS = robot
deliberation: NEEDS = robot+deliberation
film: NEEDS = all+deliberation
build:
	@tools/build.sh $(NEEDS)

demo: build
	@$(RUN) home.launch mission:=$(MISSION) approach:=$(APPROACH) seed:=$(SEED) rtf:=$(RTF) \
	  cancel_after:=$(CANCEL_AFTER) record:=$(RECORD) linger:=$(LINGER) results:=$(CURDIR)/results/demo

# Only what was given narrows the experiment; the defaults above are those of the demo.
given = $(if $(filter-out file default undefined,$(origin $(1))),--$(2) $($(1)))
experiment: build
	@$(IN) python bench/experiment $(call given,MISSION,mission) $(call given,APPROACH,approach) \
	  $(call given,RUNS,runs) $(call given,SEED,seed) $(call given,RTF,rtf) $(call given,SWEEPS,sweeps) $(call given,WORLDS,worlds) \
	  $(if $(CHECK),--check) $(if $(filter true,$(RECORD)),--record) --results $(CURDIR)/results/experiment

# ROBOTS=2 or 3; one has no name.
several = $(if $(filter-out 1,$(ROBOTS)),robots:=$(shell seq -s, -f robot_%g $(ROBOTS)))
restaurant: build
	@$(RUN) restaurant.launch guests:=$(GUESTS) disturbances:=$(DISTURBANCES) haste:=$(HASTE) seed:=$(SEED) $(several) \
	  $(if $(filter-out file default undefined,$(origin RTF)),rtf:=$(RTF)) record:=$(RECORD) linger:=$(LINGER) \
	  results:=$(CURDIR)/results/restaurant

# In docs/deliberation.md: its table.
text = $(if $($(1)),--$(2) '$($(1))')
deliberation: build
	@$(IN) rosrun deliberation solve $(call given,PROBLEM,problem) $(call given,SEED,seed) $(call given,SEEDS,seeds) \
	  $(call given,CANCELS,cancels) $(call given,RTF,rtf) $(call text,WORLD,world) $(call text,GOALS,goals) \
	  $(call text,URGENT,urgent) $(call text,PLANNER,planner) $(if $(KNOWN),--known) --results $(CURDIR)/results/deliberation

fleet: build
	@$(IN) python bench/fleet $(call given,ROBOTS,robots)

try: build
	@$(IN) tools/try_robot.sh

imports: build
	@$(IN) python tools/import_all.py

# In docs/fleet-measurements.md: the table of faults.
fleet-chaos: build
	@$(IN) python bench/fleet/campaign.py $(call given,TRIALS,trials) $(call given,FAULT,faults) $(call given,CLOCKS,clocks) --seed $(SEED)

# docs/testing.md: what belongs to check, to test and to soak.
RUN_TESTS = $(IN) python -m pytest --dist loadfile --no-loadscope-reorder --progress -rs
check: build
	@$(IN) tools/check.sh $(if $(ALL),--all) $(call given,SINCE,since)

# Tests wait for processes most of the time, so there are more workers than processors.
JOBS ?= $(shell expr 3 \* $$(nproc))
test: build
	@$(RUN_TESTS) -n $(JOBS) --junitxml=results/tests.xml test

TESTS ?= test
TIMES ?= 20
LOAD ?= 0
repeat: build
	@$(IN) python tools/repeat.py --times $(TIMES) --load $(LOAD) -- -n $(JOBS) --dist loadfile --no-loadscope-reorder $(TESTS)

bench: build
	@$(IN) python bench/run.py

# What was given narrows the campaign; FAULT and MOMENT may name several, and patterns.
CHAOS = $(IN) python bench/chaos
chaos: build
	@$(CHAOS) $(call given,TRIALS,trials) $(call given,MINUTES,minutes) --seed $(SEED) \
	  $(call given,FAULT,faults) $(call given,MOMENT,moments) $(call given,RESPAWN,respawn)

# The table in docs/reliability-measurements.md, from the rows of one or more campaigns.
chaos-table: build
	@$(CHAOS) --markdown docs/reliability-measurements.md --results $(or $(RESULTS),results/chaos)

# In docs/mutants.md: the table.
mutants: build
	@$(IN) python bench/mutants $(call given,SAMPLE,sample) --seed $(SEED) $(call given,MINUTES,minutes) $(MODULES)

# docs/platforms.md; needs the network. DOCS=1 writes its table there.
pins: build
	@$(IN) python tools/pins.py $(call given,PROFILE,profile) $(if $(DOCS),--docs)

soak: build
	@CYCLES=$(CYCLES) LIMIT=20000 $(IN) python bench/run.py cancel_stress
	@CYCLES=$(ROBOT_CYCLES) SEED=$(SEED) LIMIT=20000 $(IN) python bench/run.py robots_stress
	@CYCLES=$(JOINED_CYCLES) SEED=$(SEED) LIMIT=20000 $(IN) python bench/run.py joined_stress
	@$(IN) python -m pytest -m long test
	@HYPOTHESIS_PROFILE=search $(IN) python -m pytest test/unit
	@$(IN) python tools/pins.py
	@$(IN) python bench/mutants --sample 10 --seed $(SEED)
	@$(IN) python bench/fleet/campaign.py --trials 3 --seed $(SEED)
	@$(CHAOS) --goals 3000 --results $(CURDIR)/results/chaos_soak
	@$(CHAOS) --minutes $(or $(MINUTES),60) --seed $(SEED) --results $(CURDIR)/results/chaos_soak

screenshots: build
	@$(IN) python tools/monitor_screenshots.py

film: build
	@$(IN) python tools/film.py problem:=$(or $(PROBLEM),3) seed:=$(SEED)

docs:
	@tools/docs.sh

debian:
	@VERSION=$(VERSION) TARGET="$(TARGET)" PROFILE="$(PROFILE)" PYTEST="$(PYTEST)" AS="$(AS)" ALL="$(ALL)" DEB="$(DEB)" tools/debian.sh

# What a robot's computer installs instead of a checkout: docs/platforms.md.
deb:
	@tools/build.sh --without-catkin $(NEEDS)
	@PROFILE=$(PROFILE) tools/deb.sh

lint: build
	@$(IN) tools/lint.sh

clean:
	rm -rf build devel install .venv .venv-docs src/extras src/examples src/merlin_test

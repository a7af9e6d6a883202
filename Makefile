# MERLIN: every target prepares what it needs (apt, venv, catkin build) and cleans up after itself.
#   make demo RTF=5 SEED=7 MISSION=1 APPROACH=merlin

RTF ?= 3
SEED ?= 1
MISSION ?= 1
APPROACH ?= merlin
CYCLES ?= 10000
CANCEL_AFTER ?= 10
RECORD ?= false
GUESTS ?= 6
DISTURBANCES ?= 5

IN := tools/in_workspace.sh
RUN := $(IN) rosrun merlin run

.PHONY: help build demo experiment restaurant test lint docs bench chaos chaos-table soak screenshots clean

help:
	@echo "make demo   Mission 1 of the paper in the simulated apartment (RTF= SEED= MISSION= APPROACH= CANCEL_AFTER= RECORD=)"
	@echo "make experiment   Missions 1, 2, 3, naive and MERLIN, and a report (MISSION= APPROACH= RUNS= SEED= RTF= SWEEPS= WORLDS= CHECK=1)"
	@echo "make restaurant   an evening in the simulated restaurant (GUESTS= DISTURBANCES= SEED= RTF= RECORD=)"
	@echo "make test   all tests"
	@echo "make bench  benchmarks"
	@echo "make chaos  the fault campaign (TRIALS= MINUTES= SEED= FAULT= MOMENT= RESPAWN=yes|no)"
	@echo "make chaos-table   its table into docs/reliability.md (RESULTS='folder folder …')"
	@echo "make soak   10 000 cancels and interruptions, the long tests, an hour of faults, 3 000 goals (CYCLES= MINUTES=)"
	@echo "make lint   ruff, mypy, the map of imports, catkin_lint, roslaunch-check"
	@echo "make docs   the documents and an API reference as a site in results/docs/html, links checked"
	@echo "make screenshots  the monitor's pictures in docs/images, over a running mission"
	@echo "make build  only what the others need"

build:
	@tools/build.sh

demo: build
	@$(RUN) home.launch mission:=$(MISSION) approach:=$(APPROACH) seed:=$(SEED) rtf:=$(RTF) \
	  cancel_after:=$(CANCEL_AFTER) record:=$(RECORD) results:=$(CURDIR)/results/demo

# Only what was given narrows the experiment; the defaults above are those of the demo.
given = $(if $(filter-out file default undefined,$(origin $(1))),--$(2) $($(1)))
experiment: build
	@$(IN) rosrun merlin_experiment experiment $(call given,MISSION,mission) $(call given,APPROACH,approach) \
	  $(call given,RUNS,runs) $(call given,SEED,seed) $(call given,RTF,rtf) $(call given,SWEEPS,sweeps) $(call given,WORLDS,worlds) \
	  $(if $(CHECK),--check) $(if $(filter true,$(RECORD)),--record) --results $(CURDIR)/results/experiment

restaurant: build
	@$(RUN) restaurant.launch guests:=$(GUESTS) disturbances:=$(DISTURBANCES) seed:=$(SEED) \
	  $(if $(filter-out file default undefined,$(origin RTF)),rtf:=$(RTF)) record:=$(RECORD) results:=$(CURDIR)/results/restaurant

test: build
	@$(IN) python -m pytest test

bench: build
	@$(IN) python bench/run.py

# What was given narrows the campaign; FAULT and MOMENT may name several, and patterns.
CHAOS = $(IN) python bench/chaos
chaos: build
	@$(CHAOS) $(call given,TRIALS,trials) $(call given,MINUTES,minutes) --seed $(SEED) \
	  $(call given,FAULT,faults) $(call given,MOMENT,moments) $(call given,RESPAWN,respawn)

# The table in docs/reliability.md, from the rows of one or more campaigns.
chaos-table: build
	@$(CHAOS) --markdown docs/reliability.md --results $(or $(RESULTS),results/chaos)

soak: build
	@CYCLES=$(CYCLES) LIMIT=20000 $(IN) python bench/run.py cancel_stress
	@$(IN) python -m pytest -m long test
	@$(CHAOS) --goals 3000 --results $(CURDIR)/results/chaos_soak
	@$(CHAOS) --minutes $(or $(MINUTES),60) --seed $(SEED) --results $(CURDIR)/results/chaos_soak

screenshots: build
	@$(IN) python tools/monitor_screenshots.py

docs:
	@tools/docs.sh

lint: build
	@$(IN) tools/lint.sh

clean:
	rm -rf build devel install .venv .venv-docs

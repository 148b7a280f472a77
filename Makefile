# make setup, then make demo. Everything lands in .venv; nothing outside this folder is touched.
# The steps are scripts in setup/, the pinned versions in requirements/, all else in pyproject.toml.

# Which Python; if not said, python3 or the first one here that fits.
PYTHON ?=
# What to hand to pytest.
PYTEST_ARGS ?=
# How long each target is fuzzed.
FUZZ_SECONDS ?= 60

VENV := .venv
OLDEST := .venv-oldest
VERSIONS := 3.12 3.13 3.11 3.10
OLDEST_VERSIONS := 3.12 3.11 3.10
COLCON := .colcon
BIN := $(VENV)/bin
LOCK := requirements/lock.txt

# setup/step.sh LOG "What it does" COMMAND: a line on the terminal, the rest in the log.
STEP := setup/step.sh
PIP := $(BIN)/python -m pip --disable-pip-version-check --no-input

# What a sourced ROS or another environment would mix into ours.
unexport PYTHONPATH PYTHONHOME VIRTUAL_ENV LD_LIBRARY_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE
unexport AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH
# pip's configuration may say `user = true`, which no virtual environment can do.
export PIP_USER := 0

.DEFAULT_GOAL := help
.PHONY: help setup demo test soak fuzz test-oldest lint format bench suite fit experiment colcon lock clean FORCE
FORCE:

help: ## List these targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-12s %s\n", $$1, $$2}' $(MAKEFILE_LIST)
	@echo
	@echo 'make setup PYTHON=python3.12           any Python from 3.10 to 3.13'
	@echo 'make test PYTEST_ARGS="-x -k camera"   any option of pytest'

# --- set-up ---------------------------------------------------------------------------------------
# Each step leaves a stamp in .venv and runs again when something it depends on has changed.

setup: $(VENV)/.project ## Make .venv with everything in it (the second time: at once)

# Looked at every time; changes only when the environment is made anew.
$(VENV)/.made: FORCE
	@setup/venv.sh $(VENV) "$(VERSIONS)" $(PYTHON)

$(VENV)/.wheels: $(VENV)/.made $(LOCK)
	@$(STEP) $(VENV)/log/build-tools.log "Installing the build tools" \
	    $(PIP) install --constraint $(LOCK) setuptools hatchling
	@$(STEP) $(VENV)/log/wheels.log "Installing the pinned wheels (about 300 MB; 1 to 3 minutes)" \
	    $(PIP) install --no-deps --no-build-isolation --requirement $(LOCK)
	@touch $@

# Folders are listed, too: their time changes when a file in them comes or goes.
$(VENV)/.messages: $(VENV)/.wheels $(shell find msgs) setup/messages.sh setup/wheels.cmake
	@$(STEP) $(VENV)/log/messages.log "Building the messages" setup/messages.sh $(VENV)
	@touch $@

# An editable install links to the Python code but copies what belongs in share/ and lib/.
COPIED := $(shell find config scenes bags */launch */resource */scripts */package.xml -not -name '__pycache__*')
$(VENV)/.project: $(VENV)/.messages pyproject.toml $(COPIED)
	@$(STEP) $(VENV)/log/project.log "Installing this project" \
	    $(PIP) install --no-deps --no-build-isolation --editable .
	@touch $@

# --- use ------------------------------------------------------------------------------------------

demo: setup ## Simulated robots follow a walking group: the whole system on this machine
	$(BIN)/mrs demo

bench: setup ## Measure the speed
	$(BIN)/mrs bench

experiment: setup ## Repeat the paper's experiment, simulated; its figures beside ours
	$(BIN)/mrs experiment

suite: setup ## Score the published suite step by step, into docs/suite.md (half an hour)
	$(BIN)/mrs suite .suite/test --steps --out docs/suite.md

fit: setup ## Fit the body model to the suite's train half and its variants (half an hour)
	$(BIN)/mrs simulate --suite train .suite/train
	$(BIN)/mrs simulate --suite train --variants 32 .suite/more
	$(BIN)/mrs fit .suite/train/*/ .suite/more/*/ --jobs 2 \
	    --out mrs_people_loc/mrs_people_loc/bodies/body_model.json

# --- checks ---------------------------------------------------------------------------------------

test: setup ## Run the tests
	$(BIN)/python -m pytest $(PYTEST_ARGS)

lint: setup ## Check style (ruff), types (mypy) and layers (import-linter)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache --no-logo

format: setup ## Put the style right as far as ruff can
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

soak: setup ## The long tests: a full team at work for ten minutes, and all else that takes so long
	$(BIN)/python -m pytest -m soak $(PYTEST_ARGS)

fuzz: setup ## Fuzz all that comes in (18 minutes; FUZZ_SECONDS=3600 for each of 18 targets)
	$(BIN)/python tests/fuzz/run.py all .fuzz -max_total_time=$(FUZZ_SECONDS)

test-oldest: $(OLDEST)/.installed ## Test the method alone with the oldest versions it allows
	$(OLDEST)/bin/python -m pytest tests/core tests/tools/scoring $(PYTEST_ARGS)

# Not with Python 3.13: it is younger than those versions.
$(OLDEST)/.made: FORCE
	@setup/venv.sh $(OLDEST) "$(OLDEST_VERSIONS)" \
	    $$(setup/find-python.sh "$(OLDEST_VERSIONS)" $(PYTHON) python3)

$(OLDEST)/.installed: $(OLDEST)/.made pyproject.toml $(LOCK) requirements/oldest.txt setup/oldest.sh
	@$(STEP) $(OLDEST)/log/install.log "Installing the oldest versions" setup/oldest.sh $(OLDEST)
	@touch $@

colcon: setup ## Build with colcon, as a ROS machine does, into .colcon
	setup/colcon.sh $(VENV) $(COLCON) --symlink-install
	@echo "Now:  . $(COLCON)/install/local_setup.sh"

# --- upkeep ---------------------------------------------------------------------------------------

lock: setup ## Pin the newest versions that fit together (needs all four Pythons)
	$(BIN)/python setup/lock.py

clean: ## Remove what these targets made
	rm -rf $(VENV) $(OLDEST) $(COLCON) .fuzz .hypothesis .mypy_cache .pytest_cache .ruff_cache

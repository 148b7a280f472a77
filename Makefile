# make setup, then make demo. Everything is installed into .venv; nothing outside this folder changes.
# The steps are scripts in setup/, the pinned versions in requirements/, the rest in pyproject.toml.

# The Python to use; by default python3 or the first suitable one.
PYTHON ?=
# Options for pytest.
PYTEST_ARGS ?=
# Folder of bags of real rooms (docs/real_rooms.md).
RECORDINGS ?= .recordings
# Fuzzing time per target [s].
FUZZ_SECONDS ?= 60

VENV := .venv
OLDEST := .venv-oldest
VERSIONS := 3.12 3.13 3.11 3.10
DOCS := .venv-docs
DOCS_VERSIONS := 3.12 3.13 3.11
OLDEST_VERSIONS := 3.12 3.11 3.10
COLCON := .colcon
BIN := $(VENV)/bin
LOCK := requirements/lock.txt

# setup/step.sh LOG "Description" COMMAND: one line on the terminal, the output in the log.
STEP := setup/step.sh
PIP := $(BIN)/python -m pip --disable-pip-version-check --no-input

# Variables of a sourced ROS or another environment that would interfere with ours.
unexport PYTHONPATH PYTHONHOME VIRTUAL_ENV LD_LIBRARY_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE
unexport AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH
# pip's configuration may contain `user = true`, which fails in a virtual environment.
export PIP_USER := 0

.DEFAULT_GOAL := help
.PHONY: help setup demo tour test soak fuzz test-oldest lint format bench suite localization guiding real fit experiment colcon lock release-check clean FORCE
FORCE:

help: ## List these targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-12s %s\n", $$1, $$2}' $(MAKEFILE_LIST)
	@echo
	@echo 'make setup PYTHON=python3.12           any Python from 3.10 to 3.13'
	@echo 'make test PYTEST_ARGS="-x -k camera"   any option of pytest'

# --- set-up ---------------------------------------------------------------------------------------
# Each step leaves a stamp in .venv and is repeated when one of its dependencies has changed.

setup: $(VENV)/.project ## Make .venv with everything in it (at once if up to date)

# Checked every time; changes only when the environment is created again.
$(VENV)/.made: FORCE
	@setup/venv.sh $(VENV) "$(VERSIONS)" $(PYTHON)

$(VENV)/.wheels: $(VENV)/.made $(LOCK)
	@$(STEP) $(VENV)/log/build-tools.log "Installing the build tools" \
	    $(PIP) install --constraint $(LOCK) setuptools hatchling
	@$(STEP) $(VENV)/log/wheels.log "Installing the pinned wheels (about 300 MB; 1 to 3 minutes)" \
	    $(PIP) install --no-deps --no-build-isolation --requirement $(LOCK)
	@touch $@

# Folders are listed, too: their time changes when a file in them is added or removed.
$(VENV)/.messages: $(VENV)/.wheels $(shell find msgs) setup/messages.sh setup/wheels.cmake
	@$(STEP) $(VENV)/log/messages.log "Building the messages" setup/messages.sh $(VENV)
	@touch $@

# An editable install links to the Python code but copies the files of share/ and lib/.
COPIED := $(shell find $(addprefix mrs_people_loc/,config scenes bags) */launch */resource */scripts */package.xml -not -name '__pycache__*')
$(VENV)/.project: $(VENV)/.messages pyproject.toml $(COPIED)
	@$(STEP) $(VENV)/log/project.log "Installing this project" \
	    $(PIP) install --no-deps --no-build-isolation --editable .
	@touch $@

# --- use ------------------------------------------------------------------------------------------

demo: setup ## Run the whole system: robots follow a walking group
	$(BIN)/mrs demo

tour: setup ## Guide a simulated group: rendered heads, real processes
	$(BIN)/mrs tour --simulate

bench: setup ## Compare with tests/oracle, then measure speed
	$(BIN)/mrs bench

experiment: setup ## Repeat the paper's experiment in simulation
	$(BIN)/mrs experiment

suite: setup ## Score the suite step by step, into docs/suite.md (30 min)
	$(BIN)/mrs suite .suite/test --steps --out docs/suite.md

localization: setup ## Score poses on simulated tours, into docs/
	$(BIN)/mrs localization --out docs/localization_results.md

guiding: setup ## Score simulated guided tours, into docs/ (30 min)
	$(BIN)/mrs guiding --out docs/guiding_results.md

real: setup ## Score real rooms in RECORDINGS=DIR, into docs/real_rooms.md
	$(BIN)/mrs real "$(RECORDINGS)" --out docs/real_rooms.md

fit: setup ## Fit the body model to suite and variants, and RECORDINGS=DIR
	$(BIN)/mrs simulate --suite train .suite/train
	$(BIN)/mrs simulate --suite train --variants 12 .suite/more
	$(BIN)/mrs fit .suite/train/*/ .suite/more/*/ --jobs 2 \
	    $(if $(wildcard $(RECORDINGS)),--real "$(RECORDINGS)") \
	    --out mrs_people_loc/mrs_people_loc/bodies/body_model.json

# --- checks ---------------------------------------------------------------------------------------

test: setup ## Run the tests
	$(BIN)/python -m pytest $(PYTEST_ARGS)

lint: setup ## Check style, types, layers (import-linter), workflows, Docker
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache --no-logo
	$(BIN)/check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/*.yaml
	$(BIN)/check-jsonschema --builtin-schema vendor.compose-spec compose.yaml
	$(BIN)/check-jsonschema --builtin-schema vendor.citation-file-format CITATION.cff
	$(BIN)/zizmor --offline --quiet --no-progress .github
	$(BIN)/hadolint Dockerfile

format: setup ## Fix the style as far as ruff can
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

soak: setup ## Run the long tests, of ten minutes and more
	$(BIN)/python -m pytest -m soak $(PYTEST_ARGS)

fuzz: setup ## Fuzz all inputs (27 targets, FUZZ_SECONDS=60 for each)
	$(BIN)/python tests/fuzz/run.py all .fuzz -max_total_time=$(FUZZ_SECONDS)

test-oldest: $(OLDEST)/.installed ## Test the core with the oldest supported dependencies
	$(OLDEST)/bin/python -m pytest tests/core tests/tools/scoring $(PYTEST_ARGS)

# Not with Python 3.13, which is newer than those versions.
$(OLDEST)/.made: FORCE
	@setup/venv.sh $(OLDEST) "$(OLDEST_VERSIONS)" \
	    $$(setup/find-python.sh "$(OLDEST_VERSIONS)" $(PYTHON) python3)

$(OLDEST)/.installed: $(OLDEST)/.made pyproject.toml $(LOCK) requirements/oldest.txt setup/oldest.sh
	@$(STEP) $(OLDEST)/log/install.log "Installing the oldest versions" setup/oldest.sh $(OLDEST)
	@touch $@

.PHONY: docs
docs: $(DOCS)/.installed ## Build the documentation site into .site/html
	$(DOCS)/bin/python setup/docs.py

# Not with Python 3.10, which Zensical does not support.
$(DOCS)/.made: FORCE
	@setup/venv.sh $(DOCS) "$(DOCS_VERSIONS)" \
	    $$(setup/find-python.sh "$(DOCS_VERSIONS)" $(PYTHON) python3)

$(DOCS)/.installed: $(DOCS)/.made requirements/docs.txt
	@$(STEP) $(DOCS)/log/install.log "Installing the tools of the documentation" \
	    $(DOCS)/bin/python -m pip --disable-pip-version-check --no-input \
	    install --no-deps --requirement requirements/docs.txt
	@touch $@

colcon: setup ## Build with colcon, as with an installed ROS, into .colcon
	setup/colcon.sh $(VENV) $(COLCON) --symlink-install
	@echo "Now:  . $(COLCON)/install/local_setup.sh"

# --- upkeep ---------------------------------------------------------------------------------------

lock: setup ## Pin the newest compatible versions (needs all four Pythons)
	$(BIN)/python setup/lock.py

release-check: setup ## Say what a release still lacks
	$(BIN)/python setup/release_check.py

clean: ## Remove everything that these targets made
	rm -rf $(VENV) $(OLDEST) $(DOCS) $(COLCON) .site .fuzz .hypothesis .mypy_cache .pytest_cache .ruff_cache

# make setup, then make demo. Everything is installed into .venv; nothing outside this folder changes.
# The steps are scripts in setup/, the pinned versions in requirements/, the rest in pyproject.toml.

# The Python to use; by default python3 or the first suitable one.
PYTHON ?=
# Options for pytest.
PYTEST_ARGS ?=
# Folder of bags of real rooms (docs/real_rooms.md).
RECORDINGS ?= .recordings
# Folder of public pictures (docs/rooms.md).
PICTURES ?= .pictures
# Tests at the same time: those of nodes mostly wait, so more than there are processors.
WORKERS ?= $(shell n=$$(nproc); echo $$((n < 4 ? 5 * n / 2 : 8)))
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
GROUPS := sim test lint fuzz

# setup/step.sh LOG "Description" COMMAND: one line on the terminal, the output in the log.
STEP := setup/step.sh
UV := $(BIN)/uv pip install --python $(BIN)/python

# Variables of a sourced ROS or another environment that would interfere with ours.
unexport PYTHONPATH PYTHONHOME VIRTUAL_ENV LD_LIBRARY_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE
unexport AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH
# As bytecode each module is compiled once, and not by every process.
unexport PYTHONDONTWRITEBYTECODE
# pip's configuration may contain `user = true`, which fails in a virtual environment.
export PIP_USER := 0

.DEFAULT_GOAL := help
.PHONY: help setup demo tour test test-all test-all-parallel test-alone soak fuzz test-oldest lint format bench suite localization guiding real rooms fit experiment colcon lock release-check clean FORCE
FORCE:

help: ## List these targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-12s %s\n", $$1, $$2}' $(MAKEFILE_LIST)
	@echo
	@echo 'make setup PYTHON=python3.12           any Python from 3.10 to 3.13'
	@echo 'make test PYTEST_ARGS="-x -k camera"   any option of pytest'

# --- set-up ---------------------------------------------------------------------------------------
# Each step leaves a stamp in .venv and is repeated when one of its dependencies has changed.

setup: $(VENV)/.lint $(VENV)/.fuzz ## Make .venv with everything in it (at once if up to date)

# Checked every time; changes only when the environment is created again.
$(VENV)/.made: FORCE
	@setup/venv.sh $(VENV) "$(VERSIONS)" $(PYTHON)

$(VENV)/.wheels: $(VENV)/.made $(LOCK) setup/install.sh
	@$(STEP) $(VENV)/log/wheels.log "Installing the pinned wheels (about 200 MB)" \
	    setup/install.sh $(VENV)
	@touch $@

# Folders are listed, too: their time changes when a file in them is added or removed.
$(VENV)/.messages: $(VENV)/.wheels $(shell find msgs) $(wildcard setup/*.cmake) setup/messages.sh
	@$(STEP) $(VENV)/log/messages.log "Building the messages" setup/messages.sh $(VENV)
	@touch $@

# An editable install links to the Python code but copies the files of share/ and lib/.
COPIED := $(shell find config bags simulation/pyproject.toml */launch */resource */scripts */package.xml -not -name '__pycache__*')
$(VENV)/.project: $(VENV)/.messages pyproject.toml $(COPIED)
	@$(STEP) $(VENV)/log/project.log "Installing this project" \
	    $(UV) --no-cache --no-deps --no-build-isolation --editable . --editable simulation
	@touch $@

# What only simulations, tests, checks and fuzzing need: groups of the lock.
$(VENV)/.test: $(VENV)/.sim
$(VENV)/.lint $(VENV)/.fuzz: $(VENV)/.test
$(GROUPS:%=$(VENV)/.%): $(VENV)/.%: $(VENV)/.project
	@$(STEP) $(VENV)/log/$*.log "Installing the pinned wheels of group $*" \
	    setup/install.sh $(VENV) $*
	@touch $@

# --- use ------------------------------------------------------------------------------------------

demo: $(VENV)/.project ## Run the whole system: robots follow a walking group
	$(BIN)/mrs demo

tour: $(VENV)/.sim ## Guide a simulated group: rendered heads, real processes
	$(BIN)/mrs tour --simulate

bench: $(VENV)/.sim ## Compare with tests/oracle, then measure speed
	$(BIN)/mrs bench

experiment: $(VENV)/.sim ## Repeat the paper's experiment in simulation
	$(BIN)/mrs experiment

suite: $(VENV)/.sim ## Score the suite step by step, into docs/suite.md (30 min)
	$(BIN)/mrs suite .suite/test --steps --out docs/suite.md

localization: $(VENV)/.sim ## Score poses on simulated tours, into docs/
	$(BIN)/mrs localization --out docs/localization_results.md

guiding: $(VENV)/.sim ## Score simulated guided tours, into docs/ (30 min)
	$(BIN)/mrs guiding --out docs/guiding_results.md

real: $(VENV)/.sim ## Score real rooms in RECORDINGS=DIR, into docs/real_rooms.md
	$(BIN)/mrs real "$(RECORDINGS)" --out docs/real_rooms.md

rooms: $(VENV)/.sim ## Count people in rooms without any in PICTURES=DIR, into docs/
	$(BIN)/mrs rooms "$(PICTURES)" --out docs/rooms.md

fit: $(VENV)/.sim ## Fit the body model to suite and variants, RECORDINGS=DIR, PICTURES=DIR
	$(BIN)/mrs render-suite train .suite/train
	$(BIN)/mrs render-suite train .suite/more --variants 12
	$(BIN)/mrs fit .suite/train/*/ .suite/more/*/ --jobs 2 \
	    $(if $(wildcard $(RECORDINGS)),--real "$(RECORDINGS)") \
	    $(if $(wildcard $(PICTURES)),--rooms "$(PICTURES)") \
	    --out mrs_people_loc/mrs_people_loc/bodies/body_model.json

# --- checks ---------------------------------------------------------------------------------------

# A file is one worker's. Threads of linear algebra would only wait for those of the other workers.
PARALLEL := OMP_NUM_THREADS=1 $(BIN)/python -m pytest --numprocesses $(WORKERS) \
    --dist loadfile --no-loadscope-reorder

test: $(VENV)/.test ## Run the quick tests, of every layer (5 min)
	$(PARALLEL) -m "not slow and not alone" $(PYTEST_ARGS)

# One part after the other, with -j, too.
test-all: $(VENV)/.test ## Run all tests but those of `make soak` (19 min)
	@$(MAKE) --no-print-directory test-all-parallel
	@$(MAKE) --no-print-directory test-alone

test-all-parallel: $(VENV)/.test
	$(PARALLEL) -m "not alone" $(PYTEST_ARGS)

test-alone: $(VENV)/.test
	$(BIN)/python -m pytest -m alone $(PYTEST_ARGS)

lint: $(VENV)/.lint ## Check style, types, layers (import-linter), workflows, Docker
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache --no-logo
	$(BIN)/check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/*.yaml
	$(BIN)/check-jsonschema --builtin-schema vendor.compose-spec compose.yaml
	$(BIN)/check-jsonschema --builtin-schema vendor.citation-file-format CITATION.cff
	$(BIN)/zizmor --offline --quiet --no-progress .github
	$(BIN)/hadolint Dockerfile

format: $(VENV)/.lint ## Fix the style as far as ruff can
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

soak: $(VENV)/.test ## Run the long tests, of ten minutes and more
	$(BIN)/python -m pytest -m soak $(PYTEST_ARGS)

fuzz: $(VENV)/.fuzz ## Fuzz all inputs (28 targets, FUZZ_SECONDS=60 for each)
	$(BIN)/python tests/fuzz/run.py all .fuzz -max_total_time=$(FUZZ_SECONDS)

test-oldest: $(OLDEST)/.installed ## Test the core with the oldest supported dependencies
	$(OLDEST)/bin/python -m pytest tests/core tests/simulation/scoring $(PYTEST_ARGS)

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

colcon: $(VENV)/.test ## Build with colcon, as with an installed ROS, into .colcon
	setup/colcon.sh $(VENV) $(COLCON) --symlink-install
	@echo "Now:  . $(COLCON)/install/local_setup.sh"

# --- upkeep ---------------------------------------------------------------------------------------

lock: $(VENV)/.project ## Pin the newest compatible versions (needs all four Pythons)
	$(BIN)/python setup/lock.py

release-check: $(VENV)/.project ## Say what a release still lacks
	$(BIN)/python setup/release_check.py

clean: ## Remove everything that these targets made
	rm -rf $(VENV) $(OLDEST) $(DOCS) $(COLCON) .site .fuzz .hypothesis .mypy_cache .pytest_cache .ruff_cache

# make setup, then make demo. Everything lands in .venv; nothing outside this folder is touched.
# The steps are in setup/, the versions in requirements/, the rest in pyproject.toml.

# Any Python from 3.10 to 3.13:  make setup PYTHON=python3.12
PYTHON ?= python3
# make test PYTEST_ARGS="-k camera -x"
PYTEST_ARGS ?=

VENV := .venv
BIN := $(VENV)/bin
STEP := setup/step.sh
LOGS := $(VENV)/log
PIP := $(BIN)/python -m pip --disable-pip-version-check --no-input
LOCK := requirements/lock.txt

# What a sourced ROS, another environment or pip's configuration would mix into ours.
unexport PYTHONPATH PYTHONHOME AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH
unexport LD_LIBRARY_PATH VIRTUAL_ENV _ROS_WHEELS_BOOTSTRAP_COMPLETE
export PIP_USER := 0

.DEFAULT_GOAL := help
.PHONY: help setup demo test test-oldest lint format bench colcon lock clean FORCE
FORCE:

help: ## List these targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-12s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

# --- set-up: each step leaves a stamp in .venv and runs again when what it depends on changed ------

setup: $(VENV)/.project ## Make .venv with everything in it (the second time: at once)

# Looked at every time; changes only when the environment is made anew.
$(VENV)/.made: FORCE
	@setup/venv.sh $(VENV) "$(PYTHON)" $(if $(filter file,$(origin PYTHON)),,asked)

$(VENV)/.wheels: $(VENV)/.made $(LOCK)
	@$(STEP) $(LOGS)/build-tools.log "Installing the build tools" \
	    $(PIP) install -c $(LOCK) setuptools hatchling
	@$(STEP) $(LOGS)/wheels.log "Installing the pinned wheels (ROS, OpenCV, ...)" \
	    $(PIP) install --no-deps --no-build-isolation -r $(LOCK)
	@touch $@

# Folders are listed, too: their time changes when a file in them is added or removed.
$(VENV)/.messages: $(VENV)/.wheels $(shell find msgs) setup/messages.sh setup/wheels.cmake
	@$(STEP) $(LOGS)/messages.log "Building the messages" setup/messages.sh $(VENV)
	@touch $@

# An editable install links the Python code but copies what goes to share/ and lib/.
COPIED := $(shell find config */launch */resource */scripts */package.xml -not -path '*/__pycache__*')
$(VENV)/.project: $(VENV)/.messages pyproject.toml $(COPIED)
	@$(STEP) $(LOGS)/project.log "Installing this project" \
	    $(PIP) install --no-deps --no-build-isolation --editable .
	@touch $@

# --- use -------------------------------------------------------------------------------------------

demo: setup ## Three simulated robots find people: the whole system on this machine
	$(BIN)/mrs demo

test: setup ## Run the tests (PYTEST_ARGS="...")
	$(BIN)/python -m pytest $(PYTEST_ARGS)

lint: setup ## ruff and mypy
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy

bench: setup ## Measure the method's speed
	$(BIN)/mrs bench

clean: ## Remove what these targets made
	rm -rf .venv .venv-oldest .colcon .mypy_cache .ruff_cache .pytest_cache .hypothesis

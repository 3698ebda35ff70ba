# make run     the whole pipeline on new chairs with the shipped checkpoints, ending with a table and a report
# make test    style and tests
# make check   the same, and types
# make docs    the documents as a site, in site/
# make mutation  changes what numbers rest on, line by line, and lists what no test notices (hours)
# Each makes its own virtual environment first, once; it needs python3 with venv, and a package index.

PYTHON ?= python3
VENV ?= .venv
TASK ?= sit-chair
# How much `make run` does, if not the usual: smoke (only shows that every stage works), default or full.
PROFILE ?=
# Anything else for the command, such as ARGS="--train --workdir out".
ARGS ?=
# The CPU build of torch: from where pip looks anyway, or else from TORCH_INDEX. For a GPU: make setup TORCH=torch==2.13.0 TORCH_INDEX=https://pypi.org/simple
TORCH ?= torch==2.13.0+cpu
TORCH_INDEX ?= https://download.pytorch.org/whl/cpu
# Processes that run the tests: one more than two cores, for many tests wait for programs of their own.
JOBS ?= 3

BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --constraint constraints.txt
READY := $(VENV)/.ready
INSTALLING := $(VENV)/.installing

.PHONY: help setup run test check docs mutation format lint type clean

help:
	@grep -E '^# make' Makefile | cut -c3-

setup: $(READY)

run: $(READY)
	@echo "Running $(TASK) end to end; if it is stopped, the same command goes on from there"
	$(BIN)/mimicbench run --task $(TASK) $(if $(PROFILE),--profile $(PROFILE)) $(ARGS)

test: lint
	@echo "Running the tests on $(JOBS) processes"
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest --numprocesses $(JOBS) --dist worksteal

check: type test

docs: $(READY)
	@echo "Building the documents into site/"
	@$(PIP) --editable ".[docs]"
	$(BIN)/python -m mkdocs build --strict --quiet
	@echo "Open site/index.html"

mutation: $(READY)
	@echo "Changing what numbers rest on, line by line: what survives, no test has noticed"
	OMP_NUM_THREADS=1 $(BIN)/python scripts/mutate.py $(ARGS)

format: $(READY)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

lint: $(READY)
	@echo "Checking style"
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

# pyright fetches its own program from the npm registry when it first runs.
type: $(READY)
	@echo "Checking types"
	$(BIN)/pyright --pythonpath $(BIN)/python

clean:
	rm -rf .pytest_cache .ruff_cache .hypothesis build dist site

# An installation that was killed is thrown away and made again; a finished one is brought up to date.
$(READY): pyproject.toml constraints.txt
	@if [ -e $(INSTALLING) ]; then echo "Removing the unfinished $(VENV)"; rm -rf $(VENV); fi
	@echo "Setting up $(VENV) with $(TORCH); this takes some minutes, once"
	@$(PYTHON) -m venv $(VENV) && touch $(INSTALLING) && rm -f $(READY)
	@$(PIP) --no-deps "$(TORCH)" 2>/dev/null \
		|| $(PIP) --no-deps --index-url $(TORCH_INDEX) "$(TORCH)" \
		|| { echo "No $(TORCH) at $(TORCH_INDEX): taking torch from the package index"; $(PIP) torch; }
	@echo "Installing mimicbench and what it needs"
	@$(PIP) --editable ".[dev]"
	@touch $(READY) && rm -f $(INSTALLING)

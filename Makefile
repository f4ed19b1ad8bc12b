# Everything sets itself up in .venv beside the code: Python 3.11 or newer and make are all that is needed.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

.PHONY: demo test quick lint bench clean

demo: $(READY)          ## the main job: design, check on the nonlinear plant, report in demo/
	$(BIN)/ehsa-ctrl run --out demo --force

test: $(READY)          ## all tests
	$(BIN)/python -m pytest -n auto

quick: $(READY)         ## the tests that take less than two minutes together
	$(BIN)/python -m pytest -n auto -m "not slow"

lint: $(READY)          ## style and types
	$(BIN)/ruff check .
	$(BIN)/mypy

bench: $(READY)         ## the engine beside its peers
	$(BIN)/pip install --quiet --disable-pip-version-check -e ".[bench]"
	$(BIN)/python benchmarks/engine.py

clean:
	rm -rf $(VENV) demo results

# Installed once; again only when what is to be installed has changed.
$(READY): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev]"
	@touch $@

# Every target installs into .venv first; only Python 3.11 to 3.13 and make are needed.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
# A worker keeps neighbouring tests, which share fixtures, until the other one has nothing left to do.
TEST := $(BIN)/python -m pytest -n auto --dist worksteal
VERSIONS := 3.11 3.12 3.13

# The matrices are small: threads of the linear algebra only slow each other down.
export OPENBLAS_NUM_THREADS ?= 1

# Start values of the demo's identification, 30 % off.
WRONG := --set J_M=4.3e-4 --set A_FM=0.56 --set B_FM=1.76e-3 --set V_10=2.67e-3 --set A_FR=598 --set B_FR=11900

.PHONY: demo test quick coverage versions lint docs bench withheld clean

demo: $(READY)          ## the main job: log, identify, design, check on the nonlinear plant, reports in demo/
	$(BIN)/ehsa-ctrl simulate ehsa --excitation noise --amplitude 3 --duration 20 --centre --out demo/noise --force
	$(BIN)/ehsa-ctrl simulate ehsa --excitation steps --duration 10 --centre --seed 1 --out demo/steps --force
	$(BIN)/ehsa-ctrl identify demo/noise/log.csv --plant ehsa --validate demo/steps/log.csv $(WRONG) --out demo/rig --force
	$(BIN)/ehsa-ctrl run steps_spring slow_sine force_step --controller pid_position,lqr_friction --plant demo/rig/ehsa_identified.toml --out demo --force
	$(BIN)/ehsa-ctrl report demo --force

test: $(READY)          ## all tests; ARGS goes to pytest
	$(TEST) $(ARGS)

quick: $(READY)         ## the tests that take about a minute together
	$(TEST) -m "not slow" $(ARGS)

coverage:               ## the quick tests with the coverage floor of pyproject.toml, which doubles their time
	$(MAKE) quick ARGS="--cov --cov-report=term:skip-covered"

versions:               ## the quick tests with each supported Python on the PATH, each in a separate environment
	@for version in $(VERSIONS); do \
	    if ! python$$version -c '' 2>/dev/null; then echo "Python $$version: not found, not tested"; continue; fi; \
	    echo "Python $$version:"; \
	    $(MAKE) --no-print-directory quick PYTHON=python$$version VENV=.venv-$$version || exit 1; \
	done

lint: $(READY)          ## style and types
	$(BIN)/ruff check .
	$(BIN)/mypy

docs: $(READY)          ## the documentation site, in site/; a warning is an error
	$(BIN)/pip install --quiet --disable-pip-version-check -e ".[docs]"
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

bench: $(READY)         ## the engine compared with its peers, identification of known plants
	$(BIN)/pip install --quiet --disable-pip-version-check -e ".[bench]"
	$(BIN)/python benchmarks/engine.py
	$(BIN)/python benchmarks/identification.py --seeds 40

# An hour or two on two cores; continues after an interruption.
withheld: $(READY)      ## the diagnosis on an independent bench with withheld effects
	$(BIN)/python benchmarks/withheld/cases.py --set reported --count 300 --out results/withheld/reported
	$(BIN)/python benchmarks/withheld/score.py results/withheld/reported --jobs 2

clean:
	rm -rf $(VENV) $(VENV)-3.* demo results site

# Installed once, and again when pyproject.toml has changed.
$(READY): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev]"
	@touch $@

# Each target first sets up .venv by itself: a Python of 3.11 or newer is all it needs. Another interpreter: make PYTHON=/path/to/python test

PYTHON ?= $(shell for python in python3.13 python3.12 python3.11 python3; do \
	"$$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo "$$python" && break; done)
VENV := .venv
BIN := $(VENV)/bin
# Python's warnings are about how the project is packaged, for those who package it.
PIP_INSTALL := PYTHONWARNINGS=ignore $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt
# Parallel tests share the cores among processes; a pool of threads in each would only fight for them.
TEST_PROCESSES ?= 2
SINGLE_THREADED := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 NUMBA_NUM_THREADS=1

# By pip it takes a minute to compile all modules, of which few are imported: each is compiled, and kept, when it is.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: demo test check docs bench bench-gap setup clean

demo: setup
	$(BIN)/sensorless demo --out runs/demo

test: setup
	$(SINGLE_THREADED) $(BIN)/python -m pytest -m "not slow" -n $(TEST_PROCESSES) --dist worksteal

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: $(VENV)/.docs
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs docs/_build/html
	@echo "docs/_build/html/index.html"

bench: setup
	@for script in benchmarks/*.py; do echo "== $$script"; $(BIN)/python "$$script" || exit 1; done

bench-gap: $(VENV)/.bench
	$(SINGLE_THREADED) $(BIN)/python -m comparisons.hidden_effects.benchmark --suite small --jobs $(TEST_PROCESSES) --out runs/bench-gap

setup: $(VENV)/.installed

clean:
	rm -rf $(VENV) docs/_build .mypy_cache .ruff_cache .pytest_cache

# The pip that comes with a Python may be years old, and takes twice as long to find out what is needed.
# Debian keeps ensurepip in a package of its own; where it is missing, the interpreter's own pip fills the new environment.
$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "error: no Python 3.11 or newer, on the PATH, install one or call make PYTHON=..." >&2; exit 1; }
	@if "$(PYTHON)" -c "import ensurepip" 2>/dev/null; then "$(PYTHON)" -m venv $(VENV); \
	elif "$(PYTHON)" -m pip --version >/dev/null 2>&1; then \
		"$(PYTHON)" -m venv --without-pip $(VENV) && "$(PYTHON)" -m pip --python $(BIN)/python install --quiet pip; \
	else echo "error: $(PYTHON) has neither ensurepip nor pip, on this machine, install the package python3-venv" >&2; exit 1; fi
	@$(PIP_INSTALL) --upgrade pip

$(VENV)/.installed: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP_INSTALL) -e ".[learned,test,check]"
	@touch $@

$(VENV)/.bench: $(VENV)/.installed
	$(PIP_INSTALL) -e ".[bench,cluster]"
	@touch $@

$(VENV)/.docs: $(VENV)/.installed
	$(PIP_INSTALL) -e ".[docs]"
	@touch $@

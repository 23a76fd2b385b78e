# Needs make and Python 3.11 to 3.13 and nothing else: all is installed into .venv.
# A Python of another name: make demo PYTHON=python3.12
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Exact versions from the lock, of the build tool too: no isolated build with whatever is newest.
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt

.PHONY: demo test check bench install clean

demo: $(VENV)/installed
	$(BIN)/beemap map data/office -o demo-map --force
	$(BIN)/beemap evaluate path demo-map/trajectory.tum demo-map/truth.tum
	$(BIN)/beemap evaluate map demo-map data/office/truth/seen.yaml
	@echo "The map: demo-map/map.png"

test: $(VENV)/installed-dev
	$(BIN)/python -m pytest -n auto --dist loadfile

check: $(VENV)/installed-dev
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pyright

# Writes what it measures to BENCHMARK.md; the figures of the experiments to docs/experiments.
bench: $(VENV)/installed-dev
	$(BIN)/python -m benchmarks BENCHMARK.md

install: $(VENV)/installed

clean:
	rm -rf $(VENV) demo-map build *.egg-info .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(BIN)/pip:
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null || { \
	  echo "beemap needs Python 3.11 to 3.13; '$(PYTHON)' is $$($(PYTHON) --version 2>&1 | tail -n 1):" \
	    "name another one, as in 'make demo PYTHON=python3.12'" >&2; exit 2; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: pyproject.toml constraints.txt | $(BIN)/pip
	@echo "Installing into $(VENV) (1.4 GB, a minute or two) ..."
	$(INSTALL) setuptools
	$(INSTALL) --no-build-isolation -e .
	@touch $@

$(VENV)/installed-dev: $(VENV)/installed
	$(INSTALL) --no-build-isolation -e '.[dev]'
	@touch $@

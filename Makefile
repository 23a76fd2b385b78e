# Needs make and Python 3.11 to 3.14 and nothing else: all is installed into .venv; what the system
# must bring is looked for before that (.ci/system).
# A Python of another name: make demo PYTHON=python3.12
export PYTHON
VENV := .venv
NEWEST := .venv-newest
BIN := $(VENV)/bin
ROUNDS ?= 20

.PHONY: demo test test-newest fuzz check bench install clean

demo: $(VENV)/installed
	$(BIN)/beemap map data/office -o demo-map --force
	$(BIN)/beemap evaluate path demo-map/trajectory.tum demo-map/truth.tum
	$(BIN)/beemap evaluate map demo-map data/office/truth/seen.yaml
	@echo "The map: demo-map/map.png"

test: $(VENV)/installed-dev
	$(BIN)/python -m pytest -n auto --dist loadfile

# The same tests with the newest versions of everything instead of those in the lock.
test-newest:
	@NEWEST=1 sh .ci/install $(NEWEST) dev
	$(NEWEST)/bin/python -m pytest -n auto --dist loadfile

# The property tests with new examples in every round; `make test` has the same ones every time.
fuzz: $(VENV)/installed-dev
	for round in $$(seq $(ROUNDS)); do \
	  $(BIN)/python -m pytest -m hypothesis --hypothesis-profile=fuzz -n auto --dist loadfile || exit; \
	done

check: $(VENV)/installed-dev
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pyright

# Writes what it measures to BENCHMARK.md; the figures of the experiments to docs/experiments.
bench: $(VENV)/installed-dev
	$(BIN)/python -m benchmarks BENCHMARK.md

install: $(VENV)/installed

clean:
	rm -rf $(VENV) $(NEWEST) demo-map build *.egg-info .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(VENV)/installed: pyproject.toml constraints.txt
	@sh .ci/install $(VENV)

$(VENV)/installed-dev: $(VENV)/installed
	@sh .ci/install $(VENV) dev

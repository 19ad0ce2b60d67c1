# make run   install what identification needs, identify the bundled log into report/
# make test  install everything, lint, run the suite; make test-long the few tests that take longest
# make docs  build the documentation site into build/site/index.html
# make mutants  plant faults and see which the fast tests notice (FAULTS of them; 200 take 10 min)
# make bench-check  fail where the environments are 30 % slower than docs/benchmarks/speed.json says
# make fuzz  spoil good files in N ways (20 000 if left) and see that every reader copes
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

# Small matrix products: threads of two processes that wait for each other take up to a thousand
# times as long as one thread alone.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1

.PHONY: run test test-long mutants bench-check fuzz lint docs clean

run: $(VENV)/.base
	$(BIN)/youbot identify --out report/identified.yaml --report report

# Tests of the page drive Debian's chromium; where there is none they say so and are skipped.
test: $(VENV)/.all lint
	$(BIN)/python -m pytest -n 2 -m "not long"

test-long: $(VENV)/.all
	$(BIN)/python -m pytest -n 2 -m long

FAULTS ?= 200
mutants: $(VENV)/.all
	$(BIN)/python -m pip install --quiet -c constraints.txt -e ".[mutants]"
	$(BIN)/python tests/mutation.py --sample $(FAULTS) --json docs/benchmarks/mutants.json

bench-check: $(VENV)/.base
	$(BIN)/youbot benchmark speed --check docs/benchmarks/speed.json

N ?= 20000
SEED ?= 0
fuzz: $(VENV)/.all
	cd tests && PYTHONWARNINGS=ignore ../$(BIN)/python -m fuzz --cases $(N) --seed $(SEED)

lint: $(VENV)/.all
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/codespell
	$(BIN)/ty check

# The pages first, so that what builds the site finds nothing but Markdown; a warning is an error.
docs: $(VENV)/.docs
	$(BIN)/python docs/site_pages.py build/pages
	$(BIN)/zensical build --config-file mkdocs.yml --strict --clean
	@echo "build/site/index.html; with search: python -m http.server --directory build/site"

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip

$(VENV)/.base: pyproject.toml constraints.txt | $(BIN)/python
	@echo "installing (the first time this takes a minute or two) ..."
	$(BIN)/python -m pip install --quiet -c constraints.txt -e .
	@touch $@

# torch first and by its exact version: left to the resolver it may bring gigabytes of GPU packages.
$(VENV)/.all: pyproject.toml constraints.txt | $(BIN)/python
	@echo "installing everything (the first time this takes some minutes) ..."
	$(BIN)/python -m pip install --quiet torch==2.13.0
	$(BIN)/python -m pip install --quiet -c constraints.txt -e ".[rollers,bags,rl,cluster,workbench,dev]"
	@touch $@ $(VENV)/.base

$(VENV)/.docs: pyproject.toml constraints.txt | $(BIN)/python
	$(BIN)/python -m pip install --quiet -c constraints.txt -e ".[rollers,docs]"
	@touch $@ $(VENV)/.base

clean:
	rm -rf $(VENV) report build

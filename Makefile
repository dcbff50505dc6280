# `make demo` and `make test` do all set-up themselves; they need make and Python 3.11 or newer.
# Another Python: make PYTHON=python3.12

PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python3.11; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
VENV := .venv
SEEDS ?= 20
INPUTS ?= 1000000
ROUNDS ?= 20
ONLY ?=
DATA ?= ../shared/data
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
BROWSERS := .browsers/.installed

.PHONY: help setup demo test slow docs lint format bench sweep fuzz faults pictures clean
.DEFAULT_GOAL := help

help:  ## Show what can be made
	@sed -n 's/^\([a-z]*\):.*## /  make \1	/p' $(MAKEFILE_LIST)

setup: $(INSTALLED)  ## Create .venv and install the project and its tools into it

# Installed again only when the project's requirements change.
$(INSTALLED): pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "Python 3.11 or newer is needed: make PYTHON=/path/to/python" >&2; exit 1; }
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || "$(PYTHON)" -m venv --clear $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	@touch $@

# What drives the browsers in tests/share; without it, or without a browser, those tests skip and say so.
$(BROWSERS): tests/share/package.json
	@mkdir -p .browsers && rm -f .browsers/package-lock.json && cp tests/share/package.json .browsers/
	@if command -v npm >/dev/null; then \
		(cd .browsers && npm install --no-package-lock --ignore-scripts --no-audit --no-fund --loglevel=error) && touch $@ \
			|| echo "npm could not install what drives the browsers: their tests are skipped" >&2; \
	else echo "there is no npm: the tests in browsers are skipped" >&2; fi

demo: $(INSTALLED)  ## Find the robot in the embedded building and write a recording
	$(BIN)/mcl demo

test: lint $(BROWSERS)  ## Everything that is checked: style, types, layers, tests
	$(BIN)/pytest --numprocesses auto --maxprocesses 4 --dist loadscope

docs: $(INSTALLED)  ## The documentation as a site, in build/site; runs its notebooks, and fails at any warning
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

slow: $(INSTALLED)  ## The tests that take long, and look at nearly the same as quicker ones
	$(BIN)/pytest -m slow --numprocesses auto --maxprocesses 4 --dist loadscope

lint: $(INSTALLED)  ## Style, types and layers only
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(INSTALLED)  ## Mend style where a tool can
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

bench: $(INSTALLED)  ## Measure speed; the table, JSON and a picture go to benchmark/
	$(BIN)/mcl bench --output benchmark --force

sweep: $(INSTALLED)  ## Run the documentation's tables again, SEEDS=20 runs a row, of rows named ONLY=...; stopped, it goes on
	$(BIN)/python docs/sweep.py --seeds $(SEEDS) --data $(DATA) --only '$(ONLY)'

fuzz: $(INSTALLED)  ## Mangled files into all that reads files, INPUTS=1000000 of them; what goes wrong is kept in .fuzz/
	$(BIN)/python tests/fuzz.py --count $(INPUTS)

faults: $(INSTALLED)  ## Kill, stop and starve commands at random instants, ROUNDS=20 times each
	$(BIN)/python tests/breakdowns.py --rounds $(ROUNDS)

pictures: $(INSTALLED)  ## Take the documentation's pictures again, in the headless viewer (needs a Vulkan driver)
	$(BIN)/python docs/pictures.py

clean:  ## Remove caches and built files; recordings and .venv stay
	rm -rf .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis .benchmarks .fuzz build dist
	find pipeline converters tests -name __pycache__ -type d -prune -exec rm -rf {} +

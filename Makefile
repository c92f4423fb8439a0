# `make report|book|test|lab|bench|format`: all use .venv, which is made here when it is missing.

SHELL := /bin/bash
PYTHON ?= python3
BIN := .venv/bin
DEMOS := data/ahrs-demo data/positions-demo data/rotation-demo data/leo-demo data/trajectory-demo

.PHONY: report book test lab bench format
.DELETE_ON_ERROR:

report: .venv/.installed $(DEMOS:%=%/device.toml)
	$(BIN)/sensorbook report $(DEMOS) --out reports
	@echo "Open $(CURDIR)/reports/index.html"

book: .venv/.installed $(DEMOS:%=%/device.toml)
	$(BIN)/sensorbook book $(DEMOS) --out reports
	@echo "Open $(CURDIR)/reports/book/index.html"

data/%-demo/device.toml: | .venv/.installed
	$(BIN)/sensorbook simulate data/$*-demo --preset $*

test: .venv/.installed-for-tests
	$(BIN)/ruff check
	$(BIN)/pytest -n 2 --dist loadfile -o faulthandler_timeout=300  # a test that hangs says where

lab: .venv/.installed
	$(BIN)/jupyter lab notebooks

bench: .venv/.installed-for-tests
	@for file in benchmarks/*.py; do echo "== $$file"; \
	  OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 $(BIN)/python $$file || exit 1; done

format: .venv/.installed-for-tests
	$(BIN)/ruff format
	$(BIN)/ruff check --fix
	$(BIN)/nbstripout notebooks/*.ipynb

.venv/.installed: environment.txt pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "sensorbook needs Python 3.11 or later; $(PYTHON) is" \
	  "$$($(PYTHON) --version 2>&1). Give another with: make PYTHON=python3.12" >&2; exit 1; }
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r environment.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps -e .
	touch $@

.venv/.installed-for-tests: .venv/.installed tests/environment.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r tests/environment.txt -c environment.txt
	touch $@

# heave_env: what a user and a developer call. `make help` lists it.
#
# Everything runs in .venv, which is built on first use from pyproject.toml and the pins of constraints.txt and built
# again only when one of them changes. Another Python: `make test PYTHON=/path/to/python3.12`.

VENV := .venv
BIN := $(VENV)/bin
WORKERS ?= 2

# One thread per process: the tests bring their own processes.
ONE_THREAD := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1
PYTEST := $(ONE_THREAD) $(BIN)/python -m pytest -n $(WORKERS) --dist loadfile

.DEFAULT_GOAL := help
.PHONY: help venv demo test test-all lint format bench clean

help: ## Show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-9s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

venv: ## Build .venv, if it is missing or out of date
	@.ci/venv $(VENV) $(PYTHON)

demo: venv ## Train an agent, compare it with the classical controllers, write a report (minutes)
	$(BIN)/heave demo

test: lint ## Lint, type-check and run the tests that are not slow
	$(PYTEST)

test-all: lint ## The same with the slow tests
	$(PYTEST) -m ""

lint: venv ## Ruff and mypy
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy

format: venv ## Let ruff mend what it can
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

bench: venv ## Speed beside its yardsticks, on one core
	$(ONE_THREAD) $(BIN)/heave bench

clean: ## Remove .venv and every cache; runs/ stays
	rm -rf $(VENV) build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

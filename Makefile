# What a developer needs; every target installs what it needs first.

PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin

.PHONY: all rank test check bench pictures format clean

all: .venv/installed

.venv/installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[ik,robots,report,cluster,dev]'
	touch $@

rank: all
	$(BIN)/sqrp rank workspaces/tabletop "pickup green"

test: all
	$(BIN)/pytest --numprocesses auto

check: all
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/pytest --numprocesses auto

bench: all
	$(BIN)/python -m tests.benchmarks

# The pictures in the README; needs Chromium.
pictures: all
	$(BIN)/python -m tests.pictures

format: all
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean:
	rm -rf .venv build *.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis .import_linter_cache

# What a developer needs; every target installs what it needs first.

PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin

# Bytecode is kept: tests are rewritten for their asserts, and each process would do that again.
export PYTHONDONTWRITEBYTECODE :=

# Python makes the bytecode of what is used; pip would make that of all, on one core.
INSTALL := $(BIN)/pip install --no-compile --quiet --disable-pip-version-check --constraint constraints.txt --editable

.PHONY: all rank run test check lint docs wheels dist bench load damage planners trials pictures reproduce format clean

all: .venv/installed

.venv/pyvenv.cfg:
	$(PYTHON) -m venv .venv

# Each by itself, so that a first look does not install the tools of developers.
.venv/rank: pyproject.toml constraints.txt | .venv/pyvenv.cfg
	$(INSTALL) '.[robots,xacro]'
	@touch $@

.venv/run: pyproject.toml constraints.txt | .venv/pyvenv.cfg
	$(INSTALL) '.[robots,sim,report,place,xacro,bags,recordings,ros2,studio]'
	@touch .venv/rank $@

# Two at once, without asking what needs what: the constraints are all that is needed, and to build, too.
# What fails here, the second tells. Made for all processes of the tests at once: bytecode of what they use.
.venv/installed: pyproject.toml constraints.txt | .venv/pyvenv.cfg
	@xargs -P 2 -n 18 $(BIN)/pip install --no-compile --quiet --disable-pip-version-check --no-deps < constraints.txt && built=--no-build-isolation; \
	$(INSTALL) '.[robots,sim,report,place,cluster,planners,xacro,bags,recordings,ros2,studio,dev]' $$built
	-@$(BIN)/python -m compileall -qq -j 0 -x '/(tests|OpenGL|pip|mypyc?|setuptools|pyglet|stats|lexers)/' .venv/lib
	@touch .venv/rank .venv/run $@

rank: .venv/rank
	$(BIN)/sqrp rank workspaces/tabletop "pickup green"

run: .venv/run
	mkdir -p build && rm -f build/pick.yaml
	$(BIN)/sqrp rank workspaces/tabletop "pickup green" --program build/pick.yaml
	$(BIN)/sqrp run build/pick.yaml --sim --fault slip@lift+0.7

# Every test but the trials; `pytest` alone leaves out the slow ones, too.
test: all
	$(BIN)/pytest --numprocesses auto -m 'not trial'

check: lint test

lint: all
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# The documentation, as pages that open from the disk: build/site/index.html.
docs: all
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

# One for each platform, all built here: build/wheels.
wheels: .venv/pyvenv.cfg
	$(BIN)/pip install --no-compile --quiet --disable-pip-version-check --constraint constraints.txt 'setuptools>=77' ziglang
	for platform in manylinux2014_x86_64 manylinux2014_aarch64 macosx_11_0_arm64; do \
	  SQRP_WHEEL=$$platform $(BIN)/pip wheel --quiet --disable-pip-version-check --no-build-isolation \
	    --no-deps --wheel-dir build/wheels . || exit 1; \
	done

# The source distribution, and from it a wheel for this machine: build/dist.
dist: .venv/pyvenv.cfg
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt build
	$(BIN)/python -m build --outdir build/dist

# Whole commands against another version, in turns, and where their time goes; writes the tables of docs/how/speed.md.
AGAINST ?= 5d38566e
bench: all
	$(BIN)/python -m tests.benchmarks --against $(AGAINST)

# Scores 40 generated cells in every way, kills included; takes minutes.
load: all
	$(BIN)/python -m tests.trials load

# Plans for 300 random problems against Fast Downward, which takes 0.2 s for each.
planners: all
	SQRP_PLANNING_PROBLEMS=300 $(BIN)/pytest --numprocesses auto tests/logic/test_against_unified_planning.py -k fast_downward

# The pictures of the documentation; needs Chromium.
pictures: all
	$(BIN)/python -m tests.pictures

# Long seeded trials; without a name, `python -m tests.trials` lists them.
trials: all
	$(BIN)/python -m tests.trials all
	$(BIN)/python -m tests.studio
	$(BIN)/pytest --numprocesses auto -m trial

# 10,000 damaged inputs of every kind, each in a process of its own with limits; takes a quarter of an hour.
damage: all
	$(BIN)/python -m tests.trials damage

# Both experiments of the paper, each figure beside the paper's, and a page with pictures in build/reproduction.
reproduce: all
	$(BIN)/python -m tests.reproduction

format: all
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean:
	rm -rf .venv build *.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis .import_linter_cache

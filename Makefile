# Everything on a machine that has python3 >= 3.10 and make. `make help` lists the targets.

PYTHON ?= python3
BIN := .venv/bin
OLDEST := .venv-oldest
OUT ?= out
# What test-oldest runs.
TESTS ?= test
# Real photos and a video for the suites that need them; without them the others are run.
DATA ?= ../shared/data
SUITES := quick planar layered regimes far light tones weak-texture big-change nochange authors
REAL := $(if $(wildcard $(DATA)/aerial),photos video --data $(DATA))

# The environment is an ament prefix; a ROS that the shell has sourced must not mix with its wheels.
export AMENT_PREFIX_PATH := $(CURDIR)/.venv
unexport PYTHONPATH LD_LIBRARY_PATH RMW_IMPLEMENTATION _ROS_WHEELS_BOOTSTRAP_COMPLETE

.PHONY: help demo docs test test-oldest load soak lint bench bench-speed bench-ablation clean

help:
	@echo 'make demo    play the bag to the real node; report in $(OUT)/demo.html'
	@echo 'make test    all tests, then the oracle tests without the JIT'
	@echo 'make test-oldest  the tests with the versions of Ubuntu 24.04, Python 3.10 to 3.12'
	@echo 'make lint    ruff and mypy'
	@echo 'make docs    the documentation as a site: $(OUT)/site/index.html'
	@echo 'make load    a camera faster than the node, 10 minutes: losses, latency, memory'
	@echo 'make soak    a fault every few seconds, half an hour'
	@echo 'make bench   all suites with all rivals (half an hour), then bench-ablation, bench-speed'
	@echo 'make bench-speed  time beside ECC, over sizes, in a stream (nine minutes)'
	@echo 'make bench-ablation  what each part is worth, switched off alone (five minutes)'
	@echo 'make clean   remove .venv and everything built'
	@echo 'PYTHON=python3.12 make ... chooses the interpreter of a new .venv'

demo: .venv/installed
	$(BIN)/rsmb demo -o $(OUT)

test: .venv/installed
	$(BIN)/pytest -q
	NUMBA_DISABLE_JIT=1 $(BIN)/pytest -q -m oracle test/core

# With the versions that Ubuntu 24.04 gives a user of Jazzy.
test-oldest: $(OLDEST)/installed
	AMENT_PREFIX_PATH=$(CURDIR)/$(OLDEST) $(OLDEST)/bin/pytest -q $(TESTS)

# A camera faster than the node, 5 minutes each; LOAD='--seconds 90 --settle 45' and the like.
load: .venv/installed
	$(BIN)/python test/ros/load.py $(LOAD)

# A fault every few seconds for half an hour; SOAK='--seconds 180'.
soak: .venv/installed
	$(BIN)/python test/ros/soak.py $(SOAK)

# Material tells of its successor at every build; that is no warning about these pages.
docs: .venv/installed
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict --site-dir $(abspath $(OUT))/site
	@echo '-> $(OUT)/site/index.html'

lint: .venv/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: .venv/installed
	@mkdir -p $(OUT)
	$(BIN)/rsmb evaluate $(SUITES) $(REAL) --markdown benchmarks/RESULTS.md \
		--report $(OUT)/bench.html --sheets $(OUT)/bench
	@$(MAKE) --no-print-directory bench-ablation
	@$(MAKE) --no-print-directory bench-speed

bench-ablation: .venv/installed
	$(BIN)/rsmb ablation --markdown benchmarks/ABLATION.md

# Alone on the machine: a second process in the caches changes what is measured.
bench-speed: .venv/installed
	$(BIN)/rsmb speed --markdown benchmarks/SPEED.md

# Editable, so that tests and demo run the checkout, its data files included. pip then leaves the
# ament index alone, so the package is registered by links, also to the checkout.
.venv/installed: PIP_OPTIONS := '.[ros,test,interop,docs,dev]'
$(OLDEST)/installed: PIP_OPTIONS := '.[ros,test,interop]' --constraint test/oldest.txt
$(OLDEST)/installed: test/oldest.txt
.venv/bin/python: NEWEST := 99
$(OLDEST)/bin/python: NEWEST := 12

.venv/installed $(OLDEST)/installed: %/installed: setup.py pyproject.toml Makefile | %/bin/python
	@echo 'installing into $* (some minutes the first time)'
	@$*/bin/pip install --quiet --disable-pip-version-check --editable $(PIP_OPTIONS)
	@mkdir -p $*/share/ament_index/resource_index/packages $*/share/rsmb_ros $*/lib/rsmb_ros
	@ln -sfn $(CURDIR)/resource/rsmb_ros $*/share/ament_index/resource_index/packages
	@ln -sfn $(addprefix $(CURDIR)/,package.xml launch config bags) $*/share/rsmb_ros
	@ln -sfn $(wildcard $(CURDIR)/scripts/*) $*/lib/rsmb_ros
	@touch $@

.venv/bin/python $(OLDEST)/bin/python: %/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, $(NEWEST)))' || \
		{ echo "$(PYTHON) is $$($(PYTHON) -V 2>&1), $* needs 3.10 to 3.$(NEWEST): PYTHON=python3.12 make ..."; exit 1; }
	@$(PYTHON) -m venv $* || \
		{ rm -rf $*; echo '$(PYTHON) has no venv: sudo apt-get install python3-venv'; exit 1; }

clean:
	rm -rf .venv $(OLDEST) $(OUT) build install log dist *.egg-info .pytest_cache .ruff_cache .mypy_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

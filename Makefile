# Everything on a machine that has python3 >= 3.10 and make. `make help` lists the targets.

PYTHON ?= python3
BIN := .venv/bin
INDEX := .venv/share/ament_index/resource_index/packages
OUT ?= out
# Real photos and a video for the suites that need them; without them the others are run.
DATA ?= ../shared/data
SUITES := quick planar layered regimes far light weak-texture big-change nochange authors
REAL := $(if $(wildcard $(DATA)/aerial),photos video --data $(DATA))

# The environment is an ament prefix; a ROS that the shell has sourced must not mix with its wheels.
export AMENT_PREFIX_PATH := $(CURDIR)/.venv
unexport PYTHONPATH LD_LIBRARY_PATH RMW_IMPLEMENTATION _ROS_WHEELS_BOOTSTRAP_COMPLETE

.PHONY: help demo test lint bench bench-speed bench-ablation clean

help:
	@echo 'make demo    play the bag to the real node; report in $(OUT)/demo.html'
	@echo 'make test    all tests, then the oracle tests without the JIT'
	@echo 'make lint    ruff and mypy'
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
.venv/installed: setup.py pyproject.toml Makefile | .venv/bin/python
	@echo 'installing into .venv (some minutes the first time)'
	@$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[ros,test,dev]'
	@mkdir -p $(INDEX) .venv/share/rsmb_ros .venv/lib/rsmb_ros
	@ln -sfn $(CURDIR)/resource/rsmb_ros $(INDEX)
	@ln -sfn $(addprefix $(CURDIR)/,package.xml launch config bags) .venv/share/rsmb_ros
	@ln -sfn $(wildcard $(CURDIR)/scripts/*) .venv/lib/rsmb_ros
	@touch $@

.venv/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || \
		{ echo "$(PYTHON) is $$($(PYTHON) -V 2>&1), needed is 3.10 or newer: PYTHON=python3.12 make ..."; exit 1; }
	@$(PYTHON) -m venv .venv || \
		{ rm -rf .venv; echo '$(PYTHON) has no venv: sudo apt-get install python3-venv'; exit 1; }

clean:
	rm -rf .venv $(OUT) build install log dist *.egg-info .pytest_cache .ruff_cache .mypy_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

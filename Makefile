# From a machine with nothing but Python >= 3.11 and make: every target sets up the virtual environment it needs.
#
#   make test PYTHON=python3.12    uses that interpreter, in an environment of its own (.venv-3.12)
#   make test PYTEST="-m 'not slow'"

SHELL := /bin/bash

# The first interpreter that is new enough. Being on PATH is not enough (version managers put stubs there): it must run.
ifeq ($(origin PYTHON), undefined)
  PYTHON := $(shell for python in python3 python3.13 python3.12 python3.11; do \
      $$python -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$python && break; done)
  VENV ?= .venv
endif
VENV ?= .venv-$(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)

BIN := $(VENV)/bin
JOBS ?= 2
PYTEST ?=

# $(call install,EXTRA): build tools first (setuptools for a servo SDK that comes as source), so that every version is pinned.
install = $(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt hatchling editables setuptools wheel && \
    $(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt --no-build-isolation -e '.[$(1)]'

.DEFAULT_GOAL := help
.PHONY: help demo docs test install lint types bench .bench format clean

help: ## this list
	@sed -nE 's/^([a-z]+):.*## (.*)/  make \1\t\2/p' $(MAKEFILE_LIST)

demo: $(VENV)/.installed-all ## path, plan, certificate, pictures and playback in one go; leaves demo/
	$(BIN)/jaxik demo

# Most of a test run is compiling: a program that one worker has compiled serves the others, in this run only.
test: $(VENV)/.installed-dev ## every test, slow ones too
	@cache=$${JAX_COMPILATION_CACHE_DIR:-$$(mktemp -d)}; \
	[ -n "$$JAX_COMPILATION_CACHE_DIR" ] || trap 'rm -rf "$$cache"' EXIT; \
	JAX_COMPILATION_CACHE_DIR="$$cache" JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS=0.3 \
	  $(BIN)/python -m pytest -n $(JOBS) --dist worksteal $(PYTEST)

docs: $(VENV)/.installed-dev ## the documentation as a site, in build/docs; search works offline
	$(BIN)/python -m sphinx -q -W --keep-going -b html -c docs/site -d build/docs-trees . build/docs
	@echo "open build/docs/index.html"

install: $(VENV)/.installed-dev ## the environment that tests need, and no more

lint: $(VENV)/.installed-dev ## style and format
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.installed-dev ## static types
	PYRIGHT_PYTHON_IGNORE_WARNINGS=1 $(BIN)/pyright --pythonpath $(BIN)/python

# The peers get an environment of their own: tests need none of them.
bench: ## jaxik beside other libraries, in ten minutes; renews docs/benchmarks.md
	@$(MAKE) --no-print-directory VENV=$(VENV)-bench .bench

.bench: $(VENV)/.installed-bench
	$(BIN)/python -m benchmarks.suite

$(VENV)/.installed-bench: pyproject.toml constraints.txt | $(BIN)/python
	@echo "Installing into $(VENV): a few minutes the first time"
	@$(call install,bench)
	@touch $@

format: $(VENV)/.installed-dev ## mend what lint can mend by itself
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean: ## remove the environments and everything built or left behind
	rm -rf .venv .venv-* build dist demo .pytest_cache .ruff_cache .hypothesis
	find jaxik training hardware tests benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +

$(VENV)/.installed-all: pyproject.toml constraints.txt | $(BIN)/python
	@echo "Installing into $(VENV): a few minutes the first time"
	@$(call install,all)
	@touch $@

$(VENV)/.installed-dev: pyproject.toml constraints.txt | $(BIN)/python
	@echo "Installing into $(VENV): a few minutes the first time"
	@$(call install,dev)
	@touch $@ $(VENV)/.installed-all

# Debian and Ubuntu keep the venv module in a package of its own; without it `-m venv` fails and says so.
$(BIN)/python:
	@$(or $(PYTHON),false) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
	  echo "jaxik needs Python 3.11 or newer$(if $(PYTHON), and $(PYTHON) is not): install one or name it with PYTHON=..." >&2; exit 1; }
	@$(PYTHON) -m venv $(VENV) >/dev/null 2>&1 || { \
	  package=$$($(PYTHON) -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])'); \
	  rm -rf $(VENV); \
	  if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	    echo "Installing $$package"; \
	    apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq $$package >/dev/null; \
	  fi; \
	  $(PYTHON) -m venv $(VENV) >/dev/null 2>&1 || { rm -rf $(VENV); \
	    echo "$(PYTHON) cannot make a virtual environment: run 'sudo apt-get install $$package' and try again." >&2; exit 1; }; }

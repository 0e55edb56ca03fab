# make demo, make test: each makes what it needs first. PYTHON=... names another Python.
VENV ?= .venv
VENV_OLDEST ?= .venv-oldest
PYTEST_ARGS ?=
# Files of tests run side by side (test/file_scheduling.py): one more than there are cores, because
# tests of nodes and pages wait half of the time. A worker that crashes or hangs costs one test and
# is replaced, eight times at most.
CORES := $(shell getconf _NPROCESSORS_ONLN 2>/dev/null || echo 2)
PYTEST_JOBS ?= -n $(shell expr $(CORES) + 1) --maxprocesses 4 --max-worker-restart 8
# Each test has a time limit (pyproject.toml), and so has the whole, should pytest itself hang.
TEST_LIMIT ?= 45m
PYTEST = timeout --kill-after 30s $(TEST_LIMIT)
export PYTHON
# Numerical libraries gain nothing from threads on problems of this size, and lose a lot when
# tests, node and fit share two cores.
export OPENBLAS_NUM_THREADS ?= 1
export OMP_NUM_THREADS ?= 1
export PYTHONUNBUFFERED = 1
# Tests start some hundred interpreters: each would compile this package anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help demo test test-oldest lint venv clean

help:
	@echo 'make demo         learn an arm, hang 2 kg on it, relearn, over real ROS 2 messages'
	@echo 'make test         all tests, lint and types among them'
	@echo 'make test-oldest  all tests with the NumPy and SciPy of Ubuntu 24.04'
	@echo 'make lint         ruff and mypy alone'
	@echo 'make venv         only make $(VENV), with what the above need'
	@echo 'make clean        remove what was built or installed here'
	@echo
	@echo 'PYTHON=python3.11 make test   names the Python to use (3.11 or 3.12)'

demo: venv
	@$(VENV)/bin/python examples/demo.py

# Lint and types are among the tests (test/test_style.py), where they take no time of their own.
test: venv
	$(PYTEST) $(VENV)/bin/python -m pytest $(PYTEST_JOBS) $(PYTEST_ARGS)

test-oldest:
	@tools/make_venv.sh $(VENV_OLDEST) oldest
	$(PYTEST) $(VENV_OLDEST)/bin/python -m pytest $(PYTEST_JOBS) $(PYTEST_ARGS)

lint: venv
	$(VENV)/bin/python -m ruff check
	$(VENV)/bin/python -m mypy

venv:
	@tools/make_venv.sh $(VENV) newest

clean:
	rm -rf $(VENV) $(VENV_OLDEST) build install log *.egg-info demo-output test-artifacts
	rm -rf .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# make demo, make test: each first makes its requirements. PYTHON=... names another Python.
VENV ?= .venv
VENV_OLDEST ?= .venv-oldest
PYTEST_ARGS ?=
# Test files run in parallel (test/file_scheduling.py), two more than the number of cores, because
# tests of nodes and pages wait half of the time. A worker that crashes or hangs fails one test and
# is replaced, eight times at most.
CORES := $(shell getconf _NPROCESSORS_ONLN 2>/dev/null || echo 2)
PYTEST_JOBS ?= -n $(shell expr $(CORES) + 2) --maxprocesses 4 --max-worker-restart 8
# Each test has a time limit (pyproject.toml). This limit ends a run in which pytest itself hangs.
TEST_LIMIT ?= 45m
# As nice as the processes that fit: those would starve where tests fill all cores.
PYTEST = timeout --kill-after 30s $(TEST_LIMIT) nice -n 10
export PYTHON
# Numerical libraries gain nothing from threads on problems of this size, and are much slower with
# threads when tests, node and fit share two cores.
export OPENBLAS_NUM_THREADS ?= 1
export OMP_NUM_THREADS ?= 1
# By default glibc returns large blocks at once. Page faults of the next ones take a tenth of the
# processor time of all tests on a virtual machine.
export MALLOC_MMAP_THRESHOLD_ ?= 67108864
export MALLOC_TRIM_THRESHOLD_ ?= 268435456
export PYTHONUNBUFFERED = 1
# Tests start some hundred interpreters: each would compile this package again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help demo test bench test-oldest lint venv clean

help:
	@echo 'make demo         learn an arm, attach 2 kg, relearn, over real ROS 2 messages'
	@echo 'make test         all tests, with lint and types'
	@echo 'make bench        accuracy on judged recordings, minutes each: not part of make test'
	@echo 'make test-oldest  all tests with the NumPy and SciPy of Ubuntu 24.04'
	@echo 'make lint         ruff and mypy alone'
	@echo 'make venv         only make $(VENV), with the requirements of the above'
	@echo 'make clean        remove everything built or installed here'
	@echo
	@echo 'PYTHON=python3.11 make test   names the Python to use (3.11 or 3.12)'

demo: venv
	@$(VENV)/bin/python examples/demo.py

# The files of benches are in the folder bench/.
bench: venv
	$(PYTEST) $(VENV)/bin/python -m pytest $(PYTEST_JOBS) -m campaign $(PYTEST_ARGS)

# Lint and types are tests (test/docs/test_pages.py), where they run in parallel with the others.
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

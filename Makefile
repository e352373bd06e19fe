# Everything runs from .venv; `make demo` and `make test` need only python3, make and pip.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
DEMO ?= build/demo

# One thread each: tests and benchmarks spread over processes themselves.
export OPENBLAS_NUM_THREADS := 1
export OPENCV_FOR_THREADS_NUM := 1

.PHONY: install demo check test bench clean

install: $(STAMP)

# modules are compiled when they are first imported: most never are
$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile \
		--constraint constraints.txt --editable '.[dev]'
	touch $@

demo: install
	$(BIN)/python examples/gear_on_shaft/demo.py --out $(DEMO)

check: install
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

test: install
	$(BIN)/pytest -n 3 --dist loadscope --no-loadscope-reorder --module-times

bench: install
	HYPOTHESIS_PROFILE=roving $(BIN)/pytest -n 2 --dist worksteal -m "slow or not slow"
	$(BIN)/python -m benchmarks

clean:
	rm -rf build .mypy_cache .ruff_cache .pytest_cache .import_linter_cache

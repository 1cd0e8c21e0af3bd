# Needs make and Python 3.11 or newer. The first target that is made creates .venv.
PYTHON ?= python3
BIN := .venv/bin

# Python reads where our packages are by the locale, and these two know ASCII alone.
ifneq ($(filter C POSIX,$(LC_ALL)),)
unexport LC_ALL
endif

.PHONY: verify test test-whole test-all test-deep test-faults test-foreign test-explore test-traces generate \
  pages evaluation docs fuzz clean ready
.DELETE_ON_ERROR:

verify: ready
	@$(BIN)/automcm verify $(ARGS)

# Before a commit, in three minutes: lint, types, and the tests that are not slow.
test: ready
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/pytest -q -n 2 --dist worksteal -m "not slow and not deep" \
	  --hypothesis-profile=quick $(ARGS)

# The whole test suite, quick and slow tests, with branch coverage.
test-whole: ready
	@$(BIN)/pytest -q -n 2 --dist worksteal --cov --cov-report=term $(ARGS)

# Everything there is: about two hours.
test-all: test test-whole test-deep test-faults test-traces test-explore test-foreign

# The tests marked deep, then a million steps; --steps, --seed and --processes in ARGS.
test-deep: ready
	@$(BIN)/pytest -q -n 2 -m deep
	@$(BIN)/python reference/tests/stateful.py $(ARGS)

# The suite against the stations in C++ and Go, and mutants, and the page of a log in Chromium; what
# is not on this machine is skipped loudly.
test-foreign: ready .venv/foreign
	@$(BIN)/python traces/tests/browser.py
	@$(BIN)/python reference/tests/foreign_cam.py
	@$(BIN)/python reference/tests/foreign_sumo.py
	@$(BIN)/python conformance/tests/foreign.py $(ARGS)

# Each system call of a station made to fail in each phase (docs/faults.md), then 30 minutes of random
# faults on 20 stations; six minutes and more.
test-faults: ready
	@$(BIN)/python conformance/tests/faults.py --write docs/faults.md
	@$(BIN)/python conformance/tests/soak.py $(ARGS)

# Exploration against stations with two mistakes each: found in a minute, shortened; minutes in all.
test-explore: ready
	@$(BIN)/python conformance/tests/explored.py $(ARGS)

# Two thousand good logs and as many with an edit, judged by both engines; another number in ARGS.
test-traces: ready
	@$(BIN)/python traces/tests/agreement.py $(or $(ARGS),2000)

generate: ready
	@$(BIN)/automcm generate $(ARGS)

# The counterexamples that docs/models.md links to, as pages.
pages: ready
	@$(BIN)/automcm spec pages $(ARGS)

# The paper's evaluation anew, into docs: 23 minutes on two cores, and SUMO.
evaluation: ready .venv/foreign
	@$(BIN)/automcm experiment all --profile standard --out docs/evaluation $(ARGS)

# The documentation as a site in site/, with the counterexamples; no page of it fetches anything.
docs: pages .venv/docs
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# Ten million changed encodings; make fuzz ARGS="--count 100000 --seed 2" for fewer or others.
fuzz: ready
	@$(BIN)/python -m automcm_maintenance.benches.decoder_fuzz $(ARGS)

clean:
	@rm -rf .venv .coverage .coverage.* .hypothesis .mypy_cache .pytest_cache .ruff_cache runs dist build site
	@find spec reference traces conformance -name __pycache__ -prune -exec rm -rf {} +

# Two of us at once in one clone: the second waits until the first has installed everything.
LOCK := import fcntl, os, sys; f = os.open("Makefile", 0); fcntl.flock(f, 2); \
  os.set_inheritable(f, True); os.execvp(sys.argv[1], sys.argv[1:])

ready:
	@$(PYTHON) -c '$(LOCK)' $(MAKE) --silent .venv/ready

# Two stamps, so that a change of pyproject.toml alone installs nothing anew but ourselves.
.venv/packages: requirements.txt requirements-peers.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "automcm needs Python 3.11 or newer: make PYTHON=/path/to/python3.11" >&2; exit 1; }
	@echo "Installing into .venv ..."
	@$(PYTHON) -m venv --clear .venv
	@$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes -r requirements.txt
	@$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes --no-deps \
	  --only-binary :all: -r requirements-peers.txt || \
	  echo "Not for this machine: the tests against it are skipped, and say so."
	@touch $@

# More than a gigabyte, and not for every machine: what is missing is skipped, loudly, and tried again.
.venv/foreign: .venv/packages requirements-foreign.txt
	@$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes \
	  --only-binary :all: -r requirements-foreign.txt && touch $@ || \
	  echo "Not installed: some of requirements-foreign.txt. What needs it is skipped."

.venv/docs: .venv/packages requirements-docs.txt
	@$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes \
	  --only-binary :all: -r requirements-docs.txt
	@touch $@

.venv/ready: .venv/packages pyproject.toml
	@$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

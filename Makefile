# Needs make and Python 3.11 or newer. The first target creates .venv.
PYTHON ?= python3
BIN := .venv/bin
# The files of requirements are complete.  Without --no-deps pip looks for other versions and fails
# when an indirect requirement has a new release.
INSTALL := $(BIN)/pip install --quiet --disable-pip-version-check --require-hashes --no-deps

# Python decodes the paths of our packages by the locale; these two locales only know ASCII.
ifneq ($(filter C POSIX,$(LC_ALL)),)
unexport LC_ALL
endif

# Without them each process compiles our modules again, and pytest its assertions.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: verify test test-slow test-whole test-all test-deep test-faults test-foreign test-explore test-traces generate \
  pages evaluation docs fuzz clean ready
.DELETE_ON_ERROR:

verify: ready
	@$(BIN)/automcm verify $(ARGS)

# Before a commit: lint, types, and the quick tests.
test: ready
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports --no-logo
	@$(BIN)/pytest -q -n 2 --dist worksteal -m "not slow and not deep" \
	  --hypothesis-profile=quick $(ARGS)

# The tests marked slow.
test-slow: ready
	@$(BIN)/pytest -q -n 2 --dist worksteal -m "slow and not deep" $(ARGS)

# All quick and slow tests, with branch coverage.
test-whole: ready
	@$(BIN)/pytest -q -n 2 --dist worksteal --cov --cov-report=term $(ARGS)

# All tests. CONTRIBUTING.md says how long each target takes.
test-all: test test-whole test-deep test-faults test-traces test-explore test-foreign

# The tests marked deep, then a million random steps. ARGS: --steps, --seed, --processes.
test-deep: ready
	@$(BIN)/pytest -q -n 2 -m deep
	@$(BIN)/python reference/tests/stateful.py $(ARGS)

# The suite on the stations in C++ and Go, on mutants and on the templates, and a log's page in Chromium. Missing
# tools are skipped with a warning.
test-foreign: ready .venv/foreign
	@$(BIN)/python traces/tests/browser.py
	@$(BIN)/python reference/tests/foreign_cam.py
	@$(BIN)/python reference/tests/foreign_signature.py
	@$(BIN)/python reference/tests/foreign_sumo.py
	@$(BIN)/python reference/tests/foreign_traffic.py
	@$(BIN)/python reference/tests/foreign_radio.py
	@$(BIN)/pytest -q -n 0 conformance/tests/adapter/test_new_adapter.py
	@$(BIN)/python conformance/tests/foreign.py $(ARGS)

# Fails each system call of a station in each phase.
test-faults: ready
	@$(BIN)/python conformance/tests/faults.py --write conformance/faults.json $(ARGS)

# Exploration of stations with two faults each: it must find and shorten them in a minute each.
test-explore: ready
	@$(BIN)/pytest -q -n 0 conformance/tests/explored.py $(ARGS)

# Both engines on 2000 good logs and 2000 edited ones. ARGS: another number.
test-traces: ready
	@$(BIN)/python traces/tests/agreement.py $(or $(ARGS),2000)

generate: ready
	@$(BIN)/automcm generate $(ARGS)

# HTML pages of the counterexamples that docs/models.md links to.
pages: ready
	@$(BIN)/automcm spec pages $(ARGS)

# Repeats the paper's evaluation and writes it to docs, with SUMO.
evaluation: ready .venv/foreign
	@$(BIN)/automcm experiment all --profile standard --out docs/evaluation $(ARGS)

# The documentation site in site/, with the counterexamples. Its pages make no external requests.
docs: pages .venv/docs
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# Decodes 400,000 changed encodings. ARGS, for example: --hypothesis-seed=2.
fuzz: ready
	@$(BIN)/pytest -q -n 2 -k survive --hypothesis-profile=fuzz \
	  reference/tests/encoding/test_changed_encodings.py $(ARGS)

clean:
	@rm -rf .venv .coverage .coverage.* .hypothesis .import_linter_cache .mypy_cache .pytest_cache .ruff_cache runs dist build site
	@find spec reference traces conformance -name __pycache__ -prune -exec rm -rf {} +

# If make runs twice in one clone, the second waits until the first has installed everything.
LOCK := import fcntl, os, sys; f = os.open("Makefile", 0); fcntl.flock(f, 2); \
  os.set_inheritable(f, True); os.execvp(sys.argv[1], sys.argv[1:])

ready:
	@$(PYTHON) -c '$(LOCK)' $(MAKE) --silent .venv/ready

# Two stamps: after a change of only pyproject.toml, only this project is reinstalled.
.venv/packages: requirements.txt requirements-peers.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "automcm needs Python 3.11 or newer: make PYTHON=/path/to/python3.11" >&2; exit 1; }
	@echo "Installing into .venv ..."
	@$(PYTHON) -m venv --clear .venv
	@$(INSTALL) -r requirements.txt
	@$(BIN)/pip check > .venv/check || { cat .venv/check >&2; exit 1; }
	@$(INSTALL) --only-binary :all: -r requirements-peers.txt || \
	  echo "requirements-peers.txt could not be installed: the tests that need it are skipped."
	@touch $@

# More than a gigabyte, and not available everywhere: a missing tool is skipped with a warning and
# tried again next time.
.venv/foreign: .venv/packages requirements-foreign.txt requirements-ns3.txt
	@$(INSTALL) -r requirements-ns3.txt || \
	  echo "requirements-ns3.txt could not be installed: tests that need ns-3 are skipped."
	@$(INSTALL) --only-binary :all: -r requirements-foreign.txt && touch $@ || \
	  echo "requirements-foreign.txt could not be installed: tests that need it are skipped."

.venv/docs: .venv/packages requirements-docs.txt
	@$(INSTALL) --only-binary :all: -r requirements-docs.txt
	@touch $@

.venv/ready: .venv/packages pyproject.toml
	@$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@
	@echo "Ready. Next: $(BIN)/automcm demo, or $(BIN)/automcm --help"

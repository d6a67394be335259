# Everything here runs in .venv, which the first target you ask for builds from requirements.lock.
#
#   make run      every new or changed campaign under data/raw, to its report
#   make test     the tests                 make test ARGS='-k rail'
#   make whole    whole campaigns to their answers, some ten minutes    before a change of the estimate is merged
#   make slow     the tests that take long: serving, killing, many campaigns
#   make team     two workers of a pool on PostgreSQL, one killed      make team CAMPAIGNS=200
#   make check    format, lint, types
#   make bench    how good and how fast, side by side with the alternatives
#   make league   every hidden cause against the diagnosis
#   make open-league   games from any hand, played by any program      make open-league ARGS='seal games --truth truths'
#   make reference     our answers against twelve certified ones
#   make worlds   campaigns with other noise, blunders, loads, payloads and instruments
#   make paper    the paper's tables and figures, computed again
#   make peers    other tools on the same data, in environments of their own: docs/peers.md
#   make compare  every number that differs from an earlier commit      make compare BASE=HEAD~1
#   make example  the report and the pictures that the README shows, from kr500_first
#   make picture  the picture of the code in docs/code.md
#   make schema   the keys of result.json in docs/, from their types
#   make words    the texts of certificate and sheet, from the source into the catalogues of German and French
#   make wheel    the package as a wheel, in dist/
#   make supply   bill of materials, licences, known weaknesses, and whether two wheels are the same
#   make docs     the documentation site, build/site, from docs/ and the docstrings
#                 make docs ARGS='-D nb_execution_mode=cache'    tutorials run only if their text changed
#   make lock     write requirements.lock anew from pyproject.toml      make lock UPGRADE=--upgrade
#   make clean    remove .venv and the caches; data and reports stay

.DELETE_ON_ERROR:
.PHONY: run test whole slow team check bench league open-league reference worlds paper peers compare example picture schema words docs wheel supply lock clean

PYTHON ?=
ARGS ?=
BASE ?=
CAMPAIGNS ?= 200
UPGRADE ?=
PY := .venv/bin/python
PIP := $(PY) -m pip -qq --disable-pip-version-check --no-input

run: .venv/.ready
	@.venv/bin/pipeline run $(ARGS) || test $$? -eq 5    # 5: done, and rows were left out, told above

# One BLAS thread per worker: two workers with all cores each are slower than either alone.
# loadgroup, because tests that share a server carry an xdist_group and must meet in one worker;
# in the order of tests/conftest.py, which begins with the groups.
# Compiled modules are kept, also where the environment says otherwise: some tests start the command.
TESTS := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE= \
	$(PY) -m pytest -q -n 2 --dist loadgroup --no-loadscope-reorder

test: .venv/.ready
	@$(PY) tests/get_browser.py
	@$(TESTS) $(ARGS)

whole: .venv/.ready
	@$(PY) tests/get_browser.py
	@$(TESTS) -m "whole and not slow" $(ARGS)

slow: .venv/.ready .venv/.docs
	@$(TESTS) -m slow $(ARGS)

team: .venv/.ready
	@TEAM_CAMPAIGNS=$(CAMPAIGNS) $(TESTS) -m slow tests/service/test_teams.py -k killed $(ARGS)

check: .venv/.ready
	@$(PY) -m ruff format --check .
	@$(PY) -m ruff check .
	@$(PY) -m mypy

bench: .venv/.ready
	@$(PY) -m bench $(ARGS)

paper: .venv/.ready
	@$(PY) -m bench.paper $(ARGS)

league: .venv/.ready
	@$(PY) -m bench.league --page docs/league.md $(ARGS)

open-league: .venv/.ready
	@$(PY) -m bench.open_league $(ARGS)

reference: .venv/.ready
	@$(PY) -m bench.reference $(ARGS)

worlds: .venv/.ready
	@$(PY) -m bench.worlds --page docs/worlds.md $(ARGS)

peers: .venv/.ready build/peers/figaroh/.ready build/peers/pybotics/.ready
	@$(PY) -m bench.peers $(ARGS)

# Each peer has an environment of its own, for this command only: their requirements exclude each other and ours.
build/peers/%/.ready: bench/peers/foreign/%.txt .venv/.ready
	@rm -rf $(@D)
	@$(PY) -m venv $(@D)
	@$(@D)/bin/python -m pip -qq --disable-pip-version-check --no-input install --no-deps --require-hashes -r $<
	@touch $@

compare: .venv/.ready
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m bench.compare $(BASE) $(ARGS)

example: .venv/.ready
	@.venv/bin/pipeline run kr500_first --engine local
	@mkdir -p docs/example
	@cp reports/kr500_first/report.pdf reports/kr500_first/figures/workspace.svg docs/example/
	@$(PY) -m bench.screenshot reports/kr500_first/index.html docs/example/report.png

words: .venv/.ready
	@$(PY) -m bench.messages

schema: .venv/.ready
	@$(PY) -m bench.schema

picture: .venv/.ready
	@$(PY) -m bench.picture

docs: .venv/.ready .venv/.docs
	@$(PY) -m sphinx -q -W --keep-going -b html -d build/doctrees $(ARGS) docs build/site
	@echo build/site/index.html

wheel: .venv/.ready
	@rm -rf build/lib
	@$(PIP) wheel --no-deps --no-build-isolation --no-index --wheel-dir dist .
	@ls -t dist/*.whl | head -1

supply: .venv/.ready
	@$(PY) -m bench.supply

# No address goes into the files: whoever installs decides where packages come from, the hashes decide which.
lock: .venv/.ready
	@.venv/bin/uv pip compile pyproject.toml --extra dev --universal --python-version 3.11 \
		--generate-hashes --no-header --no-config --no-emit-index-url --no-emit-find-links \
		--quiet $(UPGRADE) --output-file requirements.lock
	@.venv/bin/uv pip compile pyproject.toml --extra docs --constraint requirements.lock --universal \
		--python-version 3.11 --generate-hashes --no-header --no-config --no-emit-index-url \
		--no-emit-find-links --quiet $(UPGRADE) --output-file docs/requirements.lock

clean:
	@rm -rf .venv build dist *.egg-info .pytest_cache .ruff_cache .mypy_cache .hypothesis .prefect
	@find . -path ./data -prune -o -name __pycache__ -type d -prune -exec rm -rf {} +

# Two stamps, each written last, so that an interrupted step is started over:
# .installed costs a minute and follows the lock; .ready costs seconds and follows pyproject.toml.
.venv/.ready: .venv/.installed pyproject.toml
	@$(PIP) install --no-deps --no-build-isolation --no-index --editable .
	@$(PY) -m compileall -qq -j 0 pipeline || true
	@touch $@

# What only the site needs comes on top: its lock is constrained by the other one.
.venv/.docs: .venv/.installed docs/requirements.lock
	@$(PIP) install --no-deps --require-hashes --only-binary :all: -r docs/requirements.lock
	@touch $@

# pip compiles one file at a time and some settings forbid Python to do it later: compile here, on all cores.
# --no-deps, because the lock is complete, and pip would look past a pin where somebody asks for its extras.
# uv fetches many packages at a time, in half a minute less; pip does it where only pip knows from where.
# A few packages carry templates that are no valid Python; these stay uncompiled, hence `|| true`,
# and so do the tests that packages bring, a quarter of all source, and what nobody imports here.
UNUSED := apprise|cma|cyclopts|dateparser|docker|lexers|mypy|mypyc|oauthlib|pymoo|rich_rst|ruamel|setuptools
.venv/.installed: requirements.lock
	@set -e; \
	for python in $(if $(PYTHON),"$(PYTHON)",python3 python3.14 python3.13 python3.12 python3.11); do \
		if "$$python" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 15))' 2>/dev/null; \
		then found=$$python; break; fi; \
	done; \
	if [ -z "$${found-}" ]; then \
		echo "This project needs Python 3.11 to 3.14 and found none; name one with: make PYTHON=/path/to/python3.11" >&2; \
		exit 1; \
	fi; \
	echo "Building .venv with $$("$$found" --version), which takes a minute or two, once."; \
	rm -rf .venv; \
	"$$found" -m venv .venv; \
	awk '/^[a-z]/ { on = /^uv==/ } on' requirements.lock > .venv/uv.txt; \
	$(PIP) install --no-deps --require-hashes --only-binary :all: --no-compile -r .venv/uv.txt; \
	.venv/bin/uv pip sync --quiet --system-certs --python $(PY) --require-hashes --only-binary :all: requirements.lock 2>.venv/uv.log || \
	$(PIP) install --no-deps --require-hashes --only-binary :all: --no-compile -r requirements.lock; \
	$(PY) -W ignore -m compileall -qq -j 0 -x '/(tests?|$(UNUSED))/' .venv/lib || true
	@touch $@

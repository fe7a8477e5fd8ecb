# `make demo` and `make test` do all the set-up themselves: they find a Python, best 3.10, under which Lava runs, and build .venv
# with pinned versions. `make VENV=.venv-3.12 PYTHON=python3.12 test` keeps another Python's environment beside it.
SHELL := /bin/sh
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
# The versions for the Python of an environment.
LOCK = requirements/$$($(BIN)/python -c 'import sys; print("lock" if sys.version_info[:2] == (3, 10) else "lock-host")').txt
# Whoever waits at a terminal sees what is installed.
QUIET := $(shell test -t 2 || echo --quiet)
# Where Pythons keep no compiled modules, as in many containers, each of the hundreds that tests start compiles all it imports.
unexport PYTHONDONTWRITEBYTECODE
# NO_COMPILE=--no-compile halves the time of an installation: modules are compiled as they are imported.
INSTALL := pip install $(QUIET) --disable-pip-version-check $(NO_COMPILE)
# Other simulators of Loihi.
ORACLES := .venv-brian2-loihi/.installed .venv-nengo-loihi/.installed
# Tests run side by side, one row of them a processor.
TESTS := $(BIN)/python -m pytest --numprocesses auto --maxprocesses 4 --dist worksteal

.PHONY: help demo test test-slow test-all lint format bench results figures pages recall peers peers-test oracles sanafe ci-torch test-dl learning nir-peers neurobench tutorial site pictures links images wheel clean
.DEFAULT_GOAL := help

help: ## What there is to make
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## (.*)/  make \1\t\2/' | expand -t 20

$(STAMP): pyproject.toml requirements/lock.txt requirements/lock-host.txt scripts/find_python.sh
	@python=$$(PYTHON="$(PYTHON)" scripts/find_python.sh) && echo "using $$python" && "$$python" -m venv --clear $(VENV)
	@echo "installing pinned versions into $(VENV), which takes about a minute"
	@$(BIN)/python -m $(INSTALL) -r $(LOCK)
	@$(BIN)/python -m $(INSTALL) --no-build-isolation --no-deps --editable .
	@touch $(STAMP)

# $(call environment,FILES): the environment of a goal, under Python 3.10, with what files of requirements name.
define environment
	@python=$$(PYTHON="$(PYTHON)" scripts/find_python.sh 3.10) && "$$python" -m venv --clear $(@D)
	@$(@D)/bin/python -m $(INSTALL) $(patsubst %,-r %,$(1))
	@touch $@
endef

# The same with the project, which sees what $(VENV) has if that is of the same Python: only the rest is installed.
define environment_beside
	@python=$$(PYTHON="$(PYTHON)" scripts/find_python.sh 3.10) && "$$python" -m venv --clear $(@D)
	@echo 'import site; site.addsitedir("$(abspath $(VENV))/lib/python3.10/site-packages")' >$(@D)/lib/python3.10/site-packages/beside.pth
	@$(@D)/bin/python -m $(INSTALL) -r requirements/lock.txt -r $(1)
	@cd / && $(abspath $(@D))/bin/python -c "import lava_vpr" 2>/dev/null || \
		{ cd "$(CURDIR)" && $(@D)/bin/python -m $(INSTALL) --no-build-isolation --no-deps --editable .; }
	@touch $@
endef

demo: $(STAMP) ## The main job on built-in synthetic data; ends with a table and a report
	@$(BIN)/lava-vpr demo --out demo

test: $(STAMP) ## The tests (real images too if LAVA_VPR_DATA names them)
	@$(TESTS) -m "not slow"

test-slow: $(STAMP) ## The long tests only
	@$(TESTS) -m slow --timeout 1800

test-all: $(STAMP) ## The tests, the minutes-long ones included
	@$(TESTS) --timeout 1800

# The package as it is installed, processes/ and deploy/ in it, for tools that read sources.
links:
	@rm -rf .typing/lava_vpr && mkdir -p .typing/lava_vpr
	@for f in lava_vpr/* processes deploy; do ln -s "../../$$f" ".typing/lava_vpr/$${f##*/}"; done

# Before anything is installed or computed for what cannot do without them.
images:
	@test -n "$$LAVA_VPR_DATA" -a -d "$$LAVA_VPR_DATA/data/nordland" || { echo "make $(MAKECMDGOALS) needs real images; set LAVA_VPR_DATA to the folder that holds data/nordland"; exit 1; }

lint: $(STAMP) ## ruff, mypy, and which room imports which (Python 3.10)
	@test -x $(BIN)/mypy || { echo "make lint needs Python 3.10, as does lava-nc; remove $(VENV), and name one: make PYTHON=... lint"; exit 1; }
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(MAKE) --no-print-directory links
	@$(BIN)/mypy .typing/lava_vpr
	@cd .typing && ../$(BIN)/lint-imports --config ../pyproject.toml --no-cache --no-logo
	@cd deploy/programs && for board in kapoho_bay loihi2; do MYPYPATH=common:$$board:../../lava_vpr/isolated \
		../../$(BIN)/mypy --config-file ../../pyproject.toml --cache-dir ../../.mypy_cache --explicit-package-bases common $$board || exit 1; done

format: $(STAMP) ## Format the code
	@$(BIN)/ruff format . && $(BIN)/ruff check --fix .

bench: recall ## Recall on real images, and the time of a query from its command to its answer
	@$(BIN)/python -m benchmarks commands.startup

results: $(STAMP) ## Compute the figures of docs/results.md that are out of date, and write them down (LAVA_VPR_DATA)
	@$(BIN)/python -m benchmarks.results

figures: images $(STAMP) $(ORACLES) .venv-sanafe/.installed .venv-torch/.installed ## Compute every figure of the docs again: all records, results, pages; takes hours (LAVA_VPR_DATA; all environments, 6 GB)
	@$(BIN)/python -m benchmarks commands.records

pages: $(STAMP) ## Write the parts of README and docs that records and code decide
	@$(BIN)/python -m scripts.pages

recall: images $(STAMP) ## Recall on real images (LAVA_VPR_DATA)
	@$(BIN)/python -m benchmarks recall decoders

.venv-peers/.installed: pyproject.toml requirements/lock.txt benchmarks/peers/requirements.txt | $(STAMP)
	$(call environment_beside,benchmarks/peers/requirements.txt)

peers: .venv-peers/.installed ## Side by side with VPRSNN's network in Brian2 (an environment of its own)
	@.venv-peers/bin/python -m benchmarks peers.side_by_side

peers-test: .venv-peers/.installed ## The tests that hold the paper preset against Brian2
	@.venv-peers/bin/python -m pytest tests/engine/test_conductance.py -m slow --timeout 1800

$(ORACLES): .venv-%/.installed: benchmarks/oracles/%.txt scripts/find_python.sh
	$(call environment,benchmarks/oracles/$*.txt)

oracles: images $(STAMP) $(ORACLES) ## Other simulators of Loihi against our integers (environments of their own)
	@$(BIN)/python -m benchmarks oracles.compare
	@$(BIN)/python -m benchmarks oracles.needs
	@$(BIN)/python -m benchmarks oracles.registers

.venv-sanafe/.installed: benchmarks/sanafe/requirements.txt scripts/find_python.sh
	$(call environment,benchmarks/sanafe/requirements.txt)

sanafe: $(STAMP) .venv-sanafe/.installed ## The cost model's closed form against SANA-FE (an environment of its own)
	@$(BIN)/python -m benchmarks sanafe.compare

.venv-torch/.installed: pyproject.toml requirements/lock.txt benchmarks/exchange/requirements.txt
	@python=$$(PYTHON="$(PYTHON)" scripts/find_python.sh 3.10) && "$$python" -m venv --clear .venv-torch
	@.venv-torch/bin/python -m $(INSTALL) -r requirements/lock.txt
	@.venv-torch/bin/python -m $(INSTALL) --no-deps -r benchmarks/exchange/requirements.txt
	@.venv-torch/bin/python -m $(INSTALL) --no-build-isolation --no-deps --editable .
	@touch .venv-torch/.installed

ci-torch: images .venv-torch/.installed ## All that needs torch, apart from CI; writes docs/logs/ci-torch.log (LAVA_VPR_DATA; an environment of 5.6 GB)
	@.venv-torch/bin/python scripts/ci_torch.py

test-dl: .venv-torch/.installed ## The tests of learning by SLAYER and of NetX, with lava-dl (the environment of ci-torch)
	@.venv-torch/bin/python -m pytest tests/training tests/exchange -k 'slayer or netx' --timeout 1800

learning: images .venv-torch/.installed ## Five kinds of learning side by side (LAVA_VPR_DATA; the environment of ci-torch)
	@.venv-torch/bin/python -m benchmarks learning.table

nir-peers: images .venv-torch/.installed ## Exported NIR graphs in snnTorch beside the host engine (LAVA_VPR_DATA; the environment of ci-torch)
	@.venv-torch/bin/python -m benchmarks.exchange.compare

neurobench: images .venv-torch/.installed ## Our metrics beside the package neurobench (LAVA_VPR_DATA; the environment of ci-torch)
	@.venv-torch/bin/python -m benchmarks.neurobench.metrics

.venv-docs/.installed: pyproject.toml requirements/lock.txt requirements/docs.txt | $(STAMP)
	$(call environment_beside,requirements/docs.txt)

tutorial: .venv-docs/.installed ## Execute the notebooks of docs/notebooks
	@.venv-docs/bin/python scripts/run_notebook.py

site: .venv-docs/.installed links ## Build the documentation as a site into site/, warnings are errors
	@NO_MKDOCS_2_WARNING=1 .venv-docs/bin/mkdocs build --quiet --strict && echo "site/index.html"

pictures: $(STAMP) ## Compute the pictures of README and docs again
	@$(BIN)/python scripts/draw.py

wheel: $(STAMP) ## Build the wheel into dist/
	@rm -rf dist build && $(BIN)/python -m build --quiet --no-isolation --wheel .

clean: ## Remove everything made here, the environment too
	rm -rf .venv .venv-* .typing .cache site demo dist build *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .coverage
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

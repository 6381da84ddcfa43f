# Everything runs in .venv, made here from constraints.txt. Needs Python 3.11+, make and git.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check install --quiet -c constraints.txt
DEMO := out/demo
JOBS ?= 2
PAPER_TASKS := tube,cylinder,sphere,fit,top,mug

.PHONY: help demo test check bench freeze verify-splits clean

help: ## list the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 15

$(VENV)/python: constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "eigenbench needs Python 3.11 or newer, $(PYTHON) is %d.%d; pass PYTHON=..." % sys.version_info[:2])'
	$(PYTHON) -m venv $(VENV)
	touch $@

$(VENV)/core: $(VENV)/python setup.cfg pyproject.toml
	$(PIP) -e .
	touch $@

$(VENV)/dev: $(VENV)/core
	$(PIP) torch
	$(PIP) -e '.[dev]'
	touch $@

demo: $(VENV)/core ## generate some pairs of the six tasks of the paper, look at them, verify them, score three examples
	rm -rf $(DEMO)
	$(BIN)/eigenbench generate --task $(PAPER_TASKS) --pairs 1000 --out $(DEMO)
	$(BIN)/eigenbench info $(DEMO)
	$(BIN)/eigenbench verify $(DEMO)
	for model in constant object_only bounding_box; do \
		$(BIN)/eigenbench evaluate examples/$$model.py --data $(DEMO)/tube/test --out $(DEMO)/runs/$$model || exit; \
	done

test: $(VENV)/dev ## run all tests, JOBS=2 files at a time
	$(BIN)/python -m pytest -q -n $(JOBS) --dist loadfile

check: $(VENV)/dev ## format, lint, types, layout
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	rm -rf .typecheck
	$(BIN)/python -m pip --disable-pip-version-check install --quiet --no-deps --no-build-isolation --target .typecheck .
	MYPYPATH=.typecheck $(BIN)/mypy -p eigenbench
	$(BIN)/python -m pytest -q tests/test_layout.py

$(VENV)/bench: $(VENV)/core
	$(PIP) -e '.[bench,torch]'
	touch $@

bench: $(VENV)/bench ## seconds, memory, ratios to other engines and mismatches of all tasks; BENCH=--quick is a tenth
	$(BIN)/python tests/bench_tasks.py --out out/mismatches.json $(BENCH)
	$(BIN)/python tests/bench_fit.py
	$(BIN)/python tests/bench_tube.py
	$(BIN)/python tests/bench_shapes.py
	$(BIN)/python tests/bench_navigation.py
	$(BIN)/python tests/bench_navigate.py
	$(BIN)/python tests/bench_training.py

freeze: $(VENV)/core ## make and record the frozen splits that have no record yet: the full data, task by task
	$(BIN)/python tests/freeze.py $(FREEZE)

verify-splits: $(VENV)/core ## make every frozen split again and compare its digests
	$(BIN)/python tests/freeze.py --check $(FREEZE)

clean: ## remove what the targets above made
	rm -rf $(VENV) .typecheck build out/demo *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis

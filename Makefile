# Two commands for everyone: `make demo` and `make test`. For developers: check, coverage, bench, format, clean.
.DEFAULT_GOAL := help
SHELL := /bin/bash

VENV ?= .venv
PYTHON := $(VENV)/bin/python
STAMP := $(VENV)/.installed
DEV_STAMP := $(VENV)/.installed-dev
WORKERS ?= 2
SEEDS ?= 1001 1002 1003
RECORD ?= same-bytes.json
MUTANTS ?=
SEED ?= 1

.PHONY: help notebook demo test test-benchmarks coverage check lint types layers english bench bench-server bench-selection bench-planners bench-faults bench-reactive \
	bench-responsibility bench-weights bench-routes bench-generation bench-modification bench-manoeuvres bench-edits bench-import-crashes bench-drivable bench-same-bytes \
	bench-robust bench-hostile bench-symmetries bench-kills bench-mutation bench-growth bench-chain bench-answers bench-agent bench-maps bench-osm-tags bench-places bench-analysis bench-tuning bench-failures bench-serve bench-loop bench-database bench-peers \
	dist requirements bundle starter house chat-page tutorial-page reference docs train-rbfn format clean

help:
	@echo "make demo    set everything up, take a scenario through every stage, and find a failure (in demo-output/)"
	@echo "make test    set everything up and run the tests"
	@echo "make test-benchmarks"
	@echo "             run the tests of the benchmarks, which are not in the package (developers)"
	@echo "make coverage run the tests with coverage; fail below the limit in pyproject.toml (developers)"
	@echo "make check   lint, types, import directions and English (developers)"
	@echo "make bench   measure the figures in benchmarks/FIGURES.md; takes long (developers)"
	@echo "make bench-same-bytes RECORD=after.json BEFORE=before.json"
	@echo "             record digests of the results of fixed requests; with BEFORE, list the differences (developers)"
	@echo "make bench-loop  measure how reliable verdicts on planners are (developers)"
	@echo "make bench-database FOLDER=FOLDER"
	@echo "             run every scenario of a folder, such as the public CommonRoad database, under every planner (developers)"
	@echo "make bench-peers FOLDER=FOLDER"
	@echo "             import foreign CommonRoad, OpenDRIVE and Lanelet2 files and judge the results (developers)"
	@echo "make bench-places FOLDER=FOLDER"
	@echo "             find OpenStreetMap extracts of a folder by other spellings of their places (developers)"
	@echo "make dist    build sdist and wheel into dist/ (developers)"
	@echo "make requirements update the versions in packaging/requirements.txt; needs uv (developers)"
	@echo "make bundle  build the bundle that hosts install with a click (.mcpb) into dist/; needs Node (developers)"
	@echo "make starter regenerate the packaged maps and the starter catalogue (developers)"
	@echo "make train-rbfn train the network of the planner MP-RBFN again, with the same weights (developers)"
	@echo "make house   draw the diagram of the packages (developers)"
	@echo "make chat-page record docs/chat.md, a chat through five stages (developers)"
	@echo "make notebook run the documentation's notebook (developers)"
	@echo "make tutorial-page record docs/tutorial.md and its pictures (developers)"
	@echo "make reference generate docs/reference and docs/settings.md from the program (developers)"
	@echo "make docs    build the documentation into site/ (developers)"
	@echo "make bench-robust SEEDS=\"1 2 3\""
	@echo "             measure soundness: hostile inputs, growth, symmetries, new data with these seeds, killed servers (developers)"
	@echo "make clean   remove built files"

demo: $(STAMP)
	@echo "==> Running the demo: a real MCP client takes a scenario through every stage"
	@$(VENV)/bin/plannerforge demo

test: $(DEV_STAMP)
	@echo "==> Running the tests of the product on $(WORKERS) processes"
	@$(PYTHON) -m pytest -n $(WORKERS) --dist worksteal --ignore=tests/benchmarks

test-benchmarks: $(DEV_STAMP)
	@echo "==> Running the tests of the benchmarks on $(WORKERS) processes"
	@$(PYTHON) -m pytest -n $(WORKERS) --dist worksteal tests/benchmarks

$(STAMP): pyproject.toml packaging/requirements.txt scripts/setup.sh
	@bash scripts/setup.sh $(VENV)
	@touch $@

$(DEV_STAMP): $(STAMP)
	@echo "==> Installing the tests' dependencies"
	@bash scripts/setup.sh $(VENV) dev
	@touch $@

coverage: $(DEV_STAMP)
	@echo "==> Running the tests with coverage on $(WORKERS) processes"
	@$(PYTHON) -m pytest -n $(WORKERS) --dist worksteal --cov --cov-branch --cov-report term $(TESTS)

check: lint types layers english

lint: $(DEV_STAMP)
	@echo "==> Lint"
	@$(VENV)/bin/ruff format --check .
	@$(VENV)/bin/ruff check .

types: $(DEV_STAMP)
	@echo "==> Types"
	@$(VENV)/bin/mypy -p plannerforge -p benchmarks

layers: $(DEV_STAMP)
	@echo "==> Import directions"
	@$(VENV)/bin/lint-imports

english: $(DEV_STAMP)
	@echo "==> English"
	@$(VENV)/bin/codespell README.md CONTRIBUTING.md docs agent cli engine evals library prompts resources schemas server tools workflows scripts
	@$(PYTHON) scripts/check_english.py

bench: bench-server bench-planners bench-faults bench-reactive bench-responsibility bench-weights bench-modification bench-generation \
	bench-selection bench-drivable bench-import-crashes bench-hostile bench-symmetries bench-kills bench-mutation bench-growth bench-chain bench-answers bench-agent bench-maps bench-analysis bench-tuning bench-failures bench-serve bench-loop

bench-server: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.serve.workers

bench-selection: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.selection

bench-planners: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.planners

bench-faults: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.faults.planners

bench-reactive: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.planners.reactive

bench-responsibility: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.planners.responsibility

bench-weights: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.planners.weights

bench-routes: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.planners.routes

bench-generation: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.generation

bench-maps: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.maps --workers $(WORKERS)

bench-osm-tags: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.maps --only tags

bench-places: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.maps.places "$(FOLDER)" --workers $(WORKERS)

bench-modification: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.modification --workers $(WORKERS)

bench-manoeuvres: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.selection.manoeuvres $(if $(FOLDER),--folder "$(FOLDER)") $(if $(SEED),--seed $(SEED))

bench-edits: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.modification.new_edits --advice 240

bench-drivable: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.modification.drivable

bench-import-crashes: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.faults.imports

bench-robust: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.robustness.soundness --seeds $(SEEDS)

bench-hostile: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.robustness --keep soundness/findings

bench-symmetries: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.symmetries --workers $(WORKERS)

bench-kills: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.faults.mixed_load

bench-mutation: $(DEV_STAMP)
	@$(VENV)/bin/mutmut run --max-children $(WORKERS) $(MUTANTS)
	@$(VENV)/bin/mutmut results
	@$(VENV)/bin/mutmut export-cicd-stats && cat mutants/mutmut-cicd-stats.json

bench-growth: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.growth

bench-chain: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.chain

bench-agent: $(DEV_STAMP)
	@$(PYTHON) -m plannerforge.evals --workers $(WORKERS)

bench-answers: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.answers

bench-analysis: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.analysis

bench-tuning: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.tuning $(addprefix --reference ,$(REFERENCE)) $(addprefix --reference-python ,$(REFERENCE_PYTHON))

bench-failures: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.failures

bench-serve: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.serve

bench-loop: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.loop

bench-database: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.loop.database $(addprefix --folder ,$(FOLDER)) --workers $(WORKERS)

bench-peers: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.maps.peers.bench $(addprefix --folder ,$(FOLDER)) $(addprefix --part ,$(PART)) $(addprefix --asam ,$(ASAM))

dist: $(DEV_STAMP)
	@echo "==> Building sdist and wheel"
	@rm -f dist/plannerforge_mcp-*
	@$(PYTHON) -m build --no-isolation --outdir dist
	@cp packaging/requirements.txt dist/plannerforge_mcp-requirements.txt

# Unimported packages are left out: docs/install.md.
requirements:
	@echo "==> Choosing the versions of all dependencies (uv)"
	@printf "%s ; python_version < '3'\n" polygon3 | uv pip compile pyproject.toml --quiet \
		--universal --python-version 3.11 --upgrade --custom-compile-command "make requirements" --no-annotate --overrides /dev/stdin -o packaging/requirements.txt

bundle: dist
	@echo "==> Building the bundle"
	@$(PYTHON) scripts/bundle.py

train-rbfn: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.planners.rbfn_training

bench-same-bytes: $(DEV_STAMP)
	@$(PYTHON) -m benchmarks.symmetries.same_bytes record $(RECORD)
	@if [ -n "$(BEFORE)" ]; then $(PYTHON) -m benchmarks.symmetries.same_bytes compare $(BEFORE) $(RECORD); fi

starter: $(DEV_STAMP)
	@$(PYTHON) -m plannerforge.engine.maps.drawn_library
	@$(PYTHON) -m plannerforge.engine.generation.starter_catalog

chat-page: $(DEV_STAMP)
	@echo "==> Recording docs/chat.md"
	@$(PYTHON) scripts/record_chat.py

notebook: $(DEV_STAMP)
	@$(PYTHON) scripts/record_notebook.py

tutorial-page: $(DEV_STAMP)
	@echo "==> Recording docs/tutorial.md and its pictures"
	@$(PYTHON) scripts/record_tutorial.py

reference: $(DEV_STAMP)
	@echo "==> Writing docs/reference and docs/settings.md"
	@$(PYTHON) scripts/write_reference.py

docs: $(DEV_STAMP)
	@echo "==> Building the documentation into site/"
	@NO_MKDOCS_2_WARNING=1 $(VENV)/bin/mkdocs build --strict --quiet

house: $(DEV_STAMP)
	@echo "==> Drawing docs/house.svg from the imports"
	@$(PYTHON) scripts/draw_house.py

format: $(DEV_STAMP)
	@$(VENV)/bin/ruff format .
	@$(VENV)/bin/ruff check --fix .

clean:
	@rm -rf $(VENV) site build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache .coverage .coverage.* demo-output soundness mutants
	@find . -name __pycache__ -type d -not -path './$(VENV)/*' -prune -exec rm -rf {} +

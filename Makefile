# Each target sets up what it needs in an environment of its own: uv if it is there, else venv and pip.
#   make test PYTHON=python3.12 VENV=.venv-3.12

VENV ?= .venv
OUT ?= out
WORKERS ?= auto
OTHERS ?= 3.12 3.13
PYTHON ?= $(shell for name in python3.11 python3 python3.12 python3.13; do \
	"$$name" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && { echo "$$name"; break; }; done)
UV := $(shell command -v uv 2>/dev/null)
BIN := $(VENV)/bin
INTERPRETER := $(BIN)/python
PYTEST := env -u PYTHONDONTWRITEBYTECODE $(INTERPRETER) -m pytest
TOGETHER := $(PYTEST) --numprocesses $(WORKERS) --dist worksteal
LIMITED := -o faulthandler_timeout=600 -o faulthandler_exit_on_timeout=true # a test that hangs fails, and shows where
LONG := large or stress or faults or rest
UNASKED := alone or $(LONG)
FORM ?= $(word $(shell echo $$(( $$(date -u +%s) / 86400 % 4 + 1 ))),large stress faults rest)
RUN_READY := $(VENV)/.ready-to-run
WAVE := $(BIN)/graspfx run paper-waving --overwrite
WORK_READY := $(VENV)/.ready-to-work
SITE_READY := $(VENV)/.ready-for-the-site

.DEFAULT_GOAL := help
.PHONY: help bench demo pictures screenshots map face reference site fast test alone together long part others wheel lock sizes durations mutations coverage lint types contracts clean

help: ## show what there is to make
	@sed -n 's/^\([a-z]*\):.*## /\1\t/p' $(firstword $(MAKEFILE_LIST)) | expand -t 12

demo: $(RUN_READY) ## wave a cube with one stiffness and with two: too soft, unstable, both good; and the paper's own pair
	@echo "Waving a cube, ten seconds each. In a hand of little damping (--preset light-hand):"
	@echo "  too-soft      one stiffness, 30 N/m: stable, and the fingers sink in"
	@echo "  unstable      one stiffness, 70 N/m: less deep, and the external force grows into an oscillation"
	@echo "  both-good     30 N/m for the external, 70 N/m for the internal force: less deep, and stable"
	@$(WAVE) --preset light-hand --set coupling.internal.stiffness=30 --no-figure --out $(OUT)/light-hand/too-soft >/dev/null
	@$(WAVE) --preset light-hand --set coupling.external.stiffness=70 --no-figure --out $(OUT)/light-hand/unstable >/dev/null
	@$(WAVE) --preset light-hand --no-figure --out $(OUT)/light-hand/both-good >/dev/null
	@$(BIN)/graspfx plot $(addprefix $(OUT)/light-hand/,too-soft unstable both-good) --brief --out $(OUT)/light-hand --overwrite
	@echo
	@echo "In a hand as of the paper's Figs. 12 and 13:"
	@echo "  conventional  one stiffness, 30 N/m"
	@echo "  proposed      30 N/m for the external, 70 N/m for the internal force"
	@echo "Both are stable in this hand: every vibration is below 1 mN, and the proposed gains sink in less."
	@$(WAVE) --set coupling.internal.stiffness=30.0 --out $(OUT)/conventional >/dev/null
	@$(WAVE) --out $(OUT)/proposed >/dev/null
	@$(BIN)/graspfx plot $(OUT)/conventional/recording.h5 $(OUT)/proposed/recording.h5 --brief --out $(OUT) --overwrite

pictures: demo ## draw every figure of the docs: of the demo, scenes and explanations
	@cp $(OUT)/light-hand/comparison.png docs/pictures/demo.png
	@$(INTERPRETER) docs/pictures/the_paper_answered.py
	@$(INTERPRETER) docs/pictures/device_masses.py
	@$(INTERPRETER) docs/pictures/which_split.py
	@$(INTERPRETER) docs/pictures/your_own_scene.py
	@$(INTERPRETER) docs/pictures/feedback.py
	@$(BIN)/graspfx stability paper-spring --sweep object.viscosity=0.8:1.5:15 --out $(OUT)/fig-15 --overwrite >/dev/null
	@cp $(OUT)/fig-15/stability.png docs/pictures/stability-paper-spring.png
	@$(INTERPRETER) -c 'from graspfx import plugins; print(*(n for n, o in plugins.names("scenes").items() if o.startswith("GraspFX")))' \
		| xargs -n 1 | while read -r name; do \
			$(BIN)/graspfx picture "$$name" $$(sed -n "s/^    graspfx picture $$name //p" docs/scenes.md) \
				--overwrite --out "docs/pictures/scenes/$$name.png" </dev/null || exit 1; done

screenshots: $(WORK_READY) ## draw the pages that browsers show, where there is a Chromium
	$(INTERPRETER) -m tests.support.screenshots

map: $(WORK_READY) ## draw the map of rooms from the code
	$(INTERPRETER) -m tests.support.rooms > docs/development/map.md

face: reference

reference: $(WORK_READY) ## write the pages of names, keys, commands and drivers from the code
	$(INTERPRETER) -m tests.support.face > docs/reference/python.md
	$(INTERPRETER) -m tests.support.scene_reference > docs/reference/scene.md
	$(INTERPRETER) -m tests.support.command_reference > docs/reference/commands.md
	$(INTERPRETER) -m tests.support.driver_reference > docs/reference/drivers.md

site: $(SITE_READY) ## build the documentation site: out/site/index.html; GRASPFX_SITE_CELLS=off runs no cells
	$(INTERPRETER) -m sphinx --quiet --fail-on-warning --keep-going docs $(OUT)/site
	$(INTERPRETER) -m tests.support.built_site $(OUT)/site

test: alone together ## the tests and every example in the docs

alone: $(WORK_READY)
	@$(INTERPRETER) -c 'import importlib.util as u; u.find_spec("pybullet") or print("PyBullet is not installed here: what names it is skipped.")'
	$(PYTEST) $(LIMITED) -m "alone and not ($(LONG))" tests

together: $(WORK_READY)
	$(TOGETHER) $(LIMITED) -m "not ($(UNASKED))"

long: $(WORK_READY) ## one of the long forms of the tests, another one each day; or make long FORM=stress
	$(TOGETHER) -m "$(FORM)"

part: $(WORK_READY) ## of every room a test file or two, by tests/part.txt: what other Pythons are tried with
	$(TOGETHER) $(LIMITED) -m "not ($(UNASKED) or slow)" $$(sed 's/#.*//' tests/part.txt)

others: $(WORK_READY) ## that part on other Pythons, each in an environment of its own; one that is not here is left out
	@for version in $(OTHERS); do \
		if python=$$($(INTERPRETER) -m tests.support.interpreters $$version); then \
			echo "Python $$version: $$python"; \
			$(MAKE) --no-print-directory part PYTHON=$$python VENV=$(VENV)-$$version || exit 1; \
		else echo "Python $$version is not here: the tests on it are left out."; fi; \
	done

wheel: $(WORK_READY) ## build wheel and source distribution, and run them in a fresh environment, outside of the checkout
	$(INTERPRETER) -m tests.support.clean_install --out dist

lock: ## pin the versions that are tested: .ci/requirements.txt
	uv pip compile --quiet --universal --python-version 3.11 --all-extras --no-emit-index-url --no-header \
		--custom-compile-command "make lock" pyproject.toml -o .ci/requirements.txt $(UPGRADE)

bench: $(WORK_READY) ## measure GraspFX beside its peers, those of [bench] that can be installed, and write docs/benchmarks.md
	$(INSTALL) --editable '.[dev,bench]'
	$(INTERPRETER) -m tests.bench --out docs $(if $(QUICK),--quick)

sizes: $(WORK_READY) ## measure what an installation takes, by extra
	$(INTERPRETER) -m tests.support.sizes

fast: $(WORK_READY) ## most of the tests in under a minute: of each, as many cases as take 0.05 s
	$(TOGETHER) $(LIMITED) -m "not ($(UNASKED) or slow)"

durations: $(WORK_READY) ## measure how long each test takes: what `make fast` and `make test` choose by
	$(TOGETHER) -p tests.support.slow -m "not (alone or large or stress or faults)"

mutations: $(WORK_READY) ## put fifty mistakes into a copy, one at a time, and tell which tests find each: half an hour
	$(INTERPRETER) -m tests.support.mutations

coverage: $(WORK_READY) ## which lines the tests run, by file; kernels run as text of their own: docs/development/tests.md
	@mkdir -p out/coverage
	$(INTERPRETER) -m coverage erase
	$(INTERPRETER) -m coverage run -m pytest --numprocesses $(WORKERS) --dist worksteal -m "not ($(UNASKED))"
	$(INTERPRETER) -m coverage run -m pytest --ignore tests/bench -m "alone and not ($(LONG))" tests
	$(INTERPRETER) -m coverage combine --quiet
	$(INTERPRETER) -m coverage report | tee out/coverage/report.txt

lint: $(WORK_READY) ## style and format
	$(BIN)/ruff check .
	$(BIN)/ruff check --preview --select PLW1514 graspfx devices # an encoding wherever text is read or written
	$(BIN)/ruff format --check .

types: $(WORK_READY) ## static types
	$(BIN)/mypy

contracts: $(WORK_READY) ## which module may import which
	$(BIN)/lint-imports

clean: ## remove the environment and what the demo wrote
	rm -rf $(VENV) $(OUT)

$(INTERPRETER):
ifneq ($(UV),)
	$(UV) venv --quiet $(if $(PYTHON),--python $(PYTHON),--python 3.11) $(VENV)
else
	@test -n "$(PYTHON)" || { echo "GraspFX needs Python 3.11 or later: none was found on the PATH; name one with make PYTHON=..." >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
endif

ifneq ($(UV),)
INSTALL := $(UV) pip install --quiet --python $(INTERPRETER)
else
INSTALL := $(INTERPRETER) -m pip install --quiet --disable-pip-version-check
endif

$(RUN_READY): $(INTERPRETER) pyproject.toml
	$(INSTALL) --editable .
	$(BIN)/graspfx warmup --kernels
	@touch $@

$(WORK_READY): $(INTERPRETER) pyproject.toml
	$(INSTALL) --editable '.[dev]'
	@touch $@ $(RUN_READY)

$(SITE_READY): $(INTERPRETER) pyproject.toml
	$(INSTALL) --editable '.[dev,docs]'
	@touch $@ $(WORK_READY) $(RUN_READY)

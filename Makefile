# Two verbs for a newcomer: `make book` and `make test`. `make help` lists all of them.
# Works with GNU make 3.81, macOS's own. Variables (see environment/README.md): PYTHON, GVP_TORCH, GVP_VENV, MUJOCO_GL.
# Tests are of three tiers, by marker: `check` (make check), none (make test), `full` (make test-all).

GVP_VENV ?= $(CURDIR)/.venv
BIN := $(GVP_VENV)/bin
RUN := $(BIN)/python
NOTEBOOKS := $(wildcard notebooks/*.ipynb)
# Tests on all cores, but four at most: each process draws, solves and may bring workers of its own. A file's tests stay
# together, for they share what one of them made; and their order stays, in which the longest come first. A process that
# dies is not replaced: the next would die of the same test. Each draws and computes in one thread, since the others
# have the other cores.
SHARED := -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder --max-worker-restart 0
SLOWEST := --durations 15 --durations-min 5
ALONE := LP_NUM_THREADS=1 OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
PYTEST := $(ALONE) $(RUN) -m pytest $(SHARED) $(SLOWEST)
SPHINX := $(RUN) -m sphinx -W --keep-going -q -b html -d book/_build/doctrees book book/_build/html

export GVP_VENV
# PYTHON is setup's: a variable for one script, not a program of ours.
ifdef PYTHON
export PYTHON
endif
# A Linux without a screen draws by EGL.
ifeq ($(shell uname -s)$(DISPLAY)$(WAYLAND_DISPLAY),Linux)
MUJOCO_GL ?= egl
export MUJOCO_GL
endif

.DEFAULT_GOAL := help
.PHONY: help setup book html check test full test-all store golden pdf stick lab lint bench pins lock wheel clean

help: ## list these verbs
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | awk -F ':.*## ' '{ printf "  make %-8s %s\n", $$1, $$2 }'

setup: ## make .venv with exactly what the lock pins (the other verbs call it; at once when nothing changed)
	@environment/setup.sh

book: setup ## run every notebook live that is not up to date, then build the book: book/_build/html/index.html
	$(RUN) book/execute.py
	GVP_OUTPUTS=_build/notebooks $(SPHINX)
	@echo "The book: $(CURDIR)/book/_build/html/index.html"

html: setup ## build the same pages from the stored outputs, without running anything
	$(SPHINX)
	@echo "The book: $(CURDIR)/book/_build/html/index.html"

check: setup ## in two minutes: the pure modules, the planners, one small cell for each arm, each command once
	$(PYTEST) -m "check and not full"

test: setup ## that, the other unit tests, each notebook once, and the book from its stored outputs
	$(PYTEST) -m "not full" --nbval-lax --nbval-current-env --nbval-cell-timeout 300 \
		$(NOTEBOOKS) tests gvp_lib book/gvp_book

full: setup ## what test-all has beyond test: the pages in a browser, the PDF, stored results, kills, the wheel
	@environment/browser.sh
	$(PYTEST) -m full
	$(RUN) tests/golden.py check
	environment/try_wheel.sh

test-all: test full ## everything

store: setup ## for authors: run the notebooks that are not up to date, and store their outputs in notebooks/
	$(RUN) book/store.py

golden: setup ## for authors: write the golden episodes anew, where a change of them is meant (NAME=... for some)
	$(RUN) tests/golden.py write $(NAME)

pdf: setup ## the whole book as one PDF, from the stored results (wants a Chromium)
	@environment/browser.sh
	$(RUN) book/pdf.py

stick: setup ## the whole book in one archive, which opens anywhere without a network: book/_build/book.zip
	$(SPHINX)
	cd book/_build && $(RUN) -m zipfile -c book.zip html/
	@echo "Unpack $(CURDIR)/book/_build/book.zip anywhere and open html/index.html"

lab: setup ## open the notebooks in JupyterLab
	$(BIN)/jupyter lab notebooks

lint: setup ## style, format, types, spelling and public docstrings
	$(RUN) -m ruff check
	$(RUN) -m ruff format --check
	$(RUN) -m mypy
	$(RUN) -m codespell_lib
	$(RUN) -m pytest tests/test_docstrings.py

bench: setup ## measure this version against 0.1, and what the book says of speed: an hour and more (ONLY=... for some)
	$(RUN) tests/benchmarks/versions.py $(ONLY)

pins: setup ## ask the registry whether each pin has a wheel for every supported system and Python
	environment/check_pins.sh

lock: setup ## write the lock anew from pyproject.toml (UPGRADE=--upgrade takes the newest of everything)
	environment/write_lock.sh $(UPGRADE)

wheel: setup ## build the wheel and try it, and the notebooks on it, in an empty environment, the clone out of sight
	environment/try_wheel.sh

clean: ## remove what the verbs built, and keep .venv
	rm -rf dist build book/_build book/notebooks book/_static/generated .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find gvp_lib tests book notebooks -name __pycache__ -prune -exec rm -rf {} + 2>/dev/null || true

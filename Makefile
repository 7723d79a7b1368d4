# Every target sets up its own environment in .venv; nothing outside this folder is touched.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/.ready

# The dense blocks are small: more BLAS threads wait for each other longer than they work.
export OPENBLAS_NUM_THREADS ?= 1

# Bytecode is written even where the environment says otherwise: else each process of the tests, each worker of a command
# and each command compiles every module anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-all test-lowest test-newest lint docs picture house benchmark blind fuzz published clean

demo: $(READY)
	$(BIN)/lamella demo -o out/demo

# Files in the order of their folders: those with few and long tests come before the many short ones, which even out the end.
test: $(READY)
	$(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder

test-all: $(READY)
	$(BIN)/python -m pytest -m "not benchmark and not blind" -n auto --dist loadfile --no-loadscope-reorder

# The oldest versions that pyproject.toml allows, and the newest there are, each in an environment of its own. What needs
# other programs or a browser is left to `make test`. TESTS=tests runs all.
TESTS ?= tests/unit tests/conformance tests/literature

test-lowest: out/lowest/bin/uv
	out/lowest/bin/uv pip install --quiet --python out/lowest/bin/python --resolution lowest-direct \
		--only-binary :all: --no-binary lamella --editable ".[dev]"
	out/lowest/bin/python -m pytest $(TESTS) -n auto --dist loadfile

test-newest: out/newest/bin/uv
	out/newest/bin/uv pip install --quiet --python out/newest/bin/python --upgrade --editable ".[dev]"
	out/newest/bin/python -m pytest $(TESTS) -n auto --dist loadfile

out/%/bin/uv:
	$(PYTHON) -m venv out/$*
	out/$*/bin/python -m pip install --quiet uv

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# A build that was stopped leaves an index that the next one stumbles over.
docs: $(READY)
	test -f out/docs/searchindex.js || rm -rf out/docs
	$(BIN)/sphinx-build --fail-on-warning --keep-going --quiet -j auto docs out/docs

picture: $(READY)
	$(BIN)/lamella demo -o out/demo
	$(BIN)/python docs/pictures/story.py out/demo docs/pictures/story.png
	$(BIN)/python docs/pictures/tutorial.py out/demo docs/pictures

house: $(READY)
	$(BIN)/python docs/pictures/house.py docs/pictures/house.svg

benchmark: $(READY)
	$(BIN)/python -m pip install --quiet --quiet --editable ".[dev,peers]"
	$(BIN)/python -m pytest -m benchmark -s

blind: $(READY)
	$(BIN)/python -m pytest -m blind -s

# MINUTES of mutated inputs; what finds a fault is kept in out/fuzz and read first the next time.
MINUTES ?= 10

fuzz: $(READY)
	$(BIN)/python -m tests.recovery.fuzz --minutes $(MINUTES) --corpus out/fuzz

published: $(READY)
	$(BIN)/python -m tests.studies.published -o out/published

clean:
	rm -rf $(VENV) build dist out docs/auto_examples docs/reference *.egg-info .pytest_cache .mypy_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# uv sets up in a third of pip's time; it does not know pip's settings, so that with an index of their own pip does it.
# What the commands import is compiled once; the rest where it is first imported, which takes less than all at once.
$(READY): pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Lamella needs Python 3.11 or newer: make PYTHON=python3.12 ...")'
	$(PYTHON) -m venv $(VENV)
	! $(BIN)/python -m pip config list | grep -q index && $(BIN)/python -m pip install --quiet --no-compile uv \
		&& $(BIN)/uv pip install --quiet --python $(BIN)/python --editable ".[dev]" \
		|| { $(BIN)/python -m pip install --quiet --upgrade pip \
		&& $(BIN)/python -m pip install --quiet --quiet --no-compile --editable ".[dev]"; }
	$(BIN)/python -c "from updating import commands; [getattr(commands, name) for name in commands.__all__]"
	touch $(READY)

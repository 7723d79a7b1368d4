# Every target sets up its own environment in .venv; nothing outside this folder is touched.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/.ready

# The dense blocks are small: more BLAS threads wait for each other longer than they work.
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: demo test test-all lint docs picture benchmark blind published clean

demo: $(READY)
	$(BIN)/lamella demo -o out/demo

# Files in the order of their folders: those with few and long tests come before the many short ones, which even out the end.
test: $(READY)
	$(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder

test-all: $(READY)
	$(BIN)/python -m pytest -m "not benchmark and not blind" -n auto --dist loadfile --no-loadscope-reorder

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/mypy tests/examples/scripted_updating.py docs/pictures/story.py docs/api/build.py

docs: $(READY)
	$(BIN)/python -W error docs/api/build.py out/docs

picture: $(READY)
	$(BIN)/lamella fit data/hidden_effect/b/campaign.toml -o out/b
	$(BIN)/lamella diagnose data/hidden_effect/b/campaign.toml -o out/b
	$(BIN)/python docs/pictures/story.py out/b docs/pictures/story.png

benchmark: $(READY)
	$(BIN)/python -m pip install --quiet --quiet --editable ".[dev,peers]"
	$(BIN)/python -m pytest -m benchmark -s

blind: $(READY)
	$(BIN)/python -m pytest -m blind -s

published: $(READY)
	$(BIN)/lamella published -o out/published

clean:
	rm -rf $(VENV) build dist out *.egg-info .pytest_cache .mypy_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(READY): pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Lamella needs Python 3.11 or newer: make PYTHON=python3.12 ...")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --quiet --editable ".[dev]"
	touch $(READY)

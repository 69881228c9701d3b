# Each target does its own set-up in .venv; PYTHON names the interpreter (3.11 or newer) to make it from.
PYTHON ?= python3
BIN := .venv/bin
PIP := $(BIN)/pip install -q --disable-pip-version-check -c constraints.txt
OUT ?= out

.PHONY: demo test lint lowest bench notebooks browser clean

demo: .venv/demo
	$(BIN)/k1607 equations
	$(BIN)/k1607 reproduce --out $(OUT)
	$(BIN)/k1607 view --html $(OUT)/k1607.html
	$(BIN)/k1607 simulate 1 --html $(OUT)/case-1.html
	$(BIN)/k1607 simulate 2 --html $(OUT)/case-2.html
	@echo "Look at $(OUT)/index.html (results and figures), $(OUT)/k1607.html (the arm in 3-D), $(OUT)/case-1.html and case-2.html (animations)."

test: .venv/test browser
	$(BIN)/pytest -n auto --nbmake tests notebooks

lint: .venv/lint
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# The lower bounds of pyproject.toml, installed in .venv-lowest: run it when a bound or the use of a library changes.
lowest:
	PYTHON=$(PYTHON) tests/lowest_versions.sh .venv-lowest

bench: .venv/bench
	$(BIN)/python benchmarks/bench_kinematics.py
	$(BIN)/python benchmarks/bench_dynamics.py
	$(BIN)/python benchmarks/bench_rollouts.py --plot $(OUT)

notebooks: .venv/notebooks
	$(BIN)/jupyter lab notebooks

# A browser for the tests that look at the 3-D page: used if there is one, installed where that needs no question.
browser:
	@command -v chromium >/dev/null || command -v google-chrome >/dev/null || { \
	  [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null && \
	  { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends chromium >/dev/null; }; } || \
	  echo "No Chromium found and none could be installed: the browser tests will be skipped (in CI: will fail)."

.venv/python:
	$(PYTHON) -m venv .venv
	touch $@

.venv/demo: .venv/python pyproject.toml constraints.txt
	$(PIP) -e '.[viewer]'
	touch $@

.venv/test: .venv/python pyproject.toml constraints.txt
	$(PIP) -e '.[test]'
	touch $@

.venv/lint: .venv/python pyproject.toml constraints.txt
	$(PIP) -e '.[lint]'
	touch $@

.venv/bench: .venv/python pyproject.toml constraints.txt
	$(PIP) -e '.[benchmarks]'
	touch $@

.venv/notebooks: .venv/python pyproject.toml constraints.txt
	$(PIP) -e '.[notebooks]'
	touch $@

clean:
	rm -rf .venv .venv-lowest $(OUT)

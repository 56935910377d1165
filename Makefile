# make print   plan a shipped part and print it on the simulated robot
# make test    run all checks and tests
# make setup   make .venv with everything, once
# make bench   measure quality, speed and memory
# make view    look at a part, or at a result, in the browser

PART ?= parts/part1_dome.stl
BRR  ?=
OUT  ?= out/$(basename $(notdir $(PART)))
ARGS ?=

# The first Python that is new enough; choose another with PYTHON=...
PYTHON ?= $(shell for p in python3.12 python3.11 python3; do \
	$$p -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 12))' 2>/dev/null \
	&& echo $$p && break; done)

.PHONY: setup print test bench view parts urdf screenshots clean

setup:
	@test -n "$(PYTHON)" || { echo "make: no Python 3.11 or 3.12 found; name one with PYTHON=..." >&2; exit 2; }
	@$(PYTHON) tools/setup.py

# A part's own settings lie beside it; BRR replaces its restraint region.
print: setup
	@.venv/bin/vega print $(PART) -o $(OUT) $(if $(BRR),--brr $(BRR)) \
		$(addprefix --settings ,$(wildcard $(basename $(PART)).yaml)) $(ARGS)

test: setup
	@.venv/bin/python tools/setup_browser.py
	@.venv/bin/ruff check .
	@.venv/bin/ruff format --check -q .
	@.venv/bin/mypy
	@.venv/bin/python -m pytest $(ARGS)

bench: setup
	@.venv/bin/python bench/run.py $(ARGS)

view: setup
	@.venv/bin/vega view $(or $(wildcard $(OUT)),$(PART)) $(ARGS)

# Drawn files that are shipped: the sample parts and the expanded robot description.
parts: setup
	@.venv/bin/python parts/draw.py

urdf: setup
	@.venv/bin/python -m vega_planner.robot.description

screenshots: setup
	@.venv/bin/python tools/setup_browser.py
	@.venv/bin/python tools/draw_layers.py
	@.venv/bin/python tools/screenshots.py

clean:
	rm -rf build install log .venv out

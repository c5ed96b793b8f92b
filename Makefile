# SymGrasp's targets; `make` alone lists them.
PYTHON ?= python3
BIN := .venv/bin
SYMGRASP := $(BIN)/symgrasp
EVAL := build/eval
EVAL_ROOT := $(EVAL)/root
EVAL_ARGUMENTS := $(EVAL)/grasps.h5 --dataset $(EVAL_ROOT) --out $(EVAL)/report.json \
	--success $(EVAL)/success.json --baselines
# The seed of the training set: its seen objects are the trained ones, its scenes never are.
EVAL_SET := --split seen,similar,novel --scenes-per-split 6 --views 4 --objects 24 \
	--size 640x480 --grasp-points 48 --seed 0
WEIGHTS := $(wildcard pipelines/weights/*.safetensors)

.DEFAULT_GOAL := help
.PHONY: help install demo test check docs eval ablations weights bench golden clean

help: ## list the targets
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

install: .venv/developed ## make .venv and install symgrasp with its test tools into it

# Modules are compiled when first imported: most of those installed never are.
PIP_INSTALL := $(BIN)/python -m pip install --quiet --no-compile --editable

.venv/bin/python:
	$(PYTHON) -m venv .venv

.venv/installed: pyproject.toml | .venv/bin/python
	$(PIP_INSTALL) .
	touch $@

.venv/developed: pyproject.toml | .venv/bin/python
	$(PIP_INSTALL) '.[dev]'
	touch .venv/installed $@

demo: .venv/installed ## grasps on the bundled frames, pictures in build/demo
	$(SYMGRASP) infer pipelines/weights/frames --out build/demo/grasps.h5 --overlays build/demo --overwrite
	@echo "pictures: build/demo/*.png"

test: install ## all tests, on all cores that there is memory for
	$(BIN)/python -m pytest -q -n auto --dist worksteal

check: install docs ## format, lint, types, import layers, documentation
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: install ## the documentation as a site in build/site, without a warning
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict

eval: install $(EVAL)/report.json ## tables I, II, III, symmetry and mask AP in three splits, and build/eval/report.html
	$(SYMGRASP) evaluate $(EVAL_ARGUMENTS)
	@echo "report: $(EVAL)/report.html"

$(EVAL)/dataset.made: | install
	$(SYMGRASP) synthesize $(EVAL_ROOT) $(EVAL_SET) --no-collision-labels --workers 2
	$(SYMGRASP) annotate-symmetry $(EVAL_ROOT) --workers 2
	$(SYMGRASP) refine-grasps $(EVAL_ROOT) --workers 2
	touch $@

# What an interrupted run finished frame by frame or scene by scene is taken up again; what was made
# from older inputs, or by older code, is not.
$(EVAL)/grasps.h5: $(EVAL)/dataset.made $(WEIGHTS) $(wildcard pipelines/*.py pipelines/*/*.py)
	rm -f $@
	$(SYMGRASP) infer $(EVAL_ROOT) --out $@ --timings

$(EVAL)/success.json: $(EVAL)/grasps.h5
	rm -f $@
	$(SYMGRASP) simulate $< --dataset $(EVAL_ROOT) --out $@ --baselines --workers 2 > /dev/null

$(EVAL)/report.json: $(EVAL)/grasps.h5 $(EVAL)/success.json
	rm -f $@
	$(SYMGRASP) evaluate $(EVAL_ARGUMENTS) --workers 2 > /dev/null

# The same steps a row, whatever the machine; three seeds take three times as long.
ABLATIONS := build/ablations
SEEDS := 0
ROWS :=
STEPS := 4000
DETECTOR_STEPS := 1200
SCENES := 60
OBJECTS := 72
ablations: install $(EVAL)/dataset.made ## table IV, each part left out in turn, and build/ablations/ablations.md
	$(BIN)/python -m benchmarks.ablations $(EVAL_ROOT) --out $(ABLATIONS) --seeds $(SEEDS) --rows '$(ROWS)' \
		--steps $(STEPS) --detector-steps $(DETECTOR_STEPS) --scenes $(SCENES) --objects $(OBJECTS)
	@echo "table: $(ABLATIONS)/ablations.md"

SIZE := full
weights: install ## all default weights from nothing, in build/weights; SIZE=tiny in minutes
	SYMGRASP=$(SYMGRASP) tools/make_weights.sh build/weights/$(SIZE) $(SIZE)

BENCH :=
bench: install ## speeds of this machine, stage by stage
	$(BIN)/python -m benchmarks $(BENCH)

golden: install ## write the golden files anew; review the difference
	$(BIN)/python -m pytest -q tests/cli --golden
	$(BIN)/python tools/golden_frame.py
	$(BIN)/python tools/demo_picture.py

clean: ## remove what was built, not .venv
	rm -rf build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache

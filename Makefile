# SymGrasp's targets; `make` alone lists them.
PYTHON ?= python3
BIN := .venv/bin
SYMGRASP := $(BIN)/symgrasp
EVAL := build/eval
evaluated = $1/grasps.h5 --dataset $1/root --out $1/report.json --success $1/success.json --baselines
# With the seed of the training set: seen objects are training objects, scenes are always new.
SET_eval := --split seen,similar,novel --scenes-per-split 6 --views 4 --objects 24 --seed 0
# Seeds 700 to 799 are for decisions, seeds 900 to 999 are sealed; see docs/experiments/data-sets.md.
SET_dev := --split similar,novel --families wide --scenes-per-split 24 --views 4 --objects 96 \
	--sensor mixed --surroundings plain,plain,bin,tray,wall,edge --seed 700
SET_sealed := --split similar,novel --families sealed --scenes-per-split 160 --views 2 --objects 650 \
	--sensor mixed --surroundings plain,plain,bin,tray,wall,edge --seed 900
WEIGHTS := $(wildcard pipelines/weights/*.safetensors)
CODE := $(shell find pipelines -name '*.py' -o -name '*.toml')

.DEFAULT_GOAL := help
.PHONY: help install demo test check docs eval dev sealed ablations weights weights-paper tables bench golden clean

help: ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 16

install: .venv/developed ## make .venv and install symgrasp with its test tools into it

# Modules are compiled at their first import; most installed modules are never imported.
PIP_INSTALL := $(BIN)/python -m pip install --quiet --no-compile --editable

# A failed or killed creation leaves a .venv without pip or without `activate`, which is written last. A .venv with pip
# is kept; one that lacks only pip, as uv makes them, gets it.
.venv/created:
	$(BIN)/python -m pip show --quiet pip 2> /dev/null || { test -e $(BIN)/activate && $(BIN)/python -m ensurepip; } || \
	    $(PYTHON) -m venv --clear .venv
	touch $@

.venv/installed: pyproject.toml | .venv/created
	$(PIP_INSTALL) .
	touch $@

.venv/developed: pyproject.toml | .venv/created
	$(PIP_INSTALL) '.[dev]'
	touch .venv/installed $@

demo: .venv/installed ## grasps on the bundled frames, pictures in build/demo
	$(SYMGRASP) infer pipelines/weights/frames --out build/demo/grasps.h5 --overlays build/demo --overwrite
	@echo "pictures: build/demo/*.png"

test: install ## all tests, on as many cores as memory allows
	$(BIN)/python -m pytest -q -n auto --dist worksteal

check: install docs ## format, lint, types, import layers, documentation
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: install ## the documentation as a site in build/site, without a warning
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict

eval: install $(EVAL)/report.json ## tables I, II, III, symmetry and mask AP in three splits, and build/eval/report.html
	$(SYMGRASP) evaluate $(call evaluated,$(EVAL))
	@echo "report: $(EVAL)/report.html"

dev: install build/dev/report.json ## the same for decisions: other objects, bins, trays, walls
	$(SYMGRASP) evaluate $(call evaluated,build/dev)
	@echo "report: build/dev/report.html"

sealed: install ## the same for one final evaluation: >= 1,000 objects, families never trained on; about 2 h on two cores
	@test ! -e build/sealed/report.json || { echo "sealed is evaluated already: build/sealed/report.html"; exit 1; }
	$(MAKE) build/sealed/report.json

build/%/dataset.made: | install
	$(SYMGRASP) synthesize build/$*/root $(SET_$*) --size 640x480 --grasp-points 48 --no-collision-labels --workers 2
	$(SYMGRASP) annotate-symmetry build/$*/root --workers 2
	$(SYMGRASP) refine-grasps build/$*/root --workers 2
	touch $@

# The data set is made once; grasps and figures of older inputs or older code are made again. An interrupted run resumes
# from its frames or scenes. Parts of `infer` do not tell their code, so a change of the code removes them; later parts
# tell grasps.h5, which is another file after each `infer`, by the seconds of --timings.
build/%/code.made: $(CODE)
	mkdir -p $(@D)
	rm -rf build/$*/grasps.h5.parts
	touch $@

build/%/grasps.h5: build/%/dataset.made build/%/code.made $(WEIGHTS)
	rm -f $@
	$(SYMGRASP) infer build/$*/root --out $@ --timings

build/%/success.json: build/%/grasps.h5
	rm -f $@
	$(SYMGRASP) simulate $< --dataset build/$*/root --out $@ --baselines --workers 2 > /dev/null

build/%/report.json: build/%/grasps.h5 build/%/success.json
	rm -f $@
	$(SYMGRASP) evaluate $(call evaluated,build/$*) --workers 2 > /dev/null

.PRECIOUS: build/%/dataset.made build/%/code.made build/%/grasps.h5 build/%/success.json

# Each row has the same number of steps on every machine; three seeds take three times as long.
ABLATIONS := build/ablations
SEEDS := 0
ROWS :=
STEPS := 4000
DETECTOR_STEPS := 1200
SCENES := 60
OBJECTS := 72
ablations: install $(EVAL)/dataset.made ## table IV, each part left out in turn: build/ablations/ablations.md
	$(BIN)/python -m benchmarks.ablations $(EVAL)/root --out $(ABLATIONS) --seeds $(SEEDS) --rows '$(ROWS)' \
		--steps $(STEPS) --detector-steps $(DETECTOR_STEPS) --scenes $(SCENES) --objects $(OBJECTS)
	@echo "table: $(ABLATIONS)/ablations.md"

SIZE := full
weights: install ## all default weights from nothing, in build/weights; SIZE=small in hours, tiny in minutes
	SYMGRASP=$(SYMGRASP) tools/make_weights.sh build/weights/$(SIZE) $(SIZE)

weights-paper: install ## both networks as printed in the paper, in build/weights-paper; start weights COCO=FILE
	SYMGRASP=$(SYMGRASP) COCO=$(COCO) tools/make_weights.sh build/weights-paper/$(SIZE) $(SIZE) paper

DATASET :=
tables: install ## the paper's tables with compared methods and controls, build/tables; DATASET=ROOT; one or two days of two cores
	SYMGRASP=$(SYMGRASP) PYTHON=$(BIN)/python tools/make_tables.sh build/tables/$(SIZE) $(SIZE) $(DATASET)

BENCH :=
bench: install ## speeds of this machine, stage by stage
	$(BIN)/python -m benchmarks $(BENCH)

golden: install ## write the golden files again; review the difference
	$(BIN)/python -m pytest -q tests/cli --golden
	$(BIN)/python tools/golden_frame.py
	$(BIN)/python tools/demo_picture.py

clean: ## remove build outputs, not .venv
	rm -rf build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache

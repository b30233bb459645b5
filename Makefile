# Everything a clone needs: `make demo` and `make test` set up .venv themselves.

# The first Python that can make a virtual environment and for which the dependencies have wheels (3.11 to 3.13).
PYTHON ?= $(shell for python in python3 python3.13 python3.12 python3.11; do \
	$$python -c 'import ensurepip, sys, venv; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' >/dev/null 2>&1 \
	&& { echo $$python; break; }; done)
# The CPU build of torch; where its index cannot be reached, that of pip's default index. CUDA: make demo TORCH_INDEX=
TORCH ?= torch==2.13.0
TORCH_INDEX ?= --retries 1 --index-url https://download.pytorch.org/whl/cpu

VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
DEMO_LAMBDA ?= 1e-4
MODEL := $(shell sed -n 's/^DEFAULT_MODEL = "\(.*\)"/\1/p' fecocodec/model_files.py)
RUN ?= runs/next
MINUTES ?= 60
# What the command sets for its own process (cli/process.py), for what measures the library.
TUNED := GOMP_SPINCOUNT=10000 MALLOC_MMAP_THRESHOLD_=33554432 MALLOC_ARENA_MAX=1 MALLOC_TRIM_THRESHOLD_=268435456

.DEFAULT_GOAL := help
.PHONY: help demo test test-slow lint types arch vectors graphs fuzz conformance conformance-cuda bench bench-paper bench-systems report stress train web web-test web-bench check clean scenes-given photographs-given

help: ## show this list
	@grep -hE '^[a-z-]+:.*?## ' $(MAKEFILE_LIST) | awk 'BEGIN {FS = ":.*?## "} {printf "  make %-16s %s\n", $$1, $$2}'

$(READY): pyproject.toml
	@test -n "$(PYTHON)" || { echo "fecosplat needs Python 3.11, 3.12 or 3.13 with venv; set PYTHON=/path/to/python" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check $(TORCH_INDEX) "$(TORCH)" || \
	$(BIN)/python -m pip install --quiet --disable-pip-version-check "$(TORCH)"
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev]"
	@hook=$$(git rev-parse --git-path hooks/commit-msg 2>/dev/null) || exit 0; \
	test -e "$$hook" || { mkdir -p "$$(dirname "$$hook")" && cp .githooks/commit-msg "$$hook"; }
	@touch $@

demo: $(READY) ## encode, decode and render the bundled scene into out/
	@mkdir -p out
	$(BIN)/fecosplat encode examples/motorcycle -o out/demo.fcs --lambda $(DEMO_LAMBDA) --overwrite
	$(BIN)/fecosplat info out/demo.fcs
	$(BIN)/fecosplat decode out/demo.fcs -o out/demo.ply --overwrite
	$(BIN)/fecosplat render out/demo.fcs -o out --overwrite
	@ls -l out

# One process a core with one thread each: the tests' networks are too small for several threads.
test: $(READY) ## run the quick tests, in one process per core
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -m "not slow" -n auto --dist loadfile --no-loadscope-reorder

test-slow: $(READY) ## run the slow tests (the bundled scene, end to end)
	$(BIN)/python -m pytest -m slow

lint: $(READY) ## check style and formatting, and the words of documents
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python -m pytest -q tests/test_plain_words.py

types: $(READY) ## check types
	$(BIN)/mypy

arch: $(READY) ## check the dependency rules
	$(BIN)/lint-imports
	$(BIN)/python -m pytest -q tests/test_architecture.py

vectors: $(READY) ## make the golden vectors again, say what changed, check them with both readers
	$(BIN)/python tests/vectors/make_vectors.py
	$(BIN)/python -m pytest -q tests/vectors tests/bitstream_spec

fuzz: $(READY) ## ten minutes of mutated streams, half of them guided by coverage where atheris is installed
	$(BIN)/python benchmarks/fuzz_streams.py --minutes 5 --seed $$(date +%s)
	@if $(BIN)/python -c 'import atheris' 2>/dev/null; then $(BIN)/python benchmarks/fuzz_atheris.py -max_total_time=300; \
	else echo "atheris is not installed (pip install atheris): five more minutes without it"; \
	$(BIN)/python benchmarks/fuzz_streams.py --minutes 5 --seed $$(date +%N); fi

graphs: $(READY) ## export the receiver's graphs of all shipped models and of the vectors' model again
	@for model in $(dir $(wildcard fecocodec/weights/*/receiver.safetensors)); do $(BIN)/python -m fecocodec.training.graphs "$$model" || exit 1; done
	$(BIN)/python -m tests.vectors.tiny_graphs

conformance: $(READY) ## the same symbols with other threads, instructions and number types; how far Gaussians differ
	$(BIN)/python benchmarks/conformance.py

conformance-cuda: $(READY) ## the same, on the CUDA device too; fails where there is none
	$(BIN)/python benchmarks/conformance.py --cuda

bench: $(READY) ## measure time and memory of encode, decode and info
	$(TUNED) $(BIN)/python benchmarks/bench_codec.py

bench-paper: $(READY) ## measure time and memory of the paper's sender
	$(TUNED) $(BIN)/python benchmarks/bench_paper.py

bench-systems: $(READY) ## parameters, time and memory of every system, beside the paper's Table 1
	$(TUNED) $(BIN)/python benchmarks/system_costs.py

# What commands read exists, before the environment is made.
scenes-given:
	@test -d "$(ROOT)" || { echo "ROOT=$(ROOT): no such folder of scenes; write ROOT=folder INDEX=index.json." >&2; exit 1; }
	@test -f "$(INDEX)" || { echo "INDEX=$(INDEX): no such file; write ROOT=folder INDEX=index.json." >&2; exit 1; }

photographs-given:
	@test -d "$(PHOTOGRAPHS)" || { echo "PHOTOGRAPHS=$(PHOTOGRAPHS): no such folder of posed scenes; write PHOTOGRAPHS=folder." >&2; exit 1; }

report: scenes-given $(READY) ## the generated part of docs/report.md and its charts: make report ROOT=scenes INDEX=index.json [REPORT=--quick]
	$(TUNED) $(BIN)/python benchmarks/make_report.py "$(ROOT)" "$(INDEX)" $(REPORT)

stress: scenes-given $(READY) ## hard inputs against their rules, into out/stress: make stress ROOT=scenes INDEX=index.json
	$(BIN)/fecosplat stress "$(ROOT)" --index "$(INDEX)" -o out/stress

train: photographs-given $(READY) ## train on from the shipped weights: make train PHOTOGRAPHS=scenes [RUN=runs/next] [MINUTES=60]
	OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 nice -n 10 $(BIN)/python -m torch.distributed.run --nproc-per-node 2 -m fecosplat_cli train $(RUN) \
	  --from fecocodec/weights/$(MODEL) --photographs $(PHOTOGRAPHS) --steps 2000 \
	  --one-stage-steps 0 --bypass-steps 0 --photograph-share 0.75 0.75 --depth-weight 0.3 0.3 --learning-rate 2e-4 \
	  --size 160x160 --size 128x192 --size 192x128 --size 128x128 --views 2:0.8,3:0.1,4:0.1 --scenes 2 --optimised-share 0.5 --max-minutes $(MINUTES)

NPM := npm --prefix web --no-fund --no-audit
NODE_READY := web/node_modules/.package-lock.json

$(NODE_READY): web/package-lock.json
	@command -v npm >/dev/null || { echo "the viewer page needs Node.js 20 or newer with npm" >&2; exit 1; }
	$(NPM) ci --ignore-scripts
	@touch $@

web: $(NODE_READY) ## build the viewer page into fecocodec/web (needs Node.js 20)
	cd web && node build.mjs ../fecocodec/web
	@git diff --quiet -- fecocodec/web/scene.html 2>/dev/null || echo "fecocodec/web/scene.html has changed: commit it with what changed it"

web-test: $(READY) web ## test the decoder in Node and the page in Chromium (CHROMIUM=/usr/bin/chromium)
	cd web && npx tsc -p . && rm -rf build/test build/browser-tests && node build-tests.mjs && node --test build/test/*.mjs
	@rm -rf web/build/browser && mkdir -p web/build/browser/scenes
	$(BIN)/python -m web.test.make_scenes web/build/browser/scenes
	$(BIN)/python -m web.test.make_pages web/build/browser
	cd web && node --test --test-concurrency 1 build/browser-tests/*.test.mjs
	$(BIN)/python -m pytest -q web/test/test_results.py tests/cli/test_view.py

web-bench: web ## time the page in Chromium: make web-bench FILE=scene.fcs
	@test -n "$(FILE)" || { echo "name a file: make web-bench FILE=scene.fcs" >&2; exit 1; }
	cd web && node build-tests.mjs && node build/browser-tests/page-times.mjs "$(abspath $(FILE))"

check: lint types arch test ## everything a change must pass

clean: ## remove the environment, caches and results
	rm -rf $(VENV) out build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache

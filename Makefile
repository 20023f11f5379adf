# Two commands do everything on a machine that has Python 3.11+ and make:
#   make demo   sets up, runs the main job, says where the pictures are
#   make test   sets up, runs the tests; make thorough runs those of which one of a kind is enough
# Those who change the code want the third, a minute and a half:
#   make check  linters, types, floors and the quick tests
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
OUT    ?= out/demo
# The blocks are small dense problems: more BLAS threads cost time here.
export OMP_NUM_THREADS ?= 1
export MPLBACKEND ?= Agg
# Bytecode is kept: without it each process of a test compiles all sources anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: setup anew demo test thorough lowest processor check quick lint types floors spelling format bench frozen changes docs pages wheel clean

setup: $(VENV)/.installed

# An environment belongs to one Python: `make test PYTHON=python3.12` makes that of another anew.
OTHER := $(if $(filter-out file,$(origin PYTHON)),$(shell \
  test "$$($(PYTHON) -VV 2>&1)" = "$$($(BIN)/python -VV 2>&1)" || echo other))

$(VENV)/.installed: pyproject.toml $(OTHER:other=anew)
	test -x $(BIN)/python -a -z "$(OTHER)" || $(PYTHON) -m venv --clear $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable . --group dev
	touch $@

demo: setup
	$(BIN)/tubelock reproduce tables
	$(BIN)/tubelock show tsb1-pipe --output $(OUT)/tsb1-pipe.png
	$(BIN)/tubelock mbd tsb1-pipe --output $(OUT)/rigid
	$(BIN)/tubelock compare tsb1-pipe --set assembly.layers=2 --output $(OUT)/compare
	$(BIN)/tubelock fem tsb1-pipe --set assembly.layers=2 --output $(OUT)/fem
	$(BIN)/tubelock export tsb1-pipe --set assembly.layers=2 --flavour calculix --output $(OUT)/tsb1-pipe.inp

test: setup
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "not thorough" --dearest 50

# More of the kinds of tests that `make test` has one of: kill, Ctrl-C, Dask, random input, hard cases.
thorough: setup
	$(BIN)/python -m pytest -n 2 --dist worksteal -m thorough --dearest 50

# Quick tests with the lowest versions that pyproject.toml allows. Their environment stays in the
# user's cache until pyproject.toml changes.
OLDEST ?= python3.11
CACHE  ?= $(or $(XDG_CACHE_HOME),$(HOME)/.cache)/tubelock-lowest
LOWEST  = $(CACHE)/$(shell cksum pyproject.toml | cut -d ' ' -f 1)
lowest:
	test -e $(LOWEST)/installed || $(MAKE) --no-print-directory $(LOWEST)/installed
	$(LOWEST)/bin/uv pip install --quiet --python $(LOWEST)/bin/python --no-deps --editable .
	UNTIMED=1 $(LOWEST)/bin/python -m pytest -n 2 --dist worksteal -m "quick and not slow and not thorough"

$(LOWEST)/installed:
	rm -rf $(CACHE)
	$(OLDEST) -m venv $(LOWEST)
	$(LOWEST)/bin/python -m pip install --quiet uv
	$(LOWEST)/bin/uv pip install --quiet --python $(LOWEST)/bin/python --resolution lowest-direct \
	  --requirements pyproject.toml --group test
	touch $@

# No test may depend on the processor: linear algebra of processors without and with wide vectors
# (kernels of OpenBLAS), and machine code without them (generic, which compiles anew). Ten CPU minutes.
PROCESSORS ?= Prescott $(shell grep -sqw avx2 /proc/cpuinfo && echo Haswell) \
  $(shell grep -sqw avx512f /proc/cpuinfo && echo SkylakeX) generic
PROCESSOR_TESTS ?= tests/mbd tests/fem/test_static.py \
  tests/fem/test_condensation.py tests/fem/test_load_path.py tests/fem/test_deck_laws.py \
  tests/fem/test_abaqus.py tests/fem/test_problem_deck.py tests/geometry/test_own_files.py \
  tests/fem/test_own_curved.py tests/fem/test_own_law.py tests/fem/test_contact_law.py tests/fixtures
COMPILED_TESTS ?= tests/fem/test_kernels.py tests/fem/test_explicit_contact.py
processor: $(PROCESSORS:%=processor-%)

# OpenBLAS 0.3.34 (numpy 2.5.2 to 2.5.5) crashes where Haswell is chosen on an AMD processor with
# AVX-512 (OpenBLAS issue 6021), which takes Sandybridge then; a processor that is a Haswell works.
PRODUCT := import numpy; numpy.ones((64, 512)) @ numpy.ones((512, 512))
processor-%: setup
	core=$*; \
	if [ $$core = Haswell ] && ! OPENBLAS_CORETYPE=Haswell $(BIN)/python -c "$(PRODUCT)"; then \
	  core=Sandybridge; echo "Sandybridge in place of Haswell: see Makefile"; fi; \
	if [ $$core = generic ]; then export NUMBA_CPU_NAME=generic NUMBA_CPU_FEATURES=; \
	else export OPENBLAS_CORETYPE=$$core; fi; \
	$(BIN)/python -m pytest -n 2 --dist worksteal $(PROCESSOR_TESTS) $(if $(filter generic,$*),$(COMPILED_TESTS))

# Types take one core for a minute: the rest goes on beside them.
check: setup
	$(MAKE) --no-print-directory --jobs 2 types lint floors quick

quick: setup
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "quick and not slow and not thorough"

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: setup
	$(BIN)/mypy

floors: setup
	$(BIN)/lint-imports

spelling: setup
	$(BIN)/codespell

format: setup
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# Rates as shares of their limits: explicit step, dense algebra, start of the program.
bench: setup
	$(BIN)/python -m tests.benchmarks.rates

# Answers and CPU times of 26 problems beside those of a commit: `make frozen OLD=main~1`.
OLD ?= HEAD
frozen: setup
	$(BIN)/python -m tests.benchmarks.frozen $(OLD)

# What the tests let pass: random small changes of mechanics in a copy of the last commit, each beside
# the tests that run its line.
COUNT ?= 80
SEED  ?= 20261129
changes: setup
	$(BIN)/python -m tests.benchmarks.changes --count $(COUNT) --seed $(SEED)

# The site, without network. The first build runs the gallery, about half an hour; runs are cached
# in out/gallery. `make docs GALLERY=cached` runs nothing and takes about a minute.
docs: export GALLERY ?= run
docs: export API ?= on
docs: setup
	@echo "the first build takes about half an hour; GALLERY=cached shows cached runs only"
	$(BIN)/sphinx-build --fail-on-warning --quiet docs docs/_build/html
	@echo "docs/_build/html/index.html"

# Pages of commands, scene keys and public names in docs, as `make docs` writes them, and the notebook
# of its page: no run, seconds. The notebook alone is in the repository.
pages: setup
	cd docs && ../$(BIN)/python -m ext.pages
	$(BIN)/jupytext --quiet --update --to notebook docs/tutorials/notebook.md

# Wheel and source archive.
wheel: setup
	$(BIN)/python -m hatchling build -d dist

clean:
	rm -rf $(VENV) out .pytest_cache .mypy_cache .ruff_cache .import_linter_cache

# Every target sets up .venv by itself. Another interpreter: make run PYTHON=/path/to/python3.12
SHELL := /bin/bash
VERSION_CHECK := import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))
PYTHON ?= $(shell for p in python3.11 python3.12 python3.13 python3; do \
	$$p -c '$(VERSION_CHECK)' 2>/dev/null && { echo $$p; break; }; done)
BIN := .venv/bin
FMU_SOURCES := LICENSE $(shell find src fmus -name '*.py' -o -name '*.toml' -o -name '*.csv' -o -name '*.json' -o -name '*.license' \
	-o -name 'README.md' -o -name '*.so' -o -name '*.dll' -o -name 'icon.png')

# The matrices are small (below 100 x 100): threads in BLAS cost more than they bring.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export MPLBACKEND := Agg
# Some environments ask Python to keep no bytecode.  The tests start hundreds of processes, which would all compile anew.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: run test soak docs docs-links dist fmus launcher derive pythons importers basilisk multibody verify bench lint clean
.DELETE_ON_ERROR:

run: fmus  ## the default scenario: isolation at the nominal orientation, passive then active
	$(BIN)/python system/run.py $(ARGS)

test: lint fmus  ## what the continuous integration runs, on all processors; ARGS="-n 0 ..." on one
	$(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder $(ARGS)

soak: fmus  ## the tests that calls, kills, load orders and compilers make stronger, with many more of them: hours
	PS_FMU_SOAK=1 $(BIN)/python -m pytest tests/host/test_calls.py tests/host/test_system.py tests/fmus/test_same_bits.py \
		tests/runs/test_resume.py tests/studies/test_studies_sweep.py tests/studies/test_studies_sensitivity.py tests/native/test_native.py \
		tests/trades/test_budget_runs.py $(ARGS)

docs: fmus  ## the documentation as a site in build/docs; opens without a network
	$(BIN)/python docs/site/build.py $(ARGS)

docs-links: fmus  ## are the links of the documentation to other sites alive? needs a network
	$(BIN)/python docs/site/build.py --builder linkcheck --output build/docs-links -D plot_gallery=False $(ARGS)

dist: fmus  ## wheel, sdist and FMUs in dist, with their SHA-256
	rm -rf dist
	$(BIN)/python -m build --no-isolation --outdir dist .
	mkdir dist/fmus
	cp build/fmus/*.fmu dist/fmus
	cd dist && sha256sum *.whl *.tar.gz fmus/*.fmu >SHA256SUMS

fmus: build/fmus/.built  ## the FMUs in build/fmus

launcher: .venv/.installed  ## what is compiled in the package, made again: the same bytes from the same sources
	$(BIN)/python -m ps_fmu.native

derive: .venv/.installed  ## the equations of the mechanism, written as C again; make launcher compiles them
	$(BIN)/python -m ps_fmu.mechanism.derivation

pythons: .venv/.installed  ## the other versions of Python that this machine has, for the tests (0.5 GB each)
	@for version in 3.11 3.12 3.13; do \
		[ -e $(BIN)/python$$version ] && continue; \
		for python in python$$version "$$(pyenv root 2>/dev/null)"/versions/$$version.*/bin/python ''; do \
			[ -z "$$python" ] || "$$python" -c '' 2>/dev/null && break; \
		done; \
		if [ -z "$$python" ]; then echo "There is no Python $$version here."; continue; fi; \
		"$$python" -m venv .venv-$$version && .venv-$$version/bin/python -m pip install --quiet \
			--disable-pip-version-check -c constraints.txt -e . || exit 1; \
	done

importers: .venv-importers/.installed  ## tools that cannot share .venv, for the tests (0.9 GB)

basilisk: .venv-basilisk/.installed  ## the spacecraft simulator of examples/basilisk (0.9 GB); from then on in make test

multibody: .venv/.installed  ## the plant against an independent multibody prototype in Pinocchio (0.4 GB); from then on in make test
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[multibody]'
	$(BIN)/python -m pytest tests/multibody $(ARGS)

verify: fmus  ## the tests that hold a claim of the product; writes docs/verification.md of what they found
	$(BIN)/python docs/write_verification.py $(or $(ARGS),-n auto)

bench: fmus  ## what things cost, on a quiet machine; writes docs/developers/speed.md, fails if a limit is missed
	@missed=0; for script in step_cost start scaling study features real_time; do \
		echo "--- $$script"; $(BIN)/python benchmarks/$$script.py $(or $(ARGS),--record) || missed=1; \
	done; $(BIN)/python docs/write_speed.py && exit $$missed

lint: .venv/.installed
	$(BIN)/ruff check .
	$(BIN)/lint-imports --no-logo --no-cache
	$(BIN)/mypy

clean:
	rm -rf build dist .venv .venv-* .mypy_cache .pytest_cache .ruff_cache .hypothesis src/*.egg-info

build/fmus/.built: .venv/.installed $(FMU_SOURCES)
	$(BIN)/ps-fmu build --output build/fmus
	@touch $@

.venv/.installed: pyproject.toml requirements-dev.txt
	@$(or $(PYTHON),false) -c '$(VERSION_CHECK)' || { \
		echo "Python 3.11, 3.12 or 3.13 is needed; '$(or $(PYTHON),python3)' is" \
			"$$($(or $(PYTHON),python3) --version 2>&1). Name one: make PYTHON=/path/to/python3.11" >&2; exit 1; }
	@$(PYTHON) -m venv .venv || { \
		echo "The virtual environment could not be made; on Debian and Ubuntu: apt install python3-venv" >&2; exit 1; }
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --no-deps -r requirements-dev.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-build-isolation --no-deps -e .
	@$(BIN)/python -m pip check --quiet --disable-pip-version-check || { \
		echo "requirements-dev.txt lacks something that pyproject.toml asks for; its head says how it is made" >&2; exit 1; }
	@touch $@

# CoFMUPy insists on FMPy 0.3.20 and streamlit 1.12.
.venv-importers/.installed: Makefile
	$(PYTHON) -m venv .venv-importers
	.venv-importers/bin/python -m pip install --quiet --disable-pip-version-check cofmupy==1.0.0
	@touch $@

# Basilisk wants releases of its own of matplotlib and tqdm. The FMUs need scipy, ps_fmu itself is not needed.
.venv-basilisk/.installed: Makefile
	$(PYTHON) -m venv .venv-basilisk
	.venv-basilisk/bin/python -m pip install --quiet --disable-pip-version-check bsk==2.12.1 fmpy==0.3.32 scipy==1.17.1
	@touch $@

# make demo   a virtual environment, topokit in it, and the report of shapes it makes itself
# make test   the same, with everything the tests need, and all tests but the long ones: seven minutes on two cores.
#             As root it installs system packages with apt-get: python3-venv, the libraries that open3d loads, and Chromium.
#             make test SYSTEM=no installs none; tests that need them are skipped
# make test-all   every test, with the long ones: examples, programs of the documentation, fuzzing, real scans
# make lint   ruff, mypy and codespell (American spelling)
# make docs   the documentation, as a site in docs/site
# make bench  the benchmarks (ratios within one run)
PYTHON ?= python3
export SYSTEM ?= yes
# Another torch: make demo TORCH="torch --index-url https://download.pytorch.org/whl/cpu"
TORCH ?= torch==2.13.0
PIP = .venv/bin/python -m pip install --quiet --disable-pip-version-check

.PHONY: demo test test-all lint docs bench clean

demo: .venv/installed
	.venv/bin/python -m topokit demo

test: .venv/tested
	OMP_NUM_THREADS=1 .venv/bin/python -m pytest -n auto --dist worksteal -m "not long"

test-all: .venv/tested
	OMP_NUM_THREADS=1 .venv/bin/python -m pytest -n auto --dist worksteal

lint: .venv/tested
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/mypy
	.venv/bin/codespell topokit tests examples benchmarks docs README.md CONTRIBUTING.md CHANGELOG.md

docs: .venv/tested
	.venv/bin/python -m sphinx -W --keep-going -b html docs docs/site

bench: .venv/tested
	.venv/bin/python -m pytest benchmarks/bench_*.py --benchmark-columns=min,median,max -s

.venv/installed: pyproject.toml constraints.txt
	sh .ci/venv $(PYTHON)
	$(PIP) $(TORCH)
	$(PIP) --constraint constraints.txt --editable .
	touch $@

.venv/tested: .venv/installed
	sh .ci/system-libraries
	$(PIP) --constraint constraints.txt --editable '.[test,docs,all]'
	touch $@

clean:
	rm -rf .venv

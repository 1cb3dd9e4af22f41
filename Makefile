# `make run` and `make test` each set up .venv in the checkout first; they need Python ≥ 3.11, make and a package index.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
PACKAGES := $(patsubst %/pyproject.toml,%,$(wildcard packages/*/pyproject.toml))

.PHONY: run test test-all docs test-lowest test-newest release-check bench kernel-driver clean

# ROBOT=egm SENSOR=netft takes other emulated devices; `hil-bridge run --help` names them
run: $(STAMP)
	$(BIN)/hil-bridge run --duration 30 \
		--panel tcp-listen://127.0.0.1:0 $(if $(ROBOT),--robot $(ROBOT)) $(if $(SENSOR),--sensor $(SENSOR)) \
		--report runs/latest --record runs/latest/run.mcap --summary runs/latest/summary.json --overwrite

# what every change must pass; ROOM=rsi runs the tests that name that room
test: $(STAMP)
	$(BIN)/python tools/check.py $(if $(ROOM),--room $(ROOM))

# everything: the same, then long sweeps, devices in real time, pages, wheels, SocketCAN in a virtual machine
test-all: $(STAMP)
	$(BIN)/python tools/check.py --all

# the site of the documentation, into docs/_build/html
docs: $(STAMP)
	$(BIN)/sphinx-build -E -W --keep-going -q docs docs/_build/html

# the tests with the lowest versions that pyproject.toml names; ONLY="tests/wire" runs those alone
test-lowest: $(STAMP)
	$(BIN)/python tools/versions.py lowest $(ONLY)

# the same on Python 3.12 and 3.13, with the newest versions there are
test-newest: $(STAMP)
	$(BIN)/python tools/versions.py newest $(ONLY)

# before a release: source distribution, wheel, clean installation
release-check: $(STAMP)
	$(BIN)/python tools/release_check.py

# ONLY="wake_up link_use" runs those alone; PAGE=1 renews docs/explanation/performance.md too
bench: $(STAMP)
	$(BIN)/python -m tools.bench $(ONLY) $(if $(PAGE),--page)

# Linux's own jr3_pci driver on the emulated receiver board, in a virtual machine; `make test-all` runs it too
kernel-driver: $(STAMP)
	$(BIN)/python tools/kernel_driver.py

$(STAMP): pyproject.toml hatch_build.py $(PACKAGES:%=%/pyproject.toml)
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "hil-bridge needs Python 3.11 or newer; set PYTHON=python3.11 or later")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]' $(PACKAGES:%=--editable ./%)
	touch $@

clean:
	rm -rf $(VENV) build dist docs/_build .coverage .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache

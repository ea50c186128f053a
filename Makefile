PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUT := out
RUST := .cargo/config.toml Cargo.toml Cargo.lock $(shell find src uvms_gym/scenes -type f)
PACKAGE := $(shell find uvms_gym -type f -not -name '*.so' -not -path '*/__pycache__/*')

# Installs packages; one process at a time works on the environment.
pip = flock $(VENV) $(BIN)/python -m pip install --quiet
# Requirements of the package with the extras and groups $(1), without the package.
requirements = $(BIN)/python .ci/requirements.py $(1) | $(pip) -r /dev/stdin
# Tests against the installed wheel, from another directory.
installed = cd dist && UVMS_GYM_UNDER_TEST="$$("$(abspath $(BIN)/python)" -c 'import sysconfig; print(sysconfig.get_path("platlib"))')" \
	"$(abspath $(BIN)/python)" -P -m pytest -n auto -p no:cacheprovider \
	--rootdir "$(CURDIR)" -c "$(CURDIR)/pyproject.toml" "$(CURDIR)/tests/python"

.DEFAULT_GOAL := help
.PHONY: help run test test-rust lint audit test-wheel test-learning test-python test-nightly test-ray test-ros2 chromium docs pictures wheel clean

help: ## this list
	@awk -F ':.*## ' '/^[a-z0-9-]+:.*## /{ printf "make %-14s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

run: ## build everything, reproduce the paper, compare controllers; results in out/
	@$(MAKE) --no-print-directory -j2 $(VENV)/wheel $(VENV)/test
	$(BIN)/uvms reproduce --out $(OUT)/reproduce
	$(BIN)/uvms compare --out $(OUT)/compare

test: ## all tests and checks
	@.ci/run

test-rust: ## Rust tests; need no Python
	cargo test --release --locked

lint: $(VENV)/test $(VENV)/learning $(VENV)/wheel ## rustfmt, clippy, ruff, mypy, stubs against the native module
	cargo fmt --all --check
	PYO3_PYTHON="$(abspath $(BIN)/python)" cargo clippy --locked --all-targets -- -D warnings
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	cd dist && "$(abspath $(BIN)/python)" -P -m mypy.stubtest uvms_gym._core

pictures: $(VENV)/wheel $(VENV)/test ## pictures of README.md and docs that take seconds, into .github
	cd .github && PATH="$(abspath $(BIN)):$$PATH" && \
	uvms play --env UVMS-StationKeep-Storm-v0 --controller dob --seconds 4.8 --seed 3 --size 480x360 --fps 10 --out storm.gif && \
	uvms play --env UVMS-Valve-v0 --scene bluerov2-heavy-alpha5-tool --env-kwargs contract:grasp --env-kwargs torque:0.3 \
	--controller resolved-dob --seconds 31 --size 360x270 --fps 3 --camera=-75,2,0.95 --out valve.gif && \
	uvms play --seconds 6 --seed 3 --size 800x600 --out station-keep.png && \
	uvms play --disturbance storm --seed 3 --plot storm.png && \
	uvms disturbances --out ../$(OUT)/disturbances && cp ../$(OUT)/disturbances/shapes.png disturbances.png && \
	uvms validate bluerov2-alpha5-pool ../tests/data/pool --map ../tests/data/pool/map-fitted.toml --out ../$(OUT)/validate && \
	cp ../$(OUT)/validate/replays.png identification-replays.png && \
	python -P ../tests/bench/contact.py added-mass --out ../docs/_static/contact --picture lagged-added-mass.png && \
	python -P -c "from pathlib import Path; from uvms_gym.studies.comparison.plots import plot_frontier, stored_panels; \
	plot_frontier(Path('frontier.png'), stored_panels(sorted(Path('../uvms_gym/pretrained').glob('*/*/*/results.json'), reverse=True)))"

audit: $(VENV)/audit ## licences, sources and known vulnerabilities of dependencies; needs cargo-deny and the network
	cargo deny --workspace --config .cargo/deny.toml check
	$(BIN)/python .ci/requirements.py cli view import flight ros2 train jax test docs | $(BIN)/pip-audit --requirement /dev/stdin

test-wheel: $(VENV)/test $(VENV)/wheel ## Python tests against the installed wheel
	$(installed)

test-learning: $(VENV)/test $(VENV)/learning $(VENV)/wheel ## tests with Stable-Baselines3 and CMA-ES against the wheel; downloads torch
	$(installed) -m learning

test-python: $(VENV)/test uvms_gym/_core.abi3.so ## Python tests against this tree, for development
	PYTHONPATH="$(CURDIR)" UVMS_GYM_UNDER_TEST="$(CURDIR)" $(BIN)/python -m pytest -n auto

test-nightly: $(VENV)/test $(VENV)/learning $(VENV)/pyright $(VENV)/wheel test-ray chromium ## long tests: debug assertions, all methods, fuzzing, types in an editor, Ray, the page in Chromium
	cargo test --locked
	$(installed) -m nightly
	UVMS_FUZZ=10000 && export UVMS_FUZZ && $(installed)/test_fuzz.py
	UVMS_FUZZ=10000 && export UVMS_FUZZ && $(installed)/test_log_errors.py

test-ray: $(VENV)/test $(VENV)/learning uvms_gym/_core.abi3.so ## contracts with Gymnasium 1.2, training and evaluation on a local Ray; downloads 300 MB
	.ci/ray

test-ros2: $(VENV)/test $(VENV)/ros2 $(VENV)/wheel ## nodes of ROS 2 on genuine rclpy and Fast DDS, with CPython 3.11; downloads 40 MB
	ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST && export ROS_AUTOMATIC_DISCOVERY_RANGE && $(installed)/test_ros2.py -m ros2 -n 0

# For tests of the page, which are skipped without it.
chromium:
	@command -v chromium || command -v chromium-browser || command -v google-chrome || { sudo=$$(command -v sudo); \
		$$sudo apt-get update && $$sudo apt-get install --yes --no-install-recommends chromium; } || echo 'chromium cannot be installed'

docs: $(VENV)/docs $(VENV)/learning $(VENV)/wheel ## documentation site into out/docs; executes its tutorials; downloads torch
	nice -n 10 $(BIN)/sphinx-build -W --keep-going -q docs $(OUT)/docs

wheel: $(VENV)/zig ## wheel for any Linux with glibc 2.17 (CPython 3.11 and later) and source distribution, into dist/
	rm -rf dist
	$(BIN)/python .ci/licenses.py
	PATH="$(abspath $(BIN)):$$PATH" maturin build --release --strip --quiet --zig --compression-level 9 --compatibility manylinux2014 --interpreter "$(abspath $(BIN)/python)" \
		--target "$$(rustc -vV | sed -n 's/^host: //p')" --out dist
	$(BIN)/python .ci/recompress.py
	$(BIN)/maturin sdist --out dist
	ls -l dist

clean: ## remove everything that was built
	rm -rf $(VENV) .venv-ray dist target $(OUT) uvms_gym/*.so

$(VENV)/made:
	$(PYTHON) -m venv $(VENV)
	$(pip) 'maturin>=1.16,<2'
	touch $@

$(VENV)/test: $(VENV)/made pyproject.toml
	$(call requirements,cli import test)
	touch $@

$(VENV)/audit: $(VENV)/made pyproject.toml
	$(call requirements,audit)
	touch $@

$(VENV)/docs: $(VENV)/made pyproject.toml
	$(call requirements,cli docs)
	touch $@

$(VENV)/zig: $(VENV)/made
	$(pip) 'ziglang>=0.13,<1' 'zopfli>=0.4,<1'
	touch $@

$(VENV)/learning: $(VENV)/made pyproject.toml
	$(call requirements,train)
	touch $@

$(VENV)/ros2: $(VENV)/made pyproject.toml
	$(call requirements,ros2-node)
	touch $@

# Pyright with its Node.js: the package of that name downloads both when it runs.
$(VENV)/pyright: $(VENV)/made
	$(pip) 'basedpyright>=1.40,<2'
	touch $@

dist/made: $(VENV)/made pyproject.toml .ci/licenses.py $(RUST) $(PACKAGE)
	rm -rf dist
	$(BIN)/python .ci/licenses.py
	$(BIN)/maturin build --release --quiet --interpreter "$(abspath $(BIN)/python)" --out dist
	touch $@

# The native module also lies beside the source: Python and pytest work in this folder as well.
$(VENV)/wheel: dist/made
	$(pip) --force-reinstall --no-deps dist/*.whl
	$(BIN)/python -m zipfile --extract dist/*.whl dist/wheel && mv dist/wheel/uvms_gym/_core.abi3.so uvms_gym/ && rm -r dist/wheel
	touch $@ uvms_gym/_core.abi3.so

# Incremental, in a folder of its own: a change in a task's file takes a minute.
uvms_gym/_core.abi3.so: $(VENV)/made $(RUST)
	env -u CONDA_PREFIX CARGO_INCREMENTAL=1 CARGO_TARGET_DIR=target/incremental VIRTUAL_ENV="$(abspath $(VENV))" $(BIN)/maturin develop --release --quiet --skip-install

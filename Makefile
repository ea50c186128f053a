VENV := .venv
BIN := $(VENV)/bin
OUT := out
RUST := .cargo/config.toml Cargo.toml Cargo.lock $(shell find src uvms_gym/scenes -type f)
PACKAGE := $(shell find uvms_gym -type f -not -name '*.so' -not -path '*/__pycache__/*')

# Builds the native module into uvms_gym/ and installs the package as editable, with the extras $(1).
develop = env -u CONDA_PREFIX PIP_QUIET=1 VIRTUAL_ENV="$(abspath $(VENV))" $(BIN)/maturin develop --release --quiet --extras $(1)

.DEFAULT_GOAL := help
.PHONY: help run test prerequisites test-rust lint test-python test-wheel test-ray clean

help: ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## /{ printf "make %-14s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

run: $(VENV)/run ## build everything, reproduce the paper, compare controllers; results in out/
	$(BIN)/uvms reproduce --out $(OUT)/reproduce
	$(BIN)/uvms compare --out $(OUT)/compare

test: prerequisites test-rust lint test-python test-wheel ## all tests and checks

test-rust: ## Rust tests; need no Python
	cargo test --locked

lint: $(VENV)/dev ## rustfmt, clippy, ruff, mypy, stubs against the native module
	cargo fmt --check
	cargo clippy --locked --all-targets -- -D warnings
	PYO3_PYTHON="$(abspath $(BIN)/python)" cargo clippy --locked --workspace --all-targets -- -D warnings
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python -m mypy.stubtest uvms_gym._core

test-python: $(VENV)/dev ## Python tests, from the root
	UVMS_GYM_UNDER_TEST="$(CURDIR)" $(BIN)/python -m pytest -n auto

test-wheel: dist/installed/made ## Python tests against the installed wheel, from another directory
	cd dist && PYTHONPATH="$(abspath dist/installed)" UVMS_GYM_UNDER_TEST="$(abspath dist/installed)" \
		"$(abspath $(BIN)/python)" -P -m pytest -n auto -p no:cacheprovider \
		--rootdir "$(CURDIR)" -c "$(CURDIR)/pyproject.toml" "$(CURDIR)/tests/python"

test-ray: .venv-ray/made ## contracts with Gymnasium 1.2, training and evaluation on a local Ray; downloads 300 MB
	UVMS_GYM_UNDER_TEST="$(CURDIR)" .venv-ray/bin/python -m pytest -n auto --dist loadfile tests/python/test_ray.py \
		tests/python/test_contract_single.py tests/python/test_contract_vector.py \
		tests/python/test_sb3.py tests/python/test_station_keep.py \
		tests/python/test_ee_track.py tests/python/test_examples.py tests/python/test_rollouts.py

clean: ## remove everything that was built
	rm -rf $(VENV) .venv-ray dist target $(OUT) uvms_gym/*.so

prerequisites:
	@sh .ci/prerequisites.sh >/dev/null

$(VENV)/made: | prerequisites
	python=$$(sh .ci/prerequisites.sh) && "$$python" -m venv $(VENV)
	$(BIN)/python -m pip install --quiet 'maturin>=1.16,<2'
	touch $@

$(VENV)/run: $(VENV)/made pyproject.toml $(RUST) | prerequisites
	$(call develop,cli)
	touch $@

$(VENV)/dev: $(VENV)/made pyproject.toml $(RUST) | prerequisites
	$(call develop,dev)
	touch $@

# The same release build as above, so this only packs it.
dist/installed/made: $(VENV)/dev $(PACKAGE)
	rm -rf dist
	$(BIN)/maturin build --release --quiet --out dist
	$(BIN)/python -m pip install --quiet --no-deps --no-index --target dist/installed dist/*.whl
	touch $@

# Ray pins Gymnasium 1.2. All that it does not bring, and the package itself, is looked up in $(VENV).
.venv-ray/made: $(VENV)/dev
	rm -rf .venv-ray
	$(BIN)/python -m venv .venv-ray
	$(BIN)/python -c 'import site; print("import site; site.addsitedir(%r)" % site.getsitepackages()[0])' \
		>"$$(.venv-ray/bin/python -c 'import site; print(site.getsitepackages()[0])')/venv.pth"
	.venv-ray/bin/python -m pip install --quiet 'ray[rllib]>=2.60,<3' 'gymnasium==1.2.2'
	touch $@

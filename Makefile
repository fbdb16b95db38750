# hgo_rs: the verbs. Each sets up all it needs in .venv (Python >= 3.10 and cargo are expected).
#
#   make reproduce   every table and figure of the five papers -> out/report.html
#   make test        format, lints, types, Rust and Python tests, doc examples, the wheel alone
#   make bench       one step of each observer (criterion), then side by side, then instructions
#                    -> out/bench.json, out/performance.json
#   make firmware    every observer on two Cortex-M: bits, instructions, proofs -> out/firmware.json
#   make docs        the Rust API reference -> target/doc
#   make wheel       an abi3 wheel -> dist/
#   make clean       remove .venv, dist, out and build products
#
# PYTHON=... chooses the interpreter for .venv.  PYTEST_ARGS=... is handed to pytest.

.PHONY: reproduce test bench firmware docs wheel clean help
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
MAKEFLAGS += --no-print-directory

VENV := .venv
BIN  := $(VENV)/bin

# The first interpreter that is at least 3.10.
PYTHON ?= $(shell for p in python3 python3.13 python3.12 python3.11 python3.10 python; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 10))' >/dev/null 2>&1 && { echo $$p; break; }; done)

RUST_SOURCES := $(wildcard Cargo.toml Cargo.lock build.rs rust-toolchain.toml .cargo/config.toml) \
	$(shell find src -name '*.rs' 2>/dev/null)

# No std and no heap: what a microcontroller builds.
LIBM := --no-default-features --features libm

say = @printf '\n\033[1m== %s\033[0m\n' "$(1)"

help:
	@sed -n '3,12s/^# \{0,1\}//p' Makefile

# --- set-up: one stamp a stage, so that the second time takes no time ------------------------

$(VENV)/stamp-venv:
	@test -n "$(PYTHON)" || { echo "hgo_rs needs Python >= 3.10; set PYTHON=/path/to/python3" >&2; exit 1; }
	@command -v cargo >/dev/null || { echo "hgo_rs needs cargo: https://rustup.rs" >&2; exit 1; }
	rm -rf $(VENV)
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); $(PYTHON) -m virtualenv -q $(VENV); } \
		|| { echo "no venv: install python3-venv, or virtualenv for $(PYTHON)" >&2; exit 1; }
	$(BIN)/python -m pip install --quiet "maturin>=1.7,<2"
	@touch $@

# The release build, installed in place (Python sources stay live), with the optional libraries.
$(VENV)/stamp-build: $(VENV)/stamp-venv pyproject.toml $(RUST_SOURCES)
	env -u CONDA_PREFIX VIRTUAL_ENV=$(abspath $(VENV)) $(BIN)/maturin develop --quiet --release --extras all
	@touch $@

# The same with the tools of `make test`; cargo has nothing left to compile here.
$(VENV)/stamp-dev: $(VENV)/stamp-build
	env -u CONDA_PREFIX VIRTUAL_ENV=$(abspath $(VENV)) $(BIN)/maturin develop --quiet --release --extras all,dev
	@touch $@

# The same with what `make bench` compares with.
$(VENV)/stamp-bench: $(VENV)/stamp-build
	env -u CONDA_PREFIX VIRTUAL_ENV=$(abspath $(VENV)) $(BIN)/maturin develop --quiet --release --extras all,bench
	@touch $@

# --- the verbs -------------------------------------------------------------------------------

reproduce: $(VENV)/stamp-build
	$(BIN)/hgo reproduce --out out

test: $(VENV)/stamp-dev
	$(call say,cargo fmt)
	cargo fmt --all --check
	$(call say,clippy: default$(,) python$(,) no_std$(,) serde and defmt)
	cargo clippy --quiet --all-targets -- -D warnings
	PYO3_PYTHON=$(abspath $(BIN)/python) cargo clippy --quiet --all-targets --features python -- -D warnings
	cargo clippy --quiet --all-targets $(LIBM) -- -D warnings
	cargo clippy --quiet --all-targets --features serde,defmt -- -D warnings
	cargo clippy --quiet --all-targets $(LIBM),serde,defmt -- -D warnings
	cargo check --quiet $(LIBM)
	cargo check --quiet $(LIBM),serde,defmt
	$(call say,cargo test)
	cargo test --quiet --release
	cargo test --quiet --features serde,defmt --test stored --test logged --test no_alloc
	$(call say,ruff)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(call say,mypy and the stub of the compiled module)
	$(BIN)/mypy
	$(BIN)/python -m mypy.stubtest hgo_rs._core --mypy-config-file pyproject.toml
	$(call say,pytest: library$(,) doc examples$(,) command line$(,) wheel in an empty environment)
	$(BIN)/python -m pytest $(PYTEST_ARGS)

bench: $(VENV)/stamp-bench
	cargo bench
	$(BIN)/python benches/compare --out out

firmware:
	@$(PYTHON) firmware/tools/firmware.py --out out

docs:
	RUSTDOCFLAGS="-D warnings" cargo doc --no-deps

wheel: $(VENV)/stamp-venv
	$(BIN)/maturin build --release --out dist

clean:
	rm -rf $(VENV) dist out build .mypy_cache .pytest_cache .ruff_cache .hypothesis
	rm -f python/hgo_rs/_core*.so python/hgo_rs/_core*.pyd
	find python tests -name __pycache__ -type d -prune -exec rm -rf {} +
	cargo clean

, := ,

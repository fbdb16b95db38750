# hgo_rs: the verbs. Each sets up all it needs in .venv (Python >= 3.10 and cargo are expected).
#
#   make reproduce   every table and figure of five papers and a textbook -> out/report.html
#   make test        format, lints, types, Rust and Python tests, doc examples, the wheel alone
#   make fuzz        random observers and records, every engine against the others, for SECONDS=60
#   make bench       one step of each observer (criterion), then side by side, then instructions
#                    -> out/bench.json, out/performance.json
#   make firmware    every observer on four chips: bits, instructions, proofs -> out/firmware.json
#                    (CHIPS=cortex-m4,cortex-a53 for some of them)
#   make mutants     changes to the core that its tests must see -> out/mutants.out (hours)
#   make pages       the WebAssembly module that `hgo tune --page` puts into a page
#   make docs        the Rust API reference -> target/doc
#   make site        the documentation as a site -> out/site (KaTeX: libjs-katex, or KATEX=folder)
#   make wheel       an abi3 wheel -> dist/
#   make wheels      wheels for Linux (glibc and musl, x86-64 and aarch64) and Windows -> dist/, each tried
#                    where it can run here (TARGETS=aarch64-unknown-linux-gnu for one of them)
#   make clean       remove .venv, dist, out and build products
#
# PYTHON=... chooses the interpreter for .venv.  PYTEST_ARGS=... is handed to pytest.
# make fuzz SECONDS=60 SEED=1 LONG=1: case i of a seed is always the same; LONG=50 for a night.

.PHONY: site reproduce test test-rust test-python test-types pytest fuzz bench firmware mutants pages docs wheel wheels clean help
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
MAKEFLAGS += --no-print-directory

# What is imported is compiled then: pip would compile all of every package, for minutes.
export PIP_COMPILE := 0

# uv trusts what the system trusts, as pip does.
export UV_NATIVE_TLS := 1

# Its compilers take no places of make's.
CARGO := env -u MAKEFLAGS -u MFLAGS cargo

VENV := .venv
BIN  := $(VENV)/bin

# The first interpreter that is at least 3.10.
PYTHON ?= $(shell for p in python3 python3.13 python3.12 python3.11 python3.10 python; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 10))' >/dev/null 2>&1 && { echo $$p; break; }; done)

RUST_SOURCES := $(wildcard Cargo.toml Cargo.lock crates/*/Cargo.toml rust-toolchain.toml .cargo/config.toml) \
	$(shell find src crates -name '*.rs' 2>/dev/null)

# No std and no heap: what a microcontroller builds.
LIBM := --no-default-features --features libm

say = @printf '\n\033[1m== %s\033[0m\n' "$(1)"

help:
	@sed -n '3,20s/^# \{0,1\}//p' Makefile

# --- set-up: one stamp a stage, so that the second time takes no time ------------------------

$(VENV)/stamp-venv:
	@test -n "$(PYTHON)" || { echo "hgo_rs needs Python >= 3.10; set PYTHON=/path/to/python3" >&2; exit 1; }
	@command -v cargo >/dev/null || { echo "hgo_rs needs cargo: https://rustup.rs" >&2; exit 1; }
	rm -rf $(VENV)
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); $(PYTHON) -m virtualenv -q $(VENV); } \
		|| { echo "no venv: install python3-venv, or virtualenv for $(PYTHON)" >&2; exit 1; }
	$(BIN)/python -m pip install --quiet "maturin>=1.7,<2" uv
	@touch $@

# The release build, installed in place (Python sources stay live), with the extras that are named: by uv, which
# takes half a minute for what takes pip some; where uv reaches no packages, by pip.
develop = @develop() { env -u CONDA_PREFIX VIRTUAL_ENV=$(abspath $(VENV)) PATH="$(abspath $(BIN)):$$PATH" \
	maturin develop --quiet --release --extras "$$@"; }; develop $(1) --uv || develop $(1)

# What pages compute with, in the package and so in a wheel. Where the compiler's target cannot be had the rest
# is built without it, and `--page` says so. No path of this machine stays in it.
MODULE := python/hgo_rs/pages/hgo.wasm
WASM := wasm32-unknown-unknown
REMAP := --remap-path-prefix=$(abspath .)=hgo_rs --remap-path-prefix=$(or $(CARGO_HOME),$(HOME)/.cargo)=cargo

$(MODULE): Cargo.toml $(shell find src crates/wasm -name '*.rs' -o -name Cargo.toml)
	@if test -d "$$(rustc --print target-libdir --target $(WASM) 2>/dev/null)" || rustup target add $(WASM); then \
		RUSTFLAGS="$(REMAP)" $(CARGO) build --quiet -p hgo-wasm --profile wasm --target $(WASM) \
			&& cp target/$(WASM)/wasm/hgo_wasm.wasm $@; \
	else echo "no $(WASM) for this rustc: built without pages (hgo tune --page)" >&2; fi

pages: $(MODULE)

# With the optional libraries.
$(VENV)/stamp-build: $(VENV)/stamp-venv pyproject.toml $(RUST_SOURCES) | $(MODULE)
	$(call develop,all)
	@touch $@

# The same with the tools of `make test`.
$(VENV)/stamp-dev: $(VENV)/stamp-venv pyproject.toml $(RUST_SOURCES) | $(MODULE)
	$(call develop,all$(,)dev)
	@touch $(VENV)/stamp-build $@

# The same with what `make bench` compares with, and with what `make site` is made by.
$(VENV)/stamp-bench: $(VENV)/stamp-build
	$(call develop,all$(,)bench)
	@touch $@

$(VENV)/stamp-docs: $(VENV)/stamp-build
	$(call develop,all$(,)docs)
	@touch $@

# --- the verbs -------------------------------------------------------------------------------

reproduce: $(VENV)/stamp-build
	$(BIN)/hgo reproduce --out out --jobs $$(getconf _NPROCESSORS_ONLN)

# Two things at a time: a compiler that optimises a library uses one processor. What cargo and the
# linters say is shown when they end, pytest as it goes.
SYNC := $(filter output-sync,$(.FEATURES))
test: $(VENV)/stamp-venv
	@$(MAKE) --jobs=2 $(SYNC:%=--%=target) test-rust test-python test-types

# Without -p a line is of the core alone. Examples, benches and tests are linted with all features that
# they know; the core also without what they add to its dependencies, in every form in which others take it.
test-rust: $(VENV)/stamp-venv
	$(call say,cargo fmt)
	$(CARGO) fmt --all --check
	$(call say,clippy: all crates$(,) serde and defmt$(,) no_std)
	PYO3_PYTHON=$(abspath $(BIN)/python) $(CARGO) clippy --quiet --workspace --all-targets -- -D warnings
	$(CARGO) clippy --quiet --all-targets --features serde,defmt -- -D warnings
	$(CARGO) clippy --quiet $(LIBM) -- -D warnings
	$(CARGO) clippy --quiet $(LIBM),serde,defmt -- -D warnings
	$(call say,cargo test)
	$(CARGO) test --quiet --profile checked -p hgo-rs -p hgo-ir -p hgo-logs --features hgo-rs/serde,hgo-rs/defmt
	$(call say,cargo test --release: figures of the papers$(,) sums that the compiler makes vectors of)
	$(CARGO) test --quiet --release --test golden --test vectors

test-types: $(VENV)/stamp-dev
	$(call say,ruff)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(call say,mypy)
	$(BIN)/mypy

test-python: $(VENV)/stamp-dev
	@$(MAKE) $(SYNC:%=--%=none) pytest

# Files are shared out between two processes: PYTEST_ARGS=-n0 for one.
pytest:
	$(call say,pytest: library$(,) stub$(,) doc examples$(,) command line$(,) wheel in an empty environment)
	$(BIN)/python -m pytest -n 2 --dist loadfile $(PYTEST_ARGS)

SECONDS ?= 60
SEED ?= 1
LONG ?= 1
fuzz: $(VENV)/stamp-dev
	$(call say,fuzz: seed $(SEED)$(,) $(SECONDS) s)
	$(BIN)/python tests/fuzz --seconds $(SECONDS) --seed $(SEED) --long $(LONG)

# The gallery has the figures of the last `make reproduce`. Search needs a server:
# python3 -m http.server -d out/site
out/results.json: | $(VENV)/stamp-build
	@$(MAKE) reproduce

site: $(VENV)/stamp-docs out/results.json
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet --strict
	@echo "out/site/index.html"

bench: $(VENV)/stamp-bench
	$(CARGO) bench
	$(BIN)/python benches/compare --out out

# FILES="src/observer.rs src/estimator.rs": some of the files alone. A copy of the sources is changed.
MUTANTS := target/tools/bin/cargo-mutants
$(MUTANTS):
	$(CARGO) install --quiet --locked cargo-mutants --root target/tools

mutants: $(MUTANTS)
	@mkdir -p out
	CARGO_INCREMENTAL=1 PROPTEST_MAX_SHRINK_ITERS=0 PATH="$(abspath target/tools/bin):$$PATH" \
		$(CARGO) mutants -j1 --output out $(FILES:%=--file=%) $(MUTANTS_ARGS)

firmware:
	@$(PYTHON) firmware/tools/firmware.py --out out $(if $(CHIPS),--chips $(CHIPS))

docs:
	RUSTDOCFLAGS="-D warnings" cargo doc --no-deps -p hgo-rs -p hgo-ir -p hgo-logs

wheel: $(VENV)/stamp-venv $(MODULE)
	$(BIN)/maturin build --release --out dist

# By zig, and MinGW for Windows: .ci/wheels.py. Two minutes of a processor each.
wheels: $(VENV)/stamp-venv $(MODULE)
	$(BIN)/python -m pip install --quiet ziglang twine
	env -u MAKEFLAGS -u MFLAGS $(BIN)/python .ci/wheels.py build $(TARGETS)
	$(BIN)/twine check --strict dist/*.whl
	$(BIN)/python .ci/wheels.py try

clean:
	rm -rf $(VENV) dist out build .mypy_cache .pytest_cache .ruff_cache .hypothesis
	rm -f python/hgo_rs/_core*.so python/hgo_rs/_core*.pyd $(MODULE)
	find python tests -name __pycache__ -type d -prune -exec rm -rf {} +
	$(CARGO) clean

, := ,

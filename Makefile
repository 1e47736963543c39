# What a user runs. Each target does its own set-up.
.PHONY: help setup build test demo contract check bench deny clean
.DEFAULT_GOAL := help

help:
	@echo "make demo    build, reconstruct an example cloud, print its report"
	@echo "make test    all tests"
	@echo "make build   the release binary, target/release/meshway"
	@echo "make contract  requests made up from openapi.yaml against a served instance (Schemathesis)"
	@echo "make bench   benchmarks (criterion); tables are in docs/benchmarks.md"
	@echo "make check   format, lints, documentation"
	@echo "make deny    licences, sources and duplicate crates"

setup:
	@./scripts/setup.sh

build: setup
	cargo build --release --locked

test: setup
	cargo test --locked

demo: build
	@./scripts/demo.sh

contract: build
	@./scripts/schemathesis.sh

check: setup
	cargo fmt --check
	cargo clippy --locked --all-targets -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --locked --no-deps --document-private-items

bench: setup
	cargo bench --locked

deny:
	cargo deny --locked check licenses bans sources

clean:
	rm -rf target demo

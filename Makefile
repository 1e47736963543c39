# What a user runs. Each target does its own set-up.
.PHONY: help setup web build install dist test test-web demo contract check bench bench-engines bench-quality bench-medical bench-service bench-store bench-cluster bench-many bench-blocks upgrade soak soak-audit storm fuzz-medical deny clean
.DEFAULT_GOAL := help

help:
	@echo "make demo    build, reconstruct an example cloud, print its report"
	@echo "make test    all tests"
	@echo "make build   the release binary, target/release/meshway"
	@echo "make install PREFIX=/usr/local  the program, its libraries, man pages and completions"
	@echo "make dist    a tarball of the same, which runs from any folder and for any user"
	@echo "make web     the dashboard alone, which make build puts into the program"
	@echo "make test-web  the dashboard in a browser; PICTURES=1 takes the pictures of docs/ anew"
	@echo "make contract  requests made up from openapi.yaml against a served instance (Schemathesis), linters, generated clients"
	@echo "make bench   benchmarks (criterion); tables are in docs/benchmarks.md"
	@echo "make bench-engines  loss and gradient beside PyTorch and JAX, which it installs under target/"
	@echo "make bench-quality BENCH=FOLDER  clouds with true surfaces, beside what other tools reached;"
	@echo "             dense clouds from true surfaces, beside Open3D, which it installs under target/"
	@echo "make bench-medical  label maps of known solids, beside VTK, which it installs under target/"
	@echo "make bench-service  the service under load: rates, latencies, memory (two minutes)"
	@echo "make bench-store  what the store writes in a second, on SQLite and on Postgres (one minute)"
	@echo "make bench-cluster  many processes over one Postgres, and a thousand workers; MINUTES=10"
	@echo "make bench-blocks  a large cloud on one worker and on several; POINTS=1000000 WORKERS=4 CORE=0.5"
	@echo "make upgrade OLD=PROGRAM  an upgrade from an earlier program while jobs run"
	@echo "make bench-many  lists and gets with very many ended jobs; JOBS=10000000 (a gigabyte for each 200,000)"
	@echo "make storm   nodes, workers, database and object store, killed again and again; KILLS=500"
	@echo "make soak    jobs under random faults; MINUTES=10"
	@echo "make soak-audit  the audit trail of a service that is killed again and again; KILLS=500"
	@echo "make fuzz-medical  120,000 damaged label maps and DICOM files"
	@echo "make check   format, lints, documentation"
	@echo "make deny    licences, sources and duplicate crates"

setup:
	@./scripts/setup.sh

web:
	@./scripts/web.sh

build: setup web
	cargo build --release --locked --bin meshway

PREFIX ?= /usr/local

install:
	@./scripts/install.sh $(PREFIX)

dist: build
	@./scripts/dist.sh

test: setup web
	cargo test --locked

demo: build
	@./scripts/demo.sh

test-web: build
	@./scripts/test-web.sh

contract: build
	@./scripts/schemathesis.sh
	@./scripts/client.sh
	@./scripts/typescript.sh
	@./scripts/python-client.sh
	@./scripts/tls.sh

check: setup web
	cargo fmt --check
	cargo clippy --locked --all-targets -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --locked --no-deps --document-private-items

bench: setup
	CRITERION_HOME=$(CURDIR)/target/bench/reconstruction cargo bench --locked --bench reconstruction

bench-engines: setup
	python3 -m venv target/engines-venv
	target/engines-venv/bin/pip install --quiet torch==2.13.0 jax==0.10.2 numpy
	cargo bench --locked --bench engines

QUALITY_VENV := target/quality-venv/made

# BENCH: one or more folders. One with an index.json holds clouds and what other tools reached on them, see
# benches/quality/quality.py; one without holds true surfaces, from which dense clouds are drawn, see
# benches/quality/dense; `generated` stands for those that it makes itself. ARGS go to each.
bench-quality: build $(sort $(foreach folder,$(BENCH),$(if $(wildcard $(folder)/index.json),,$(QUALITY_VENV))))
	@test -n "$(BENCH)" || { echo "bench-quality: BENCH=FOLDER is missing" >&2; exit 2; }
	@set -e; for folder in $(BENCH); do \
	  case $$folder in \
	    generated) python3 benches/quality/dense $(ARGS) ;; \
	    *) if [ -f $$folder/index.json ]; then python3 benches/quality/quality.py $$folder $(ARGS); \
	       else python3 benches/quality/dense $$folder $(ARGS); fi ;; \
	  esac; \
	done

$(QUALITY_VENV): benches/quality/dense/requirements.txt
	python3 -m venv target/quality-venv
	target/quality-venv/bin/pip install --quiet --requirement $<
	@touch $@

MEDICAL_VENV := target/medical-venv/made

bench-medical: build $(MEDICAL_VENV)
	python3 benches/medical $(ARGS)

$(MEDICAL_VENV): benches/medical/requirements.txt
	python3 -m venv target/medical-venv
	target/medical-venv/bin/pip install --quiet --requirement $<
	@touch $@

bench-service: build
	cargo bench --locked --bench service

bench-store: setup
	FSYNC=on ./scripts/postgres.sh cargo bench --locked --bench store

bench-cluster: setup
	FSYNC=on MINUTES=$(or $(MINUTES),1) ./scripts/postgres.sh cargo bench --locked --bench cluster

bench-many: build
	JOBS=$(or $(JOBS),1000000) ./scripts/postgres.sh ./scripts/many.py

bench-blocks: build
	POINTS=$(or $(POINTS),1000000) WORKERS=$(or $(WORKERS),2) ./scripts/postgres.sh ./scripts/s3.sh ./scripts/blocks.py

upgrade: build
	OLD=$(OLD) ./scripts/postgres.sh ./scripts/s3.sh ./scripts/upgrade.py

storm: setup web
	CI=1 MESHWAY_STORM_KILLS=$(KILLS) ./scripts/postgres.sh ./scripts/s3.sh \
	  cargo test --locked --test service -- --exact --nocapture storm::everything_dies_and_nothing_is_lost

soak: setup
	@./scripts/soak.sh $(MINUTES)

KILLS ?= 500

soak-audit: setup web
	MESHWAY_AUDIT_KILLS=$(KILLS) cargo test --locked --test service -- --exact trust::every_answer_has_its_row_once_however_the_service_dies

fuzz-medical: setup
	cargo test --locked --test numerics -- --ignored --nocapture many_damaged_segmentations

deny:
	cargo deny --locked check licenses bans sources

clean:
	rm -rf target demo web/node_modules web/dist/*

# Needs python3 (3.11 or newer, with venv) and a C compiler. Every target makes .venv itself.
#   PYTHON=python3.12 make test      another interpreter (after `make clean`)
#   PIP_INDEX_URL, PIP_FIND_LINKS,…  are pip's own and honoured, for instance
#   PIP_EXTRA_INDEX_URL=https://download.pytorch.org/whl/cpu make demo    torch without CUDA

PYTHON ?= python3
BIN := .venv/bin
READY := .venv/.ready
WORKERS ?= 2
FUZZ_SECONDS ?= 300

.PHONY: help demo paper studies environments test test-slow test-events test-hostile prove prove-slow test-target test-ray test-clients lint docs bench bench-start bench-train growth corpus corpus-table sampling-report fuzz clean
.DELETE_ON_ERROR:

help:
	@echo "make demo | paper | studies | environments | test | test-slow | test-events | test-hostile | prove | prove-slow | test-target | test-ray | test-clients | lint | docs | bench | bench-start | bench-train | growth | corpus | sampling-report | fuzz | clean"

demo: $(READY)
	$(BIN)/dl2c demo

# The paper's evaluation, with five seeds: about a quarter of an hour on two cores.
paper: $(READY)
	$(BIN)/dl2c paper

# Six examples, each trained with its guards and without: about an hour. The pages go into docs/.
studies: $(READY)
	$(BIN)/dl2c study
	for page in build/studies/*/page.md; do \
	  folder=$$(dirname $$page); kept=docs/studies/$$(basename $$folder); \
	  mkdir -p $$kept && cp $$page $$folder/*.png $$kept/ || exit 1; done

# What policies achieve in each example, with films: about half an hour on one core. All goes into docs/environments.
environments: $(READY)
	$(BIN)/python docs/measure.py

test: $(READY)
	$(BIN)/python -m pytest -n $(WORKERS) -q -m "not slow"

test-slow: $(READY)
	$(BIN)/python -m pytest -n $(WORKERS) -q -m slow

# Random flows and programs against oracles that share no code with what they judge: half an hour or so on two
# cores. DL2C_FLOWS, DL2C_PROGRAMS and DL2C_SEED say how many and which; each test prints them.
test-events: $(READY)
	$(BIN)/python -m pytest -n $(WORKERS) -q -rP -m slow tests/campaigns $(addprefix --ignore ,$(filter tests/campaigns/%,$(HOSTILE)))

# 500 hostile models, built and proved, hostile files, 100 000 mutations of every format, killed builds, Ctrl-C in
# every command, little memory, reports in a browser, threads, sanitizers, and exported monitors against oracles:
# some hours on two cores.
# DL2C_STATES says how many states of a model monitors judge, DL2C_HOSTILE=100:120 which models are built.
HOSTILE := $(addprefix tests/campaigns/test_,mutations.py controller_relation.py hostile_models.py hostile_proofs.py) \
  $(addprefix tests/commands/test_,interrupted.py memory_limits.py) \
  $(addprefix tests/monitor/test_,monitor_functions.py monitor_sound.py) \
  $(addprefix tests/native/test_,builds_survive.py sanitized_handles.py) \
  $(addprefix tests/regression/test_,handles.py processes.py reliability.py) \
  tests/report/test_report_in_browser.py tests/test_endurance.py tests/test_hostile.py
test-hostile: $(READY)
	$(BIN)/python -m pytest -n $(WORKERS) -q $(HOSTILE)

# What is proved of the public models beside the checkout, with times: three quarters of an hour on two cores.
# DL2C_PROVE_SECONDS is the limit for each model, DL2C_PROVE a part of names of files to look at alone;
# DL2C_PROVE_BARE=1 takes invariants and tactics away; with DL2C_PROVE_AGREE=1 cvc5 is asked all that Z3 calls
# impossible, and what it says is counted.
prove: $(READY)
	$(BIN)/python tests/proof_table.py

# Mutants and random exact runs of what is proved, and policies with planted faults: nothing false may be called
# proved. Hours; DL2C_RUNS, DL2C_MUTANTS, DL2C_POLICY_STATES and DL2C_SEED say how many and which.
prove-slow: $(READY)
	$(BIN)/python -m pytest -n $(WORKERS) -q -rP -m slow tests/verify tests/policy_proof

# Exported monitors on an emulated Cortex-M4, and what an analyser says of their C.
TARGET_PROGRAMS := arm-none-eabi-gcc qemu-system-arm frama-c
TARGET_PACKAGES := gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm frama-c-base

test-target: $(READY)
	@command -v $(TARGET_PROGRAMS) >/dev/null && test "$$(command -v $(TARGET_PROGRAMS) | wc -l)" = 3 || \
	  { echo "make test-target: needs $(TARGET_PROGRAMS): apt install $(TARGET_PACKAGES)" >&2; exit 1; }
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile -q tests/monitor/test_target.py \
	  tests/monitor/test_monitor_size.py tests/monitor/test_monitor_analysed.py

# Sweeps over a cluster of Ray, RLlib and TorchRL, in .venv.ray: RLlib needs a Gymnasium of its own choice.
RAY := .venv.ray/bin/python

test-ray: .venv.ray/.ready
	$(RAY) -m pytest -q tests/training/test_sweeps.py tests/training/test_ray.py tests/env/test_rllib.py tests/env/test_torchrl.py

.venv.ray/.ready: pyproject.toml
	@test -x $(RAY) || $(PYTHON) -m venv .venv.ray || \
	  { rm -rf .venv.ray; echo "cannot make .venv.ray: install python3-venv" >&2; exit 1; }
	$(RAY) -m pip install -q torch
	$(RAY) -m pip install -q 'ray[rllib]>=2.40' torchrl hypothesis pytest -e '.[ray]'
	@touch $@

# Tests that Stable-Baselines3 and sb3-contrib ship, on environments of dl2c, and a training with each of four other
# libraries, each in an environment of its own: half an hour or so on one core, and 5 GB.
CLIENTS := stable-baselines3 sbx-rl skrl tianshou torchrl
stable-baselines3_PACKAGES := 'stable-baselines3[extra]' sb3-contrib moviepy
sbx-rl_PACKAGES := 'jax[cpu]' sbx-rl
tianshou_PACKAGES := 'tianshou>=2'
FREE := tianshou # of the versions in constraints.txt, with which only an old one can be installed

test-clients: $(CLIENTS:%=.venv.clients/%/.ready)
	@status=0; \
	.venv.clients/stable-baselines3/bin/python tests/clients/shipped_tests.py || status=1; \
	for client in $(filter-out stable-baselines3,$(CLIENTS)); do \
	  .venv.clients/$$client/bin/python -m pytest -q tests/clients/test_$${client%-rl}_trains.py || status=1; \
	done; \
	exit $$status

.venv.clients/%/.ready: pyproject.toml constraints.txt
	@test -x $(@D)/bin/python || $(PYTHON) -m venv $(@D) || \
	  { rm -rf $(@D); echo "cannot make $(@D): install python3-venv" >&2; exit 1; }
	$(@D)/bin/python -m pip install -q -c constraints.txt torch
	$(@D)/bin/python -m pip install -q $(if $(filter $(FREE),$*),,-c constraints.txt) $(or $($*_PACKAGES),$*) \
	  hypothesis pytest -e .
	@touch $@

lint: $(READY)
	@status=0; \
	$(BIN)/ruff check dl2c tests examples docs || status=1; \
	$(BIN)/pyright --pythonpath $(BIN)/python || status=1; \
	exit $$status

# The pages to read are in build/docs, those to play in build/docs/play, which say whether the theorem is proved
# (`verify` ends with 1 where it is refuted, with 3 where a part of it is not checked).
docs: $(READY)
	$(BIN)/python -m sphinx -W -q -b html -d build/docs/.doctrees docs build/docs
	for model in examples/*.kyx docs/lecture/unguarded.kyx; do \
	  $(BIN)/dl2c verify $$model >/dev/null; \
	  case $$? in 0|1|3) ;; *) exit 1;; esac; \
	done
	for model in examples/*.kyx; do \
	  $(BIN)/dl2c play $$model -o build/docs/play/$$(basename $$model .kyx).html || exit 1; \
	done
	$(BIN)/dl2c play docs/lecture/unguarded.kyx -o build/docs/play/unguarded.html
	$(BIN)/dl2c play examples/static_safety_line.kyx -o build/docs/play/guarded.html
	$(BIN)/dl2c play examples/static_safety_line.kyx --policy docs/lecture/policy -o build/docs/play/trained.html

# AGAINST=REV compares every row of every example with another revision instead, and `bench-start` whole commands:
# ratios with intervals, from turns. REQUIRE="batch1024=1.4 acc/gym=1" says what must be reached, EXAMPLES=waypoint,acc
# of which examples. Of one revision tests/bench/limits.py says it.
COMPARED = PYTHONPATH=tests $(BIN)/python tests/bench/against.py $(AGAINST) $(if $(EXAMPLES),--examples $(EXAMPLES)) \
  $(addprefix --require ,$(REQUIRE))

ifdef AGAINST
bench: $(READY)
	$(COMPARED)
else
bench: $(READY)
	$(BIN)/dl2c bench examples/waypoint.kyx --require gym=100 --require batch1024=5000 --require gym/empty=0.67 \
	  --require gym/cartpole=4 --require batch1024/scalar1024=3 --require batch1024/loop=1 \
	  --require sb3_4096/infos4096=0.833
	$(BIN)/dl2c bench examples/bouncing_ball.kyx --require batch1024/scalar1024=4
	$(BIN)/dl2c bench examples/watertank.kyx --verify --require bounds=3
	$(BIN)/dl2c bench examples/dubins.kyx --integrator cvodes --rtol 1e-6 --atol 1e-6 --require batch1024=30
	$(BIN)/dl2c bench examples/dubins.kyx --integrator dopri5 --rtol 1e-6 --atol 1e-6 --require batch1024=800 \
	  --require batch1024/scalar1024=3
endif

bench-start: $(READY)
	@test -n "$(AGAINST)" || { echo "make bench-start: set AGAINST to a revision" >&2; exit 1; }
	$(COMPARED) --start

# Trainings instead: steps per second and returns of five seeds, an hour or so for all examples. REQUIRE is one ratio.
bench-train: $(READY)
	@test -n "$(AGAINST)" || { echo "make bench-train: set AGAINST to a revision" >&2; exit 1; }
	PYTHONPATH=tests $(BIN)/python tests/bench/trainings.py $(AGAINST) $(if $(EXAMPLES),--examples $(EXAMPLES)) \
	  $(if $(REQUIRE),--require $(REQUIRE))

# How the cost of steps and builds grows with variables, paths and degrees: a quarter of an hour or so on one core.
growth: $(READY)
	PYTHONPATH=tests $(BIN)/python tests/bench/growth.py

# What becomes of every public model, where these are at hand (../shared/corpus), and how many of them run.
corpus: corpus-table
	$(BIN)/python tests/corpus_runs.py

corpus-table: $(READY)
	$(BIN)/python tests/corpus_table.py

# Five minutes, or FUZZ_SECONDS; atheris is not there for every Python and system.
fuzz: $(READY)
	@$(BIN)/python -c 'import atheris' 2>/dev/null || $(BIN)/python -m pip install -q -e '.[fuzz]' || \
	  { echo "make fuzz: atheris cannot be installed for $$($(BIN)/python -V); set PYTHON=" >&2; exit 1; }
	$(BIN)/python tests/fuzz/models.py $(FUZZ_SECONDS)

# Needs the public models beside the checkout.
sampling-report: $(READY)
	$(BIN)/python -m tests.sampling_report

clean:
	rm -rf .venv .venv.ray .venv.clients dist .pytest_cache .ruff_cache .hypothesis
	find build -mindepth 1 ! -name README.md -delete
	find . -name __pycache__ -not -path './.venv*' -exec rm -rf {} +

# torch comes first: stable-baselines3 would choose a version itself.
$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit("dl2c needs Python 3.11 or newer; set PYTHON=" if sys.version_info < (3, 11) else 0)'
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv || \
	  { rm -rf .venv; echo "cannot make .venv: install python3-venv" >&2; exit 1; }
	$(BIN)/python -m pip install -q -c constraints.txt torch
	$(BIN)/python -m pip install -q -c constraints.txt -e '.[train,dev,docs,zig]'
	@touch $@

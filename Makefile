# make demo · make test · make test-long · make check · make bench     (PYTHON=python3.12 make … for another interpreter)

PYTHON ?= python3
BIN := .venv/bin
GL_PACKAGES := libegl1 libegl-mesa0 libgl1-mesa-dri
APT := DEBIAN_FRONTEND=noninteractive apt-get
GL_CHECK := $(BIN)/python -c "from stages.sim.gl import gl_renderer; print('OpenGL:', gl_renderer())"
WITH_GL = MUJOCO_GL=$${MUJOCO_GL:-$$(cat .venv/gl)}

.PHONY: demo test test-long check bench format gl clean

demo: gl
	$(WITH_GL) $(BIN)/pipeline run demo

test: gl .venv/bench
	$(WITH_GL) $(BIN)/pytest -n 2 --dist loadfile --durations 10

# Damaged and hostile input of every kind, thousands of cases, others each time: minutes.
test-long: gl .venv/bench
	$(WITH_GL) HYPOTHESIS_PROFILE=long $(BIN)/pytest tests/hostile

check: .venv/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# What the benchmarks compare with: the public packages, which the pipeline itself does not need.
bench: gl .venv/bench
	@echo "now: $(BIN)/python -m benchmarks --help"

.venv/bench: .venv/installed requirements-bench.lock
	$(BIN)/python -m pip install --quiet --no-deps --requirement requirements-bench.lock
	@touch $@

format: .venv/installed
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# Exact versions, without dependency resolution: robosuite's teleoperation (pynput, evdev) and inverse kinematics (mink)
# stay out. Last, torch with its dependencies: nothing more for a CPU build, the CUDA libraries for a CUDA build.
.venv/installed: requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or newer is needed, $(PYTHON) is $$($(PYTHON) --version 2>&1): PYTHON=/path/to/python3.11 make" >&2; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' || { echo "Python's venv is missing: apt-get install python3-venv" >&2; exit 1; }
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --no-deps --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --constraint requirements.lock "$$(grep '^torch==' requirements.lock)"
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	@touch $@

gl: .venv/gl

# EGL, else OSMesa; else Mesa's EGL from apt-get where that is allowed; else the command that installs it.
.venv/gl: .venv/installed
	@for backend in $${MUJOCO_GL:-egl osmesa}; do \
	  if MUJOCO_GL=$$backend $(GL_CHECK) 2>/dev/null; then echo $$backend >$@; exit 0; fi; \
	done; \
	if ! command -v apt-get >/dev/null; then \
	  echo "No OpenGL to render with: install Mesa's EGL with your package manager" >&2; exit 4; \
	elif [ "$$(id -u)" = 0 ]; then $(APT) update -qq && $(APT) install -qq -y --no-install-recommends $(GL_PACKAGES); \
	elif sudo -n true 2>/dev/null; then sudo $(APT) update -qq && sudo $(APT) install -qq -y --no-install-recommends $(GL_PACKAGES); \
	else echo "No OpenGL to render with. Install it: sudo apt-get install $(GL_PACKAGES)" >&2; exit 4; fi; \
	MUJOCO_GL=egl $(GL_CHECK) && echo egl >$@

clean:
	rm -rf .venv .mypy_cache .pytest_cache .ruff_cache .import_linter_cache *.egg-info

PYTHON ?= python3
BIN := .venv/bin

.PHONY: demo install kernels test test-all bench lint docs screenshots store-directions wheel clean

demo: .venv/ready  ## install what a run needs, identify a UR5 from 20 s of noisy motion, say what was found
	$(BIN)/nsaid run ur5 --law efficient --sensors noisy --duration 20

install: .venv/installed  ## everything that tests and docs need as well

.venv/ready: pyproject.toml
	@$(PYTHON) scripts/install.py arms,view
	@touch $@

.venv/installed: pyproject.toml .venv/ready
	@$(PYTHON) scripts/install.py dev,docs
	@touch $@

# Two workers, a file at a time, in the order that tests/conftest.py chooses. Bytecode is kept even
# where the environment forbids it: tests start some hundred processes, 3 s of compiling each.
PYTEST := PYTHONDONTWRITEBYTECODE= OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

test: install  ## everything that a change must pass
	$(PYTEST) -m 'not slow'

test-all: install  ## with the long studies
	$(PYTEST)

kernels: install  ## translate all kernels for this platform, after an edit of their files
	OMP_NUM_THREADS=1 $(BIN)/python scripts/kernels.py

bench: install  ## cost of a step as ratios inside one process
	OMP_NUM_THREADS=1 $(BIN)/python scripts/benchmark.py

lint: install
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pyright

screenshots: install  ## docs/*.png from real recordings (needs a Vulkan driver)
	$(BIN)/python scripts/screenshots.py

store-directions: install  ## accept the directions that the scenarios now converge to
	OMP_NUM_THREADS=1 $(BIN)/python -m tests.recovery.store

docs: install  ## the site, in build/site/index.html
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

wheel: install
	$(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir dist .

clean:
	rm -rf .venv build dist runs

# Every target works by itself on a fresh clone with git and Python >= 3.11; all it downloads is PyPI packages.
#   make demo [DURATION=seconds] [OUT=folder]    drive the demo robot and write what its sensors see
#   make test | fuzz | check | bench | docs | test-oldest | clean
#   make pictures                                draw the errors of sensors: docs/sensors.md
#   make accuracy                                compare with mj_ray and with other ray casters: docs/accuracy.md
#   make performance                             time the cast beside other ray casters: docs/performance.md

PYTHON ?= python3
DURATION ?= 3
OUT ?= out/demo
JOBS ?= 2

BIN := .venv/bin
OLDEST := .venv-oldest/bin
# The oldest dependencies have no wheels for the newest Pythons.
OLDEST_PYTHON ?= $(firstword $(foreach v,3.11 3.12 3.13,$(shell command -v python$(v))) $(PYTHON))

.PHONY: demo pictures test fuzz check bench accuracy performance docs test-oldest clean
.DELETE_ON_ERROR:

# Where nothing is installed it needs only rigcast and what that needs, half of what tests need.
demo: $(or $(wildcard .venv/installed),.venv/base)
	$(BIN)/rigcast run configs/demo.yaml --duration $(DURATION) --out $(OUT)

pictures: .venv/installed
	$(BIN)/python examples/sensor_effects.py docs/sensors
	$(BIN)/python examples/lidar_effects.py docs/sensors
	$(BIN)/python examples/lidar_weather.py docs/sensors
	$(BIN)/python examples/motion_effects.py docs/sensors

test: .venv/installed
	$(BIN)/python -m pytest -n $(JOBS)

# The fuzz tests with 100 times the examples, other ones each time, and the tests that are too long for the suite.
fuzz: .venv/installed
	$(BIN)/python -m pytest -n $(JOBS) --hypothesis-profile=fuzz -m "hypothesis or long"

# Type checkers do not follow the editable install to its folders, so they get the package as a user has it. The rest of
# build/ stays: there are the links of an editable install in strict mode, which another environment may have.
check: .venv/installed
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	rm -rf build/lib build/installed
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --target build/installed .
	cd build/installed && ../../$(BIN)/mypy --config-file ../../pyproject.toml -p rigcast
	cd build/installed && ../../$(BIN)/mypy --config-file ../../pyproject.toml ../../tests ../../examples ../../benchmarks

bench: .venv/benchmark
	$(BIN)/rigcast bench warehouse g1 aloha_pot room hills

docs: .venv/docs
	rm -rf build/lib build/installed
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --target build/installed .
	DISABLE_MKDOCS_2_WARNING=true $(BIN)/python -m mkdocs build --strict

performance: .venv/benchmark
	$(BIN)/python benchmarks/performance.py

accuracy: .venv/benchmark
	$(BIN)/python benchmarks/accuracy.py

test-oldest: .venv-oldest/installed
	$(OLDEST)/python -m pytest -n $(JOBS)

clean:
	rm -rf .venv .venv-oldest build/lib build/installed build/bdist.* build/site dist out bench.json *.egg-info
	rm -rf .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

.venv/base: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --editable .
	touch $@

.venv/installed: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $@

.venv/benchmark: .venv/installed
	$(BIN)/python -m pip install --quiet --editable '.[benchmark]'
	touch $@

.venv/docs: .venv/installed
	$(BIN)/python -m pip install --quiet --editable '.[docs]'
	touch $@

.venv-oldest/installed: pyproject.toml
	$(OLDEST_PYTHON) -m venv .venv-oldest
	$(OLDEST)/python -c "import tomllib; \
	    project = tomllib.load(open('pyproject.toml', 'rb'))['project']; \
	    print(*(line.replace('>=', '==', 1) for line in project['dependencies']), sep='\n')" > .venv-oldest/oldest.txt
	$(OLDEST)/python -m pip install --quiet --constraint .venv-oldest/oldest.txt --editable '.[test]'
	touch $@

# make demo: set up and run the main job.   make test: set up and run every check.
PYTHON ?= python3
VENV := .venv/bin
export OPENBLAS_NUM_THREADS ?= 1
# Else every process of the tests compiles all of TCI and all tests anew.
unexport PYTHONDONTWRITEBYTECODE
OUT ?= out
# Where your index has no CPU build of PyTorch, it comes with 3 GB of CUDA, but for this:
# make learn LEARN_INDEX=https://download.pytorch.org/whl/cpu
LEARN_INDEX ?=
, := ,
# Live tests at a time: each may have a server with real-time priority, which needs 0.7 of a slow
# processor; a busy machine makes robots hold.
LIVE ?= 2
# Everything else runs beside them, in the time of the processors that they leave.
IDLE := $(if $(shell command -v chrt),chrt --idle 0,nice -n 19)

.PHONY: help demo test live first-live again beside not-live test-real peers loops quick lint docs pictures bench middleware soak fuzz reliability learn ftp1 release-check lock lowest clean run-env dev-env

help:  ## show this list
	@grep -E '^[a-z-]+:.*##' Makefile | sed -E 's/:.*## /\t/' | expand -t 8

run-env:
	@$(PYTHON) tools/bootstrap.py requirements/demo.txt

dev-env: run-env
	@$(PYTHON) tools/bootstrap.py requirements/dev.txt

demo: run-env  ## set up, then poke a simulated NAO and a simulated iCub; writes out/
	@$(VENV)/tci demo --out "$(OUT)"

test: dev-env  ## set up, then lint, docs and all tests
	@$(MAKE) --no-print-directory --jobs 2 --output-sync peers loops
	@failed=0; $(MAKE) --no-print-directory --jobs 4 --keep-going first-live beside || failed=1; \
	  $(MAKE) --no-print-directory again && exit $$failed

# Live tests that failed beside others run once more at the end, alone; those that fail again count.
FAILED := .pytest_cache/live/some-failed
LIVE_TESTS = TCI_CHECK_LOOPS=0 $(VENV)/python -m pytest -o cache_dir=.pytest_cache/live -m live

live: first-live
	@$(MAKE) --no-print-directory again

again: dev-env
	@test ! -e $(FAILED) || { echo "live tests that failed beside others, alone:"; \
	    $(LIVE_TESTS) --last-failed --last-failed-no-failures none; }

first-live: dev-env
	@rm -f $(FAILED); $(LIVE_TESTS) -n $(LIVE) --dist loadgroup --durations 10 || { \
	    test $$? = 1 && touch $(FAILED); }

beside: dev-env
	@$(IDLE) $(MAKE) --no-print-directory --output-sync not-live lint docs

not-live: dev-env
	@$(VENV)/python -m pytest -n logical --maxprocesses 8 --dist loadgroup --durations 10 -m "not live"

peers: dev-env
	@$(PYTHON) tools/peers.py

# The first loop that is imported has all of them compiled, side by side; the tests would wait for it.
loops: dev-env
	@$(VENV)/python -c "import tci.gate.gate"

quick: dev-env  ## lint, types and the tests of what changed since main, within a minute
	@$(VENV)/python tools/quick.py

test-real: dev-env  ## tests on genuine skin files and recordings (DATA=FOLDER, not part of this repository)
	@$(VENV)/python -m pytest -q -n logical --maxprocesses 8 --dist loadgroup -m data --data="$(DATA)"

lint: dev-env  ## ruff, strict types, and the types that users see
	@$(VENV)/ruff check .
	@$(VENV)/ruff format --check .
	@$(VENV)/mypy
	@$(VENV)/python tools/user_types.py

docs: dev-env  ## build the documentation; a warning is an error
	@$(VENV)/python -m sphinx -q -W --keep-going -b html docs docs/_build/html

pictures: peers  ## make the pictures of docs/images anew (needs chromium)
	@$(VENV)/python tools/pictures.py

bench: dev-env  ## every part beside its peers, as ratios; writes bench.json (CASES="kernel_4000 gate ...": some)
	@OUT="$(OUT)" $(VENV)/python tools/bench $(CASES)

middleware: peers  ## every middleware's tests and figures, every robot over each; writes two of docs/tables
	@$(VENV)/python tools/middleware
	@$(VENV)/python tools/middleware/robots.py

soak: dev-env  ## hostile commands through the gate, and a day of noise and drift on a skin (TCI_SOAK=cycles)
	@TCI_SOAK=$${TCI_SOAK:-200000} $(VENV)/python -m pytest -q tests/gate/test_gate.py tests/skin/test_long_conditioning.py -k "hostile or conditioning"

fuzz: dev-env  ## all that reads foreign bytes: coverage-guided (TCI_SECONDS each), and damaged ones (TCI_FUZZ=files)
	@for target in $$($(VENV)/python tools/reliability/fuzz.py); do echo "== $$target"; \
	  $(VENV)/python tools/reliability/fuzz.py $$target $${TCI_SECONDS:-20} || exit 1; done
	@TCI_FUZZ=$${TCI_FUZZ:-20000} TCI_FUZZ_WIRE=$${TCI_FUZZ_WIRE:-1000000} $(VENV)/python -m pytest -q \
	  tests/robot/test_xml.py tests/yarpwire tests/wires/yarp tests/wires/player/test_player.py tests/wires/lcm/test_lcm.py \
	  tests/drivers/test_remote_cdr.py -k "damaged or mutated or spoilt"

reliability: dev-env  ## the scoreboard of docs/reliability.md (FULL=1: full size); writes reliability.json
	@OUT="$(OUT)" FULL=$(FULL) ROWS="$(ROWS)" PAGE=$(PAGE) $(VENV)/python tools/reliability

# uv needs a tenth of pip's time; pip stays where uv can't, and for PyTorch, whose index pip's settings may name.
define install
@$(1)/bin/python -m pip install --quiet --require-hashes --requirement requirements/uv.txt || true
@$(1)/bin/uv pip install --quiet --system-certs --python $(1)/bin/python $(2) || $(1)/bin/python -m pip install --quiet $(2)
endef

learn:  ## train the policy of the tutorial in .learn (PyTorch; 8 minutes of a processor), and judge it
	@$(PYTHON) -m venv .learn
	@.learn/bin/python -m pip install --quiet $(if $(LEARN_INDEX),--extra-index-url $(LEARN_INDEX)) torch==2.13.0
	$(call install,.learn,torch==2.13.0 stable-baselines3==2.9.2 onnx==1.23.2 imageio==2.38.1 imageio-ffmpeg==0.8.1 proglog==0.1.12 \
	  python-dotenv==1.2.4 decorator==5.3.1 --editable ".[gym$(,)onnx$(,)icub$(,)robots]")
	@.learn/bin/python -m pip install --quiet --no-deps moviepy==2.2.1 # it asks for an older pillow than it needs
	@.learn/bin/python tools/environments.py
	@mkdir -p "$(OUT)"
	@.learn/bin/python examples/learning/train.py "$(OUT)/withdraw.onnx"
	@.learn/bin/python tools/policy.py "$(OUT)/withdraw.onnx"

lerobot:  ## genuine LeRobot 0.4.4 records robots of TCI, trains ACT on sets and judges it, in .lerobot (PyTorch)
	@$(PYTHON) -m venv .lerobot
	@.lerobot/bin/python -m pip install --quiet $(if $(LEARN_INDEX),--extra-index-url $(LEARN_INDEX)) torch==2.13.0
	@.lerobot/bin/python -m pip install --quiet --no-deps lerobot==0.4.4 torchvision==0.28.0 diffusers==0.35.2 # they ask for an older PyTorch
	$(call install,.lerobot,torch==2.13.0 datasets==4.8.5 huggingface-hub==0.35.3 einops==0.8.2 jsonlines==4.0.0 draccus==0.10.0 \
	  deepdiff==8.6.2 packaging==25.0 opencv-python-headless==4.12.0.88 av==15.1.0 accelerate==1.15.0 imageio==2.38.1 pyserial==3.5 \
	  regex termcolor==3.3.0 pynput==1.8.2 rerun-sdk==0.26.2 robovet==0.2.2 lerobot-doctor==0.2.0 --editable ".[gym$(,)icub$(,)robots$(,)parquet$(,)zenoh]")
	@.lerobot/bin/python -m pip install --quiet --no-deps --editable packages/lerobot_robot_tci
	@.lerobot/bin/python tools/with_lerobot.py --out "$(OUT)/lerobot"
	@.lerobot/bin/python tools/with_lerobot.py --robots nao --via zenoh --out "$(OUT)/lerobot-zenoh"
	@.lerobot/bin/python tools/set_doctors.py --out "$(OUT)/set_doctors"
	@.lerobot/bin/python tools/act.py --out "$(OUT)/act"

# FTP-1 is on no package index: FTP1 is a folder with its repository. This is a copy of
# michaelyuancb/ftp1-policy, at the commit whose ReplayBuffer was tried.
FTP1 ?= .ftp1/ftp1-policy
FTP1_FROM ?= https://github.com/shiwan-debug/ftp1-policy
FTP1_COMMIT := c0b3b6603a291b64c421a8f890f157d6c455e6ae
ftp1: dev-env  ## FTP-1's own ReplayBuffer opens sets that TCI wrote, in .ftp1 (FTP1=CLONE, else it is cloned from GitHub)
	@$(PYTHON) -m venv .ftp1
	@.ftp1/bin/python -m pip install --quiet --require-hashes --requirement requirements/peers/zarr3.txt
	@test -e "$(FTP1)/src/openpi/replay_buffer.py" || { git init --quiet "$(FTP1)" && \
	  git -C "$(FTP1)" fetch --quiet --depth 1 "$(FTP1_FROM)" $(FTP1_COMMIT) && git -C "$(FTP1)" checkout --quiet FETCH_HEAD; }
	@$(VENV)/python tools/with_ftp1.py "$(FTP1)" .ftp1/bin/python --out "$(OUT)/ftp1"

mjlab: dev-env  ## the skin as force sensor in genuine mjlab 1.6.0: its G1 in 4 worlds, in .mjlab (PyTorch, MuJoCo 3.11); compared with TCI's skin
	@$(PYTHON) -m venv .mjlab
	@.mjlab/bin/python -m pip install --quiet $(if $(LEARN_INDEX),--extra-index-url $(LEARN_INDEX)) torch==2.13.0 mjlab==1.6.0
	@.mjlab/bin/python -m pip install --quiet --no-deps --force-reinstall ./packages/mjlab_tci
	@.mjlab/bin/python tools/with_mjlab.py press "$(OUT)/mjlab.npz"
	@$(VENV)/python tools/with_mjlab.py judge "$(OUT)/mjlab.npz"

release-check: dev-env  ## build, install the sdist in empty environments, run the README (PYTHONS="python3.11 python3.12")
	@$(VENV)/python tools/release_check.py $(PYTHONS)

# Without batch: its mujoco 4.0.0 would hold mujoco-core back at 4.0.0, for all.
EXTRAS = $(shell $(PYTHON) -c "import tomllib; \
  print(*('--extra ' + one for one in tomllib.load(open('pyproject.toml', 'rb'))['project']['optional-dependencies'] if one != 'batch'))")
lock: dev-env  ## renew requirements/*.txt
	$(VENV)/uv pip compile --universal --python-version 3.11 --generate-hashes --index-url https://pypi.org/simple --no-emit-index-url \
	  --extra icub --extra naoqi --extra viewer --no-header pyproject.toml requirements/build.in -o requirements/demo.txt
	$(VENV)/uv pip compile --universal --python-version 3.11 --generate-hashes --index-url https://pypi.org/simple --no-emit-index-url \
	  $(EXTRAS) --group dev --no-header pyproject.toml -c requirements/demo.txt -o requirements/dev.txt
	$(VENV)/uv pip compile --universal --python-version 3.11 --generate-hashes --index-url https://pypi.org/simple --no-emit-index-url \
	  --resolution lowest-direct $(EXTRAS) --group dev --no-header pyproject.toml requirements/build.in -o requirements/lowest.txt
	for peer in requirements/uv.in requirements/peers/*.in requirements/bench/*.in; do $(VENV)/uv pip compile --universal --python-version 3.11 --generate-hashes \
	  --index-url https://pypi.org/simple --no-emit-index-url --no-header \
	  $$(grep -q '^# alone' $$peer && echo --no-deps) $$peer -o $${peer%.in}.txt || exit 1; done

lowest:  ## tests with the lowest versions that pyproject.toml allows, in .lowest (TESTS="tests/robot ...": some)
	@$(PYTHON) -m venv .lowest
	@.lowest/bin/python -m pip install --quiet --require-hashes --requirement requirements/lowest.txt
	@.lowest/bin/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	@NUMBA_CACHE_DIR="$(CURDIR)/.lowest/loops" .lowest/bin/python -m pytest -n 2 --dist loadgroup $(TESTS)

clean:  ## remove what was built
	rm -rf .venv .lowest .learn .lerobot .mjlab .ftp1 .peers out docs/_build docs/_generated dist .mypy_cache .ruff_cache .pytest_cache .hypothesis

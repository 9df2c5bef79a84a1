"""Judges the mutants that mutmut makes of gate and loop.

mutmut would start pytest again for each mutant, which takes longer than most tests. Here pytest collects the
tests once, and runs each test once to find out which lines it executes. Each mutant is judged in a fork of
this process. The fork runs the tests that execute the changed statement, until one fails. Tests that detected
other mutants of the same function run first.
"""

from __future__ import annotations

import ast
import os
import random
import resource
import signal
import sys
import textwrap
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import coverage
import hypothesis
import pytest
from _pytest.runner import runtestprotocol
from mutmut.mutation import trampoline
from mutmut.mutation.data import LineSpan, MutantLineSpans, SourceFileMutationData
from mutmut.utils.file_utils import walk_mutatable_files

KILLED, SURVIVED, NO_TESTS = 1, 0, 33
"""Exit codes of mutmut. A fork that a signal ends has the negative number of this signal."""
ATTEMPTS = 2
"""Number of times that a live test must fail, since a busy machine can make it fail without a mutant."""


@dataclass
class Mutant:
    """One changed function."""

    name: str
    data: SourceFileMutationData
    lines: range
    """Lines of the changed statement in the unchanged copy of the function, which mutmut keeps beside it."""
    tests: list[int] = field(default_factory=list)
    """Numbers of the tests that execute the statement."""

    @property
    def function(self) -> str:
        """Name of the function, which is equal for all its mutants."""
        return self.name.rpartition("__mutmut_")[0]


@dataclass
class Trial:
    """A fork that judges a mutant."""

    mutant: Mutant
    order: list[int]
    """Numbers of the tests, in the order in which they run."""
    failed: int
    """File descriptor from which the place in `order` of the test that failed can be read."""
    until: float
    """Time [s] at which it is ended."""
    attempt: int


def mutants_of(path: Path, again: bool) -> list[Mutant]:
    """Returns the mutants of a source file that have no result and, if `again`, those that no test has
    detected."""
    data, spans = SourceFileMutationData(path=path), MutantLineSpans.load(path)
    data.load()
    data.meta_path = data.meta_path.absolute()  # the tests run in another folder
    assert spans is not None
    lines = (Path("mutants") / path).read_text().splitlines()

    def source(name: str, span: LineSpan) -> list[str]:
        return [line.replace(name, "function") for line in lines[span.start - 1 : span.end]]

    found = []
    for name, code in data.exit_code_by_key.items():
        if code is not None and not (again and code in (SURVIVED, NO_TESTS)):
            continue
        mutated = name.rpartition(".")[2]
        unchanged = f"{mutated.rpartition('__mutmut_')[0]}__mutmut_orig"
        span = spans.span_by_function_name[unchanged]
        changed = spans.span_by_function_name[mutated]
        place = changed_statement(source(unchanged, span), source(mutated, changed))
        found.append(Mutant(name, data, range(span.start + place.start, span.start + place.stop)))
    return found


def changed_statement(unchanged: Sequence[str], mutated: Sequence[str]) -> range:
    """Returns the lines, counted from 0, of the smallest statement of a function that contains all changes.

    Of a statement such as `if`, only its condition counts if all changes are there. If the change is not in
    one statement, all lines of the function are returned.
    """
    first = common(unchanged, mutated)
    last = len(unchanged) - 1 - common(unchanged[::-1], mutated[::-1])
    first, last = min(first, len(unchanged) - 1), max(first, last)
    best = range(len(unchanged))
    for node in ast.walk(ast.parse(textwrap.dedent("\n".join(unchanged))).body[0]):
        if isinstance(node, ast.stmt) and node.end_lineno is not None:
            end = node.end_lineno
            if isinstance(node, ast.If | ast.For | ast.While | ast.With) and last + 1 < node.body[0].lineno:
                end = node.body[0].lineno - 1
            if node.lineno <= first + 1 and last + 1 <= end and end - node.lineno < len(best) - 1:
                best = range(node.lineno - 1, end)
    return best


def common(one: Iterable[str], other: Iterable[str]) -> int:
    """Returns how many lines are equal, from the beginning."""
    count = 0
    for a, b in zip(one, other, strict=False):
        if a != b:
            break
        count += 1
    return count


class Judge:
    """Plugin of pytest that judges mutants instead of running the tests."""

    def __init__(self, mutants: list[Mutant], until: float, jobs: int) -> None:
        """Ends at `until` [s], and runs `jobs` forks at the same time."""
        self.mutants, self.until, self.jobs = mutants, until, jobs
        self.items: list[pytest.Item] = []
        self.processor: list[float] = []
        self.wall: list[float] = []
        """Processor time and time [s] of each test without a mutant."""
        self.detected: defaultdict[str, Counter[int]] = defaultdict(Counter)
        """Number of mutants of a function that each test has detected."""
        self.running: dict[int, Trial] = {}

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection(self) -> None:
        """Makes tests with hypothesis repeatable. They don't look for a smaller example, which takes long."""
        phases = (hypothesis.Phase.explicit, hypothesis.Phase.generate)
        hypothesis.settings.register_profile(
            "mutants", deadline=None, derandomize=True, database=None, phases=phases
        )
        hypothesis.settings.load_profile("mutants")

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Judges all mutants."""
        self.items = session.items
        self._find_tests()
        self._start(Mutant("", SourceFileMutationData(path=""), range(0), [*range(len(self.items))]))
        pid, status = os.waitpid(next(iter(self.running)), 0)
        failure = _read(self.running.pop(pid).failed)
        assert not status, f"without a mutant a fork ends with {status} in test {failure}"
        waiting = random.Random(0).sample(self.mutants, len(self.mutants))
        # Those without a result come last, in random order: what is judged then is a random sample.
        waiting.sort(key=lambda mutant: mutant.data.exit_code_by_key[mutant.name] is None)
        for number, mutant in enumerate(waiting, start=1):
            while len(self.running) >= self.jobs:
                self._wait()
            if time.monotonic() > self.until:
                break
            if mutant.tests:
                self._start(mutant)
            else:
                self._keep(mutant, NO_TESTS)
            if not number % 50:
                print(f"{number} of {len(waiting)} mutants", flush=True)
        while self.running:
            self._wait()
        return True

    def _find_tests(self) -> None:
        """Runs each test once, and finds the tests of each mutant."""
        files = {
            str(mutant.data.path): str(Path(str(mutant.data.path)).absolute()) for mutant in self.mutants
        }
        traced = coverage.Coverage(data_file=None, include=[*files.values()], config_file=False)
        traced.start()
        for number, (item, following) in enumerate(zip(self.items, [*self.items[1:], None], strict=True)):
            traced.switch_context(str(number))
            processor, wall = time.process_time(), time.monotonic()
            failed = [one for one in runtestprotocol(item, log=False, nextitem=following) if one.failed]
            assert not failed, f"{item.nodeid} fails without a mutant: {failed[0].longreprtext}"
            self.processor.append(time.process_time() - processor)
            self.wall.append(time.monotonic() - wall)
        traced.stop()
        executed = {path: traced.get_data().contexts_by_lineno(file) for path, file in files.items()}
        for mutant in self.mutants:
            by_line = executed[str(mutant.data.path)]
            numbers = {test for line in mutant.lines for test in by_line.get(line, ()) if test}
            mutant.tests = sorted(map(int, numbers), key=lambda test: self.wall[test])
        print(f"{len(self.items)} tests, {sum(self.processor):.0f} s of processor time", flush=True)

    def _start(self, mutant: Mutant, attempt: int = 1) -> None:
        detected = self.detected[mutant.function]
        order = sorted(mutant.tests, key=lambda test: -detected[test])
        failed, tell = os.pipe()
        pid = os.fork()
        if not pid:
            self._run(mutant.name, order, tell)
        os.close(tell)
        until = time.monotonic() + 60.0 + 30.0 * sum(self.wall[test] for test in order)
        self.running[pid] = Trial(mutant, order, failed, until, attempt)

    def _run(self, name: str, order: list[int], tell: int) -> None:
        """Runs tests until one fails, and ends the process, which is a fork."""
        code = KILLED
        try:
            os.setpgid(0, 0)
            seconds = int(5.0 + 5.0 * sum(self.processor[test] for test in order))
            resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
            nothing = os.open(os.devnull, os.O_RDWR)
            os.dup2(nothing, 1)
            os.dup2(nothing, 2)
            trampoline.set_mutant_under_test(name)  # also for other processes that the tests start
            trampoline.get_mutant_under_test = lambda: name
            tests = [self.items[test] for test in order]
            for place, (test, following) in enumerate(zip(tests, [*tests[1:], None], strict=True)):
                if any(one.failed for one in runtestprotocol(test, log=False, nextitem=following)):
                    os.write(tell, place.to_bytes(4, "little"))
                    break
            else:
                code = SURVIVED
        finally:
            os._exit(code)

    def _wait(self) -> None:
        """Waits until a fork has ended, and stores its result."""
        pid = status = 0
        while pid not in self.running:
            pid, status = os.waitpid(-1, os.WNOHANG)
            if not pid:
                for late in (one for one, trial in self.running.items() if time.monotonic() > trial.until):
                    os.kill(late, signal.SIGXCPU)
                time.sleep(0.002)
        trial = self.running.pop(pid)
        failure = _read(trial.failed)
        with suppress(ProcessLookupError):  # processes that its tests have left
            os.killpg(pid, signal.SIGKILL)
        code = os.waitstatus_to_exitcode(status)
        if failure is None:
            self._keep(trial.mutant, code)
            return
        test = trial.order[failure]
        if self.items[test].get_closest_marker("live") and trial.attempt < ATTEMPTS:
            self._start(trial.mutant, trial.attempt + 1)
            return
        self.detected[trial.mutant.function][test] += 1
        self._keep(trial.mutant, code)

    def _keep(self, mutant: Mutant, code: int) -> None:
        """Stores a result, which `mutmut results` reads."""
        mutant.data.exit_code_by_key[mutant.name] = code
        mutant.data.save()


def _read(failed: int) -> int | None:
    """Returns the place of the test that failed; None if no test failed."""
    with os.fdopen(failed, "rb") as told:
        place = told.read(4)
    return int.from_bytes(place, "little") if place else None


def main() -> int:
    """Makes the mutants in the folder `mutants`, and judges those without a result. With the argument
    `again`, also judges those again that no test has detected.

    Environment variables: MINUTES is the time after which no other mutant is judged. JOBS is the number of
    processes.
    """
    import mutmut.__main__ as mutmut  # changes how processes start, also for those that only import this file

    until = time.monotonic() + 60.0 * float(os.environ.get("MINUTES", "inf"))
    trampoline.set_mutant_under_test("mutant_generation")
    Path("mutants").mkdir(exist_ok=True)
    mutmut.copy_src_dir()
    mutmut.copy_also_copy_files()
    mutmut.setup_source_paths()
    mutmut.create_mutants(1)
    tests = mutmut.config().pytest_add_cli_args_test_selection
    mutants = [mutant for path in walk_mutatable_files() for mutant in mutants_of(path, "again" in sys.argv)]
    if not mutants:
        return 0
    judge = Judge(mutants, until, int(os.environ.get("JOBS", os.cpu_count() or 1)))
    folder = Path.cwd() / "mutants"
    os.chdir(folder)
    os.environ["PYTHONPATH"] = os.pathsep.join([str(folder / "src"), str(folder / "tests")])
    trampoline.set_mutant_under_test("")
    trampoline.get_mutant_under_test = lambda: ""
    arguments = ["--rootdir=.", "--capture=no", "-q", "-p", "no:cacheprovider", *tests]
    return int(pytest.main(arguments, plugins=[judge]))


if __name__ == "__main__":
    raise SystemExit(main())

"""Cases at random for some time: python tests/fuzz [--seconds 60] [--seed 1] [--case NUMBER].

Each case runs in a child process, so that a crash is seen and told. A case that fails is shortened
and printed as a few lines of Python. Exit code 1 if one did.
"""

from __future__ import annotations

import argparse
import json
import re
import select
import subprocess
import sys
import time
from collections import Counter
from typing import Any

from draw import Case, draw

HANGS = 120.0  # seconds for one check
NUMBER = re.compile(r"[-+]?\d[\d.]*(e[-+]?\d+)?")
SHOWN = 2  # cases of one kind of failure that are printed


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--cases", type=int, default=10**9, help="how many at most")
    parser.add_argument("--case", type=int, help="this case alone")
    parser.add_argument("--long", type=int, default=1, help="times the length of long records")
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.case is not None:
        given.first, given.cases = given.case, 1
    return work(given) if given.worker else Driver(given).run()


# --- the child ----------------------------------------------------------------------------------


def work(given: Any) -> int:
    """Run cases; tell on standard output, a line of JSON each, what begins and what fails."""
    import checks

    checks.hushed()
    end = time.monotonic() + given.seconds
    for number in range(given.first, given.first + given.cases):
        if time.monotonic() > end:
            break
        case = draw(given.seed, number, given.long)
        told: dict[str, Any] = {"case": number, "check": ""}
        tell(told)
        values = made(case)
        checks.count["cases"] += 1
        checks.count["cases refused"] += values is None
        for check in case.checks if values is not None else ():
            tell({**told, "check": check})
            what = fault(case, check)
            if what:
                short = shortened(case, check)
                tell({**told, "failed": check, "what": what, "lines": short.told(check)})
        tell({"count": dict(checks.count)})
    return 0


def tell(line: dict[str, Any]) -> None:
    print(json.dumps(line), flush=True)


def made(case: Case) -> dict[str, Any] | None:
    """What the case makes; None where the library refuses it."""
    import checks

    values = checks.attempt(case.values)
    return None if checks.refused(values) else values


def fault(case: Case, check: str) -> str:
    """What is wrong, in a line; empty if nothing is."""
    import inspect

    import checks

    call = getattr(checks, check)
    try:
        values = made(case)
        if values is not None:
            call(*(values[name] for name in inspect.signature(call).parameters))
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a panic of the core is no Exception
        return f"{type(error).__name__}: {error}"
    return ""


def shortened(case: Case, check: str) -> Case:
    """The case with the fewest samples of its record with which it still fails."""
    if "y" not in case.record or "samples" in case.record:
        return case
    end = time.monotonic() + 5.0
    last = len(case.record["y"])
    for samples in range(1, last):
        if time.monotonic() > end:
            return case
        if fault(case.cut(0, samples), check):
            case, last = case.cut(0, samples), samples
            break
    for first in range(last - 1, 0, -1):
        if time.monotonic() < end and fault(case.cut(first, last - first), check):
            return case.cut(first, last - first)
    return case


# --- the parent ---------------------------------------------------------------------------------


class Driver:
    def __init__(self, given: Any) -> None:
        self.given = given
        self.end = time.monotonic() + given.seconds
        self.count: Counter[str] = Counter()
        self.kinds: Counter[str] = Counter()

    def run(self) -> int:
        first, last = self.given.first, self.given.first + self.given.cases
        while first < last and time.monotonic() < self.end:
            first = self.child(first, last - first)
        failed = sum(self.kinds.values())
        for kind, times in self.kinds.most_common():
            print(f"{times} times: {kind}")
        parts = [f"{self.count[name]:,} {name}" for name in ("cases", "cases refused", "steps")]
        parts += [f"{self.count[name]:,} {name}" for name in ("comparisons", "refusals")]
        print(f"fuzz, seed {self.given.seed}: {', '.join(parts)}; {failed} failed")
        return int(failed > 0)

    def child(self, first: int, cases: int) -> int:
        """Run cases in a child until it ends; the first case that is still to be run."""
        left = max(1.0, self.end - time.monotonic())
        seed = self.given.seed
        command = [sys.executable, __file__.removesuffix("/__main__.py"), "--worker"]
        command += ["--seed", seed, "--seconds", left, "--first", first, "--cases", cases]
        command += ["--long", self.given.long]
        child = subprocess.Popen(
            [str(word) for word in command],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            bufsize=1,
        )
        at: dict[str, Any] = {"case": first, "check": ""}
        counted: dict[str, int] = {}
        assert child.stdout is not None and child.stderr is not None
        hung = False
        while True:
            ready, _, _ = select.select([child.stdout], [], [], HANGS)
            if not ready:
                hung = True
                child.kill()
            line = child.stdout.readline()
            if not line:
                break
            told = json.loads(line)
            if "count" in told:
                counted = told["count"]
            elif "failed" in told:
                self.failed(told["case"], told["failed"], told["what"], told["lines"])
            else:
                at = told
        errors = child.stderr.read().strip()
        code = child.wait()
        self.count.update(counted)
        if code == 0:
            return first + cases
        how = f"no answer in {HANGS:g} s" if hung else f"the process ended with {code}: {errors}"
        case = draw(seed, at["case"], self.given.long)
        check = at["check"]
        self.failed(case.number, check, how, case.told(check) if check else "\n".join(case.lines))
        return int(at["case"]) + 1

    def failed(self, number: int, check: str, what: str, lines: str) -> None:
        kind = f"{check}: {NUMBER.sub('#', what)[:80]}"
        self.kinds[kind] += 1
        if self.kinds[kind] <= SHOWN:
            print(
                f"# case {number} of seed {self.given.seed}, {check}: {what}\n{lines}\n", flush=True
            )


if __name__ == "__main__":
    sys.exit(main())

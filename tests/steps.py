"""Times the steps of a test run and prints them as a table.

    steps.py run NAME COMMAND [ARGUMENT ...]   runs a step, shows its output, records what it took
    steps.py table                             prints the recorded steps and the ten slowest tests

The file FLEETCAL_STEPS holds a JSON line a step. Wall and CPU seconds are of the step's process and
all that it waited for; tests are counted by the closing lines of cargo, nextest, Vitest and Playwright.
"""

import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path

SLOWEST = 10
COUNTS = (
    re.compile(r"^\s*Summary \[.*\] +(?P<run>\d+)(?:/\d+)? tests? run: (?P<passed>\d+) passed"),
    re.compile(r"^test result: \w+\. (?P<passed>\d+) passed; (?P<failed>\d+) failed"),
    re.compile(r"^\s*Tests\s+(?:(?P<failed>\d+) failed \| )?(?P<passed>\d+) passed"),
    re.compile(r"^\s+(?P<passed>\d+) passed \("),
    re.compile(r"^\s+(?P<failed>\d+) failed$"),
)
TIMES = (
    re.compile(r"^\s*(?:PASS|FAIL|SLOW|TRY \d+ \w+) \[\s*(?P<seconds>[\d.]+)s\] (?:\(.*?\) )?(?P<test>\S.*)$"),
    re.compile(r"^\s*[✓✘]\s+\d+ (?P<test>\S.*) \((?:(?P<minutes>[\d.]+)m|(?P<seconds>[\d.]+)(?P<unit>ms|s))\)$"),
)
COLOURS = re.compile(r"\x1b\[[0-9;]*m")


class Output:
    """The lines of a step: how many tests ran, and how long each took."""

    def __init__(self) -> None:
        self.passed = 0
        self.failed = 0
        self.tests: dict[str, float] = {}

    def take(self, line: str) -> None:
        """Reads one line."""
        for pattern in COUNTS:
            if found := pattern.match(line):
                groups = found.groupdict()
                passed = int(groups.get("passed") or 0)
                ran = int(groups.get("run") or 0)
                self.passed += passed
                self.failed += max(int(groups.get("failed") or 0), ran - passed)
                return
        for pattern in TIMES:
            if found := pattern.match(line):
                self.tests[found["test"]] = seconds_of(found.groupdict())
                return


def seconds_of(groups: dict[str, str | None]) -> float:
    """Seconds of a duration as Playwright and nextest write it."""
    if minutes := groups.get("minutes"):
        return 60.0 * float(minutes)
    return float(groups["seconds"] or 0) / (1000.0 if groups.get("unit") == "ms" else 1.0)


def run(name: str, command: list[str]) -> int:
    """Runs a step and records it, whether it passes or fails."""
    output = Output()
    began = time.monotonic()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    assert process.stdout is not None
    for raw in process.stdout:
        sys.stdout.buffer.write(raw)
        sys.stdout.buffer.flush()
        output.take(COLOURS.sub("", raw.decode(errors="replace").rstrip()))
    _, status, used = os.wait4(process.pid, 0)
    code = os.waitstatus_to_exitcode(status)
    step = {
        "step": name,
        "wall_s": round(time.monotonic() - began, 1),
        "cpu_s": round(used.ru_utime + used.ru_stime, 1),
        "passed": output.passed,
        "failed": output.failed,
        "exit": code,
        "slowest": sorted(output.tests.items(), key=lambda test: -test[1])[:SLOWEST],
    }
    with file().open("a") as steps:
        steps.write(json.dumps(step) + "\n")
    return code if code >= 0 else 128 - code


def table() -> int:
    """Prints the recorded steps, their sum, and the slowest tests of all."""
    steps = [json.loads(line) for line in file().read_text().splitlines()]
    tests = [(seconds, test) for step in steps for test, seconds in step["slowest"]]
    print(f"\n{'step':<24}{'wall s':>9}{'CPU s':>9}{'tests':>7}")
    for step in steps:
        count = step["passed"] + step["failed"]
        mark = "" if step["exit"] == 0 else f"  failed: exit status {step['exit']}"
        print(f"{step['step']:<24}{step['wall_s']:>9.1f}{step['cpu_s']:>9.1f}{count or '':>7}{mark}")
    wall, cpu = (sum(step[key] for step in steps) for key in ("wall_s", "cpu_s"))
    passed, failed = (sum(step[key] for step in steps) for key in ("passed", "failed"))
    print(f"{'all':<24}{wall:>9.1f}{cpu:>9.1f}{passed + failed:>7}")
    if tests:
        print("\nslowest tests, s")
        for seconds, test in sorted(tests, reverse=True)[:SLOWEST]:
            print(f"{seconds:>9.1f}  {test}")
    print(f"\n{passed} passed, {failed} failed")
    return 0


def file() -> Path:
    """The file of the steps, made where it is missing."""
    path = Path(os.environ["FLEETCAL_STEPS"])
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()
    return path


def main(arguments: list[str]) -> int:
    """Reads the command line."""
    match arguments:
        case ["run", name, *command] if command:
            return run(name, command)
        case ["table"]:
            return table()
    print(__doc__.strip(), file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

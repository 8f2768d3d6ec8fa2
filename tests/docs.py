"""Runs the shell blocks of the documentation: those fenced as ```sh,run, page by page.

Each page has a shell and an empty folder of its own; what a block leaves running ends with its
page. Usage: docs.py FLEETCAL_BINARY [PAGE.md ...]
"""

import os
import re
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

# A page that takes longer has a block that waits for ever.
PAGE_WITHIN_S = 300
BLOCK = re.compile(r"^```sh,run\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks(page: Path) -> list[str]:
    """The blocks of a page that can be run."""
    return BLOCK.findall(page.read_text())


def run(page: Path, binary: Path) -> bool:
    """Runs a page's blocks in one shell; prints its output if it fails."""
    script = "set -euo pipefail\n" + "\n".join(blocks(page))
    path = f"{binary.parent}{os.pathsep}{os.environ['PATH']}"
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as output:
        shell = subprocess.Popen(
            ["bash", "-c", script],
            cwd=folder,
            env={**os.environ, "PATH": path},
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            code = shell.wait(PAGE_WITHIN_S)
        except subprocess.TimeoutExpired:
            code = None
        end(shell)
        if code == 0:
            return True
        output.seek(0)
        sys.stdout.write(output.read().decode(errors="replace"))
        print(f"{page}: {'timed out' if code is None else f'exit status {code}'}")
        return False


def end(shell: subprocess.Popen) -> None:
    """Ends everything that the shell has started: its process group."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        try:
            os.killpg(shell.pid, number)
        except ProcessLookupError:
            return
        try:
            shell.wait(10)
        except subprocess.TimeoutExpired:
            continue


def main() -> int:
    """Runs the named pages, or all that have blocks."""
    root = Path(__file__).resolve().parent.parent
    binary = Path(sys.argv[1]).resolve()
    named = [Path(name) for name in sys.argv[2:]]
    pages = named or [root / "README.md", *sorted((root / "docs").glob("*.md"))]
    failed = 0
    for page in pages:
        if count := len(blocks(page)):
            ok = run(page, binary)
            print(f"{page.name}: {count} blocks {'passed' if ok else 'FAILED'}", flush=True)
            failed += not ok
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

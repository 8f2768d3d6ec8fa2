"""Sends generated requests to a running service as each role, by its own OpenAPI document.

Fails on a status of 5xx, and on any status, header, content type or body that the document does not
have. Usage: hardening_api.py FLEETCAL EXAMPLES [ROLE…]
"""

import json
import os
import socket
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from pathlib import Path

ROLES = ["nobody", "viewer", "operator", "approver", "admin", "robot"]
CHECKS = [
    "not_a_server_error",
    "status_code_conformance",
    "content_type_conformance",
    "response_headers_conformance",
    "response_schema_conformance",
]
# Event streams have no end. A token that deletes itself ends its own run.
LEFT_OUT = ["/api/v1/stream", "/api/v1/tokens/{id}"]
CONFIG = """
[[robot]]
id = "tugger_01"
model = "bicycle"
wheelbase_m = 1.2

[[robot]]
id = "tugger_02"
model = "tricycle"
wheelbase_m = 1.4
"""


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def start(fleetcal, folder):
    """Starts a service; returns its process and URL once it is ready."""
    http, zenoh = free_port(), free_port()
    config = folder / "fleetcal.toml"
    config.write_text(CONFIG)
    arguments = ["serve", "--config", config, "--data", folder / "data"]
    arguments += ["--http", f"127.0.0.1:{http}", "--listen", f"tcp/127.0.0.1:{zenoh}"]
    log = (folder / "service.log").open("w")
    service = subprocess.Popen([fleetcal, *arguments], stdout=log, stderr=log)
    url = f"http://127.0.0.1:{http}"
    for _ in range(600):
        try:
            urllib.request.urlopen(f"{url}/readyz", timeout=1).read()
            return service, url
        except (urllib.error.URLError, OSError):
            time.sleep(0.1)
    service.kill()
    raise SystemExit(f"the service is not ready:\n{(folder / 'service.log').read_text()}")


def token(fleetcal, folder, role):
    arguments = ["token", "create", "--data", folder / "data", "--role", role, "--name", f"{role}-1"]
    if role == "robot":
        arguments += ["--robot", "tugger_01"]
    made = subprocess.run([fleetcal, *arguments], check=True, capture_output=True, text=True)
    return made.stdout.strip()


def call(url, path, secret, body=None, headers=()):
    """Returns the answer to GET, or to POST with a body."""
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(f"{url}{path}", data=data)
    request.add_header("Authorization", f"Bearer {secret}")
    request.add_header("Content-Type", "application/json")
    for name, value in headers:
        request.add_header(name, value)
    with urllib.request.urlopen(request, timeout=30) as answer:
        return json.load(answer)


def main():
    fleetcal, examples, *roles = sys.argv[1:]
    folder = Path(tempfile.mkdtemp(prefix="fleetcal-hardening-api-"))
    service, url = start(fleetcal, folder)
    failed = []
    try:
        tokens = {role: token(fleetcal, folder, role) for role in ROLES if role != "nobody"}
        document = folder / "openapi.json"
        document.write_text(json.dumps(call(url, "/api/v1/openapi.json", tokens["admin"])))
        values = {"steering_offset_rad": 0.01, "lidar_x_m": 0.4, "lidar_y_m": 0.0}
        proposal = {"robot": "tugger_01", "values": {**values, "lidar_yaw_rad": 0.0}, "reason": "by hand"}
        once = [("Idempotency-Key", "one")]
        call(url, "/api/v1/proposals", tokens["operator"], proposal, once)
        for role in roles or ROLES:
            print(f"== {role}", flush=True)
            tool = Path(sys.executable).parent / "schemathesis"
            run = [tool, "--no-color", "run", document, "--url", url, "--checks", ",".join(CHECKS)]
            run += ["--max-examples", examples, "--seed", "1", "--generation-database", "none"]
            run += ["--request-timeout", "30", "--warnings", "off", "--continue-on-failure"]
            for path in LEFT_OUT:
                run += ["--exclude-path", path]
            if role != "nobody":
                run += ["--header", f"Authorization: Bearer {tokens[role]}"]
            if subprocess.run(run, cwd=folder, check=False).returncode != 0:
                failed.append(role)
            if service.poll() is not None:
                failed.append(f"the service, which ended with {service.returncode}")
                break
        log = (folder / "service.log").read_text()
        if "panicked" in log:
            failed.append(f"a task that panicked, in {folder / 'service.log'}")
    finally:
        service.kill()
        service.wait()
    if failed:
        raise SystemExit(f"failed: {', '.join(failed)}")
    print("no 5xx, and no answer that the document does not have")


if __name__ == "__main__":
    os.environ.setdefault("PYTHONUNBUFFERED", "1")
    main()

#!/usr/bin/env python3
"""Print the figures of `fleetcal odometry` on the real recordings under FLEETCAL_DATA.

    FLEETCAL_DATA=DIR odometry/benches/recordings.py [--venv DIR] [--fleetcal BINARY]

`unsw_ugv.mcap`: scatter of the returns from the five reflector poles (intensity above 0) about
their means, and how far each pole has moved from the first 15 s to the last 15 s.
`freiburg_079.mcap`: error of the motion against the reference, the median over both coordinates
(the reference's own noise, 1 cm a coordinate, is part of it), and the median of the yaw's.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import venv

ROOT = pathlib.Path(__file__).resolve().parents[2]
PACKAGES = ["numpy", "mcap==1.4.0", "mcap-ros2-support==0.5.7"]


def enter_environment(options) -> None:
    """Starts this script again under the environment's interpreter."""
    python = options.venv / "bin" / "python"
    if not python.exists():
        venv.create(options.venv, with_pip=True)
    subprocess.run([python, "-m", "pip", "install", "-q", *PACKAGES], check=True)
    arguments = [str(python), __file__, "--inside", "--fleetcal", options.fleetcal]
    sys.exit(subprocess.run(arguments).returncode)


def odometry(fleetcal, recording):
    """The trajectory, rows of (stamp in s, x, y, yaw), and the summary."""
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "trajectory.tum"
        command = [*fleetcal.split(), "odometry", str(recording)]
        command += ["--trajectory", str(path), "--json"]
        done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
        rows = np.loadtxt(path)
    yaw = 2 * np.arctan2(rows[:, 6], rows[:, 7])
    return np.column_stack([rows[:, 0], rows[:, 1], rows[:, 2], yaw]), json.loads(done.stdout)


def messages(recording, topic):
    with open(recording, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, _, _, message in reader.iter_decoded_messages(topics=[topic]):
            stamp = message.header.stamp
            yield stamp.sec + 1e-9 * stamp.nanosec, message


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def motion(poses, lag):
    """The motion over `lag` poses, seen from the earlier."""
    a, b = poses[:-lag], poses[lag:]
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    return np.column_stack([c * dx + s * dy, c * dy - s * dx, wrap(b[:, 2] - a[:, 2])])


def say(name, summary):
    states = ", ".join(f"{count} {state}" for state, count in summary["tracking"].items() if count)
    print(f"{name}: {summary['scans']} scans ({states}), {summary['map_restarts']} map restarts,")
    print(f"  {summary['scan_median_ms']:.3f} ms a scan (median)")


def freiburg(fleetcal, folder):
    recording = folder / "freiburg_079.mcap"
    rows, summary = odometry(fleetcal, recording)
    reference = []
    for stamp, message in messages(recording, "/reference/pose"):
        position, q = message.pose.pose.position, message.pose.pose.orientation
        reference.append((stamp, position.x, position.y, 2 * np.arctan2(q.z, q.w)))
    reference = np.array(reference)
    nearest = np.abs(reference[:, None, 0] - rows[None, :, 0]).argmin(axis=0)
    matches = np.abs(reference[nearest, 0] - rows[:, 0]) < 1e-3
    poses, truth = rows[matches, 1:], reference[nearest[matches], 1:]
    say("freiburg_079", summary)
    for lag in (1, 10, 50):
        error = motion(poses, lag) - motion(truth, lag)
        centimetres = 100 * np.median(np.abs(error[:, :2]))
        degrees = np.degrees(np.median(np.abs(wrap(error[:, 2]))))
        print(f"  over {lag:2} scans: {centimetres:.2f} cm, {degrees:.3f} deg")


def unsw(fleetcal, folder):
    recording = folder / "unsw_ugv.mcap"
    rows, summary = odometry(fleetcal, recording)
    returns = []
    for stamp, scan in messages(recording, "/ugv/scan"):
        row = rows[np.abs(rows[:, 0] - stamp).argmin()]
        if abs(row[0] - stamp) > 1e-3:
            continue
        ranges, intensities = np.array(scan.ranges), np.array(scan.intensities)
        bright = np.flatnonzero((intensities > 0) & (ranges < 30.0))
        angle = row[3] + scan.angle_min + scan.angle_increment * bright
        x, y = row[1] + ranges[bright] * np.cos(angle), row[2] + ranges[bright] * np.sin(angle)
        returns.append(np.column_stack([np.full(len(bright), stamp), x, y]))
    returns = np.concatenate(returns)
    say("unsw_ugv", summary)
    first, last, scatter = returns[0, 0], returns[-1, 0], []
    for pole in poles(returns[:, 1:]):
        near = returns[np.hypot(*(returns[:, 1:] - pole).T) < 0.3]
        about_mean = near[:, 1:] - near[:, 1:].mean(axis=0)
        scatter.append((about_mean**2).sum(axis=1))
        begin = near[near[:, 0] < first + 15.0][:, 1:]
        end = near[near[:, 0] > last - 15.0][:, 1:]
        drift = 100 * np.hypot(*(end.mean(axis=0) - begin.mean(axis=0)))
        rms = 100 * np.sqrt(scatter[-1].mean())
        print(f"  pole at {pole.round(2)}: scatter {rms:.1f} cm, moved by {drift:.1f} cm")
    print(f"  all poles: scatter {100 * np.sqrt(np.concatenate(scatter).mean()):.2f} cm")


def poles(points, count=5):
    """Middles of the largest clusters."""
    found = []
    for _ in range(count):
        some = points[:: max(1, len(points) // 2000)]
        distances = np.hypot(*(some[:, None] - some[None]).transpose(2, 0, 1))
        middle = some[(distances < 0.15).sum(axis=1).argmax()]
        for _ in range(5):
            middle = np.median(points[np.hypot(*(points - middle).T) < 0.3], axis=0)
        found.append(middle)
        points = points[np.hypot(*(points - middle).T) > 0.5]
    return found


def main(options):
    folder = os.environ.get("FLEETCAL_DATA")
    if not folder:
        sys.exit("FLEETCAL_DATA is not set: it names the folder with the recordings")
    unsw(options.fleetcal, pathlib.Path(folder))
    freiburg(options.fleetcal, pathlib.Path(folder))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--venv", type=pathlib.Path, default=ROOT / "target" / "recordings-venv")
    parser.add_argument("--fleetcal", default="cargo run --release --locked -q -p fleetcal --")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if not options.inside:
        enter_environment(options)
    import numpy as np
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    main(options)

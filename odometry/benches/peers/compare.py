#!/usr/bin/env python3
"""Compare fleetcal's LiDAR odometry with others on the same simulated drive, in the same run.

    odometry/benches/peers/compare.py [--venv DIR]

Makes a virtual environment, installs small_gicp and kiss-icp from PyPI into it, lets the example
`lidar_odometry_figures` write a figure-eight of rolling scans (1024 beams, 10 Hz, 1.5 cm noise,
three walking people) with its truth, runs all engines over it on one core, and prints the median
time of a scan and the error of the motion over one second (root mean square).
"""

import argparse
import os
import pathlib
import struct
import subprocess
import sys
import tempfile
import time
import venv

ROOT = pathlib.Path(__file__).resolve().parents[3]
PACKAGES = ["numpy", "small_gicp==1.0.0", "kiss-icp==1.2.3"]
EXAMPLE = [
    "cargo", "run", "--release", "--locked", "-q",
    "-p", "fleetcal-odometry", "--example", "lidar_odometry_figures", "--",
]  # fmt: skip


def enter_environment(directory: pathlib.Path) -> None:
    """Starts this script again under the environment's interpreter."""
    python = directory / "bin" / "python"
    if not python.exists():
        venv.create(directory, with_pip=True)
    subprocess.run([python, "-m", "pip", "install", "-q", *PACKAGES], check=True)
    arguments = [str(python), __file__, "--inside"]
    # One core for everybody, whatever threads an engine would like.
    environment = dict(os.environ, OMP_NUM_THREADS="1", TBB_NUM_THREADS="1")
    sys.exit(subprocess.run(arguments, env=environment).returncode)


def read_scans(path):
    """Scans as the example writes them: (stamp in s, points, beam times in s, true pose)."""
    data, offset, scans = path.read_bytes(), 0, []
    while offset < len(data):
        stamp, first, step, tick, x, y, yaw, beams = struct.unpack_from("<q6dI", data, offset)
        offset += struct.calcsize("<q6dI")
        ranges = np.frombuffer(data, "<f4", beams, offset).astype(float)
        offset += 4 * beams
        seen = np.isfinite(ranges)
        angles = (first + step * np.arange(beams))[seen]
        points = np.zeros((seen.sum(), 3))
        points[:, 0] = ranges[seen] * np.cos(angles)
        points[:, 1] = ranges[seen] * np.sin(angles)
        scans.append((stamp * 1e-9, points, tick * np.arange(beams)[seen], (x, y, yaw)))
    return scans


def matrix(pose):
    x, y, yaw = pose
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def errors_over_a_second(poses, truths, lag=10):
    """Root mean square error of the motion: mm, degrees."""
    inverse = np.linalg.inv
    errors = []
    for i in range(lag, len(poses)):
        motion = inverse(poses[i - lag]) @ poses[i]
        true_motion = inverse(truths[i - lag]) @ truths[i]
        errors.append(inverse(true_motion) @ motion)
    errors = np.array(errors)
    position = np.hypot(errors[:, 0, 3], errors[:, 1, 3])
    yaw = np.arctan2(errors[:, 1, 0], errors[:, 0, 0])
    return 1e3 * np.sqrt(np.mean(position**2)), np.degrees(np.sqrt(np.mean(yaw**2)))


def run_small_gicp(scans):
    """Scan to a growing voxel map by VGICP, started from constant velocity; as its example does."""
    import small_gicp

    voxelmap = small_gicp.GaussianVoxelMap(0.5)
    voxelmap.set_lru(horizon=100, clear_cycle=10)
    pose, last_motion, poses, times = np.eye(4), np.eye(4), [], []
    for index, (_, points, _, _) in enumerate(scans):
        begin = time.perf_counter()
        cloud, _ = small_gicp.preprocess_points(points, downsampling_resolution=0.1, num_threads=1)
        if index > 0:
            result = small_gicp.align(
                voxelmap, cloud, pose @ last_motion, max_correspondence_distance=1.0, num_threads=1
            )
            last_motion, pose = np.linalg.inv(pose) @ result.T_target_source, result.T_target_source
        voxelmap.insert(cloud, pose)
        times.append(time.perf_counter() - begin)
        poses.append(pose)
    return poses, times


def run_kiss_icp(scans):
    """KISS-ICP with its own deskewing; its poses are the scan's end, ours its middle."""
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP

    config = KISSConfig()
    config.data.deskew, config.data.max_range, config.data.min_range = True, 40.0, 0.2
    config.mapping.voxel_size = 0.3
    engine, poses, times = KissICP(config), [], []
    for _, points, ticks, _ in scans:
        begin = time.perf_counter()
        engine.register_frame(points, ticks / ticks.max())
        times.append(time.perf_counter() - begin)
        poses.append(np.array(engine.last_pose))
    return poses, times


def truths_at_ends(scans):
    """True poses half a scan later, between the middles on both sides."""
    ends = []
    for (_, _, _, now), (_, _, _, after) in zip(scans, scans[1:] + scans[-1:]):
        motion = np.linalg.inv(matrix(now)) @ matrix(after)
        yaw = 0.5 * np.arctan2(motion[1, 0], motion[0, 0])
        ends.append(matrix(now) @ matrix((*half_way(motion[0, 3], motion[1, 3], yaw), yaw)))
    return ends


def half_way(x, y, half_yaw):
    """The middle of the arc to (x, y) that turns by twice `half_yaw`."""
    length = np.hypot(x, y) / 2 / max(np.cos(half_yaw / 2), 1e-9)
    heading = np.arctan2(y, x) - half_yaw / 2
    return length * np.cos(heading), length * np.sin(heading)


def main():
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "scans.bin"
        arguments = [*EXAMPLE, "--scans", str(path)]
        table = subprocess.run(arguments, cwd=ROOT, check=True, capture_output=True, text=True)
        scans = read_scans(path)
    print(table.stdout)
    ours = next(line for line in table.stdout.splitlines() if line.startswith("figure-eight"))
    ms, _, mm, degrees = (float(word) for word in ours.split()[1:5])
    print("engine                       ms median  mm over 1 s  deg over 1 s")
    print(f"{'fleetcal':28} {ms:9.3f} {mm:12.2f} {degrees:13.4f}")
    middles = [matrix(truth) for _, _, _, truth in scans]
    for name, run, truths in (
        ("small_gicp (VGICP)", run_small_gicp, middles),
        ("kiss-icp, at the scan's end", run_kiss_icp, truths_at_ends(scans)),
    ):
        poses, times = run(scans)
        peer_mm, peer_degrees = errors_over_a_second(poses, truths)
        peer_ms = 1e3 * float(np.median(times))
        print(f"{name:28} {peer_ms:9.3f} {peer_mm:12.2f} {peer_degrees:13.4f}", end="")
        print(f"   fleetcal is {peer_ms / ms:.0f} times faster")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--venv", type=pathlib.Path, default=ROOT / "target" / "peers-venv")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if not options.inside:
        enter_environment(options.venv)
    import numpy as np

    main()

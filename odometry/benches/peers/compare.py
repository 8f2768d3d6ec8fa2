#!/usr/bin/env python3
"""Compare fleetcal's LiDAR odometry with others on the same simulated scans, in the same run.

    odometry/benches/peers/compare.py [--venv DIR] [--figures FILE --commit ID --date DAY]

Makes a virtual environment, installs small_gicp, kiss-icp and genz-icp from PyPI into it, lets the
example `peer_scenes` drive through a hall, a corridor and an open yard (rolling scans of 1024 beams,
10 Hz, 1.5 cm noise) and write the scans with their truth, and runs all engines over them on one core.
Prints for each the median time of a scan, the error of the motion over one second (root mean square)
along and across the way and in yaw, and the part of the scans with which a direction that nothing in
sight fixes is reported. `--figures` writes the same as a campaign's results.
"""

import argparse
import json
import os
import pathlib
import struct
import subprocess
import sys
import tempfile
import time
import venv

ROOT = pathlib.Path(__file__).resolve().parents[3]
PACKAGES = ["numpy", "small_gicp==1.0.0", "kiss-icp==1.3.0", "genz-icp==0.3.2"]
EXAMPLE = [
    "cargo", "run", "--release", "--locked", "-q",
    "-p", "fleetcal-odometry", "--example", "peer_scenes", "--",
]  # fmt: skip
SCENES = ["hall", "corridor", "open yard"]


def enter_environment(options) -> None:
    """Starts this script again under the environment's interpreter."""
    python = options.venv / "bin" / "python"
    if not python.exists():
        venv.create(options.venv, with_pip=True)
    subprocess.run([python, "-m", "pip", "install", "-q", *PACKAGES], check=True)
    # One core for everybody, whatever threads an engine would like.
    environment = dict(os.environ, OMP_NUM_THREADS="1", TBB_NUM_THREADS="1")
    arguments = [str(python), __file__, "--inside", *sys.argv[1:]]
    sys.exit(subprocess.run(arguments, env=environment).returncode)


def read_scans(path):
    """Scans as the example writes them: (points, beam times from 0 to 1, true pose)."""
    data, offset, scans = path.read_bytes(), 0, []
    while offset < len(data):
        _, first, step, _, x, y, yaw, beams = struct.unpack_from("<q6dI", data, offset)
        offset += struct.calcsize("<q6dI")
        ranges = np.frombuffer(data, "<f4", beams, offset).astype(float)
        offset += 4 * beams
        seen = np.isfinite(ranges)
        angles = (first + step * np.arange(beams))[seen]
        points = np.zeros((seen.sum(), 3))
        points[:, 0] = ranges[seen] * np.cos(angles)
        points[:, 1] = ranges[seen] * np.sin(angles)
        scans.append((points, np.arange(beams)[seen] / (beams - 1), matrix(x, y, yaw)))
    return scans


def matrix(x, y, yaw):
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def errors_over_a_second(poses, truths, lag=10):
    """Root mean square error of the motion: mm along the true one, mm across it, degrees."""
    inverse = np.linalg.inv
    along, across, yaws = [], [], []
    for i in range(lag, len(poses)):
        motion = inverse(poses[i - lag]) @ poses[i]
        true_motion = inverse(truths[i - lag]) @ truths[i]
        error = inverse(true_motion) @ motion
        forward = true_motion[:2, :2].T @ true_motion[:2, 3]
        forward /= max(np.hypot(*forward), 1e-9)
        along.append(forward @ error[:2, 3])
        across.append(forward[0] * error[1, 3] - forward[1] * error[0, 3])
        yaws.append(np.arctan2(error[1, 0], error[0, 0]))
    along, across, yaws = (np.sqrt(np.mean(np.square(part))) for part in (along, across, yaws))
    return 1e3 * along, 1e3 * across, np.degrees(yaws)


def run_fleetcal(path):
    """The poses and times that the example wrote, and the number of scans with an open direction."""
    rows = np.loadtxt(path)
    return [matrix(*row) for row in rows[:, 1:4]], rows[:, 0] * 1e-3, int(rows[:, 4].sum())


def run_small_gicp(scans):
    """Scan to a growing voxel map by VGICP, started from constant velocity; as its example does."""
    import small_gicp

    voxelmap = small_gicp.GaussianVoxelMap(0.5)
    voxelmap.set_lru(horizon=100, clear_cycle=10)
    pose, last_motion, poses, times = np.eye(4), np.eye(4), [], []
    for index, (points, _, _) in enumerate(scans):
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
    return poses, times, None


def run_kiss_icp(scans):
    """KISS-ICP with its own correction of rolling scans."""
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP

    config = KISSConfig()
    config.data.deskew, config.data.max_range, config.data.min_range = True, 40.0, 0.2
    config.mapping.voxel_size = 0.3
    config.registration.max_num_threads = 1
    return register_all(KissICP(config), scans)


def run_genz_icp(scans):
    """GenZ-ICP with its own correction of rolling scans."""
    from genz_icp.config import GenZConfig
    from genz_icp.genz_icp import GenZICP

    config = GenZConfig()
    config.data.deskew, config.data.max_range, config.data.min_range = True, 40.0, 0.2
    config.mapping.voxel_size = 0.3
    config.registration.max_num_threads = 1
    return register_all(GenZICP(config), scans)


def register_all(engine, scans):
    poses, times = [], []
    for points, ticks, _ in scans:
        begin = time.perf_counter()
        engine.register_frame(points, ticks)
        times.append(time.perf_counter() - begin)
        poses.append(np.array(engine.last_pose))
    return poses, times, None


def truths_at_ends(middles):
    """True poses half a scan later, between the middles on both sides."""
    ends = []
    for now, after in zip(middles, middles[1:] + middles[-1:]):
        motion = np.linalg.inv(now) @ after
        yaw = 0.5 * np.arctan2(motion[1, 0], motion[0, 0])
        ends.append(now @ matrix(*half_way(motion[0, 3], motion[1, 3], yaw), yaw))
    return ends


def half_way(x, y, half_yaw):
    """The middle of the arc to (x, y) that turns by twice `half_yaw`."""
    length = np.hypot(x, y) / 2 / max(np.cos(half_yaw / 2), 1e-9)
    heading = np.arctan2(y, x) - half_yaw / 2
    return length * np.cos(heading), length * np.sin(heading)


def compare(folder, scene):
    """Yields (engine, ms, (mm along, mm across, degrees), scans with an open direction or None)."""
    scans = read_scans(folder / f"{scene}.scans")
    middles = [truth for _, _, truth in scans]
    ends = truths_at_ends(middles)
    for engine, run in (
        ("fleetcal", lambda _: run_fleetcal(folder / f"{scene}.poses")),
        ("small_gicp 1.0 (VGICP)", run_small_gicp),
        ("kiss-icp 1.3", run_kiss_icp),
        ("genz-icp 0.3", run_genz_icp),
    ):
        poses, times, reported = run(scans)
        # Engines differ in the time within a scan that a pose is for: the one that is nearer to it counts.
        errors = min(errors_over_a_second(poses, middles), errors_over_a_second(poses, ends))
        yield engine, 1e3 * float(np.median(times)), errors, reported


def figures(scene, engine, ms, errors, reported, count):
    """The results of a row, as a campaign's lines."""
    along_mm, across_mm, degrees = errors
    for figure, value, unit in (
        ("a scan", 1e3 * ms, "µs"),
        ("along, over 1 s", along_mm, "mm"),
        ("across, over 1 s", across_mm, "mm"),
        ("yaw, over 1 s", 1e3 * degrees, "m°"),
    ):
        yield {"table": scene.capitalize(), "row": engine, "figure": figure,
               "value": round(value, 4), "unit": unit, "of": count}  # fmt: skip
    yield {"table": scene.capitalize(), "row": engine, "figure": "open direction reported",
           "count": reported or 0, "of": count}  # fmt: skip


def main(options):
    lines = [{
        "campaign": "lidar_odometry_peers", "title": "LiDAR odometry beside others",
        "commit": options.commit, "date": options.date, "command": "make results-peers",
    }]  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        subprocess.run([*EXAMPLE, str(folder)], cwd=ROOT, check=True)
        count = len(read_scans(folder / f"{SCENES[0]}.scans"))
        print("scene      engine                       ms  mm along  mm across       deg  open direction")
        for scene in SCENES:
            for engine, ms, errors, reported in compare(folder, scene):
                along_mm, across_mm, degrees = errors
                said = "never reported" if reported is None else f"{reported} of {count} scans"
                print(f"{scene:10} {engine:24} {ms:6.3f} {along_mm:9.2f} {across_mm:10.2f} {degrees:9.4f}  {said}")
                lines += figures(scene, engine, ms, errors, reported, count)
    if options.figures:
        options.figures.write_text("".join(json.dumps(line, ensure_ascii=False) + "\n" for line in lines))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--venv", type=pathlib.Path, default=ROOT / "target" / "peers-venv")
    parser.add_argument("--figures", type=pathlib.Path, help="file of the results, JSON lines")
    parser.add_argument("--commit", default="", help="the commit that is measured")
    parser.add_argument("--date", default="", help="the day of the run, as 2026-01-31")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if not options.inside:
        enter_environment(options)
    import numpy as np

    main(options)

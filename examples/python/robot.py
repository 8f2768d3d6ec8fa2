"""A plain Zenoh robot: drives eights in a hall and puts what it measures where fleetcal listens.

pip install eclipse-zenoh; python robot.py [tcp/SERVICE:7447 [ROBOT [SECONDS [SPEEDUP [SAMPLES]]]]]"""

import json
import math
import random
import sys
import time

import zenoh

WHEELBASE_M, SPEED_MPS = 1.2, 1.0
TURN_RAD, TURN_RATE_RADPS = 0.5, 0.5  # how far it steers to both sides, and how fast
STEERING_OFFSET_RAD = 0.03  # what fleetcal is to find: where the steering's zero is,
LIDAR_M, LIDAR_YAW_RAD = (0.4, 0.1), 0.05  # and where the LiDAR sits before the rear axle
HALL_M, BEAMS = ((-9.0, 7.0), (-6.0, 8.0)), 360
CIRCLE_S = 2 * math.pi * WHEELBASE_M / math.tan(TURN_RAD) / SPEED_MPS

def put(publisher, message):
    """Puts a message in JSON; CDR with the encoding application/cdr does as well."""
    publisher.put(json.dumps(message))

def ranges(x, y, yaw):
    """What the LiDAR sees of the walls, metres, with the rear axle at (x, y, yaw)."""
    x += LIDAR_M[0] * math.cos(yaw) - LIDAR_M[1] * math.sin(yaw)
    y += LIDAR_M[0] * math.sin(yaw) + LIDAR_M[1] * math.cos(yaw)
    for beam in range(BEAMS):
        angle = yaw + LIDAR_YAW_RAD - math.pi + beam * 2 * math.pi / BEAMS
        c, s = math.cos(angle) or 1e-12, math.sin(angle) or 1e-12
        wall_m = min((HALL_M[0][c > 0] - x) / c, (HALL_M[1][s > 0] - y) / s)
        yield wall_m + random.gauss(0.0, 0.01)

def drive(drives, scans, seconds, speedup):
    """Drives 100 samples and 10 scans a second, in the robot's own time."""
    began_ns, x, y, yaw, steering = time.time_ns(), 0.0, 0.0, 0.0, 0.0
    step, most = 2 * math.pi / BEAMS, TURN_RATE_RADPS / 100
    scan = {"angle_min": -math.pi, "angle_max": math.pi - step, "angle_increment": step,
            "time_increment": 0.0, "range_min": 0.05, "range_max": 30.0}
    samples = []
    for tick in range(100 * seconds):
        stamp_ns = began_ns + tick * 10**7
        stamp = {"stamp": {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}}
        wanted = TURN_RAD if tick / 100 % (2 * CIRCLE_S) < CIRCLE_S else -TURN_RAD
        steering += max(-most, min(most, wanted - steering))
        turn = SPEED_MPS * math.tan(steering) / WHEELBASE_M * 0.01
        x += SPEED_MPS * 0.01 * math.cos(yaw + turn / 2)
        y += SPEED_MPS * 0.01 * math.sin(yaw + turn / 2)
        yaw += turn
        measured = {"steering_angle": steering + STEERING_OFFSET_RAD + random.gauss(0.0, 0.002),
                    "speed": SPEED_MPS + random.gauss(0.0, 0.005)}
        samples.append({**stamp, **measured})
        if len(samples) == SAMPLES:
            put(drives, {"samples": samples})
            samples = []
        if tick % 10 == 0:
            put(scans, {"header": stamp, **scan, "ranges": list(ranges(x, y, yaw))})
        time.sleep(max(0.0, tick / 100 / speedup - (time.time_ns() - began_ns) / 1e9))

given = dict(enumerate(sys.argv[1:]))
endpoint, robot = given.get(0, "tcp/127.0.0.1:7447"), given.get(1, "tugger_01")
SAMPLES = int(given.get(4, 10))  # drive samples a message, of 100 ms at most
types = {"wheel_odometry": "fleetcal_msgs/msg/DriveSamples", "scan": "sensor_msgs/msg/LaserScan"}
config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [endpoint]}}))
with zenoh.open(config) as session, session.liveliness().declare_token(f"fleet/@alive/{robot}"):
    streams = [session.declare_publisher(f"fleet/{robot}/{stream}", encoding=f"application/json;{of}")
               for stream, of in types.items()]
    drive(*streams, int(given.get(2, 120)), float(given.get(3, 1.0)))

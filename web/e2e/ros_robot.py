"""A robot of rmw_zenoh: what a simulated one sends, as joints, odometry and scans of ROS 2.

python ros_robot.py tcp/SERVICE:PORT ROBOT FLEETCAL: FLEETCAL is the binary that simulates it."""

import json
import signal
import socket
import struct
import subprocess
import sys

import zenoh

service, robot, fleetcal = sys.argv[1:]
HASH = "RIHS01_" + 64 * "0"  # of no matter to who listens
TOPICS = {"joint_states": "sensor_msgs::msg::dds_::JointState_", "odom": "nav_msgs::msg::dds_::Odometry_",
          "front/scan": "sensor_msgs::msg::dds_::LaserScan_", "camera/image": "sensor_msgs::msg::dds_::Image_"}

def cdr(*fields):
    """Little-endian CDR of (code, value) pairs; a code is one of `struct`, or `string`."""
    body = bytearray()
    def put(code, *values):
        for value in values:
            body.extend(bytes(-len(body) % struct.calcsize(code)) + struct.pack("<" + code, value))
    for code, *values in fields:
        if code == "string":
            text = values[0].encode() + b"\0"
            put("I", len(text))
            body.extend(text)
        else:
            put(code, *values)
    return b"\0\1\0\0" + bytes(body)

def open_session(**settings):
    scouting = {"multicast": {"enabled": False}, "gossip": {"enabled": False}}
    return zenoh.open(zenoh.Config.from_json5(json.dumps({"scouting": scouting, **settings})))

def main():
    with socket.create_server(("127.0.0.1", 0)) as free:
        at = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    near = open_session(mode="router", listen={"endpoints": [at]})
    far = open_session(mode="client", connect={"endpoints": [service]})
    tokens = [far.liveliness().declare_token(
        f"@ros2_lv/0/{far.info.zid()}/1/{number}/MP/%/%{robot}/driver/%{robot}%{topic.replace('/', '%')}"
        f"/{of}/{HASH}/::,10:,:,:,,") for number, (topic, of) in enumerate(TOPICS.items(), 2)]
    topics = {topic: far.declare_publisher(f"0/{robot}/{topic}/{of}/{HASH}") for topic, of in TOPICS.items()}

    def take_drive(sample):
        payload = bytes(sample.payload)
        seconds, nanoseconds, frame_bytes = struct.unpack_from("<iII", payload, 4)
        angle_rad, _, speed_mps = struct.unpack_from("<3f", payload, 16 + frame_bytes + -frame_bytes % 4)
        header = ("i", seconds), ("I", nanoseconds), ("string", "base")
        topics["joint_states"].put(cdr(*header, ("I", 2), ("string", "lift"), ("string", "steer"),
                                       ("I", 2), ("d", 0.1, angle_rad), ("I", 0), ("I", 0)))
        topics["odom"].put(cdr(*header, ("string", "base"), ("d", *(7 + 36) * [0.0]),
                               ("d", speed_mps, *(5 + 36) * [0.0])))

    hearing = [near.declare_subscriber("fleet/*/wheel_odometry", take_drive),
               near.declare_subscriber("fleet/*/scan", lambda sample: topics["front/scan"].put(sample.payload))]
    driving = subprocess.Popen([fleetcal, "simulate", "--robots", "1", "--single-samples", "--connect", at],
                               stdout=subprocess.DEVNULL)
    for number in signal.SIGTERM, signal.SIGINT:
        signal.signal(number, lambda *_: driving.terminate())
    driving.wait()
    del hearing, tokens

main()

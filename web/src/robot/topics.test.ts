import { describe, expect, it } from 'vitest';
import {
  firstChoice,
  jointsAsked,
  overDescribed,
  streamsOf,
  suited,
  type Topic,
  withJoints,
} from './topics';

const topic = (name: string, type: string, ...suited_for: Topic['suited_for']): Topic => ({
  topic: name,
  type,
  suited_for,
});
const SCAN = topic('front/scan', 'sensor_msgs/msg/LaserScan', 'scan');
const DRIVE = topic(
  'ackermann',
  'ackermann_msgs/msg/AckermannDriveStamped',
  'wheel_odometry',
  'steering',
);
const JOINTS = topic(
  'joint_states',
  'sensor_msgs/msg/JointState',
  'wheel_odometry',
  'steering',
  'speed',
);
const ODOM = topic('odom', 'nav_msgs/msg/Odometry', 'speed', 'lidar_odometry');
const CAMERA = topic('camera', 'sensor_msgs/msg/Image');

describe('topics', () => {
  it('are offered for what they are suited for, and the plainest is chosen', () => {
    const topics = [CAMERA, DRIVE, ODOM, SCAN];
    expect(suited(topics, 'scan', 'lidar_odometry')).toEqual([ODOM, SCAN]);
    const chosen = firstChoice(topics);
    expect(chosen).toMatchObject({ wheel_odometry: 'ackermann', lidar: 'front/scan' });
    expect(streamsOf(topics, chosen)).toEqual({
      ok: true,
      streams: {
        wheel_odometry: { topic: 'ackermann', type: DRIVE.type },
        scan: { topic: 'front/scan', type: SCAN.type },
      },
    });
  });

  it('that carry joints have them named', () => {
    const topics = [JOINTS, SCAN];
    const chosen = firstChoice(topics);
    expect(jointsAsked(topics, chosen)).toEqual({ steering: true, wheels: true });
    const missing = (more: object) => {
      const picked = streamsOf(topics, { ...chosen, ...more });
      return picked.ok ? '' : picked.field;
    };
    expect(missing({})).toBe('steering_joint');
    expect(missing({ steering_joint: 'steer' })).toBe('wheel_joints');
    expect(missing({ steering_joint: 'steer', wheel_joints: ' , ' })).toBe('wheel_joints');
    const wheels = { steering_joint: 'steer', wheel_joints: 'left, right' };
    expect(missing(wheels)).toBe('wheel_radius');
    expect(missing({ ...wheels, wheel_radius: '15 cm' })).toBe('wheel_radius');
    expect(streamsOf(topics, { ...chosen, ...wheels, wheel_radius: '0,15' })).toMatchObject({
      ok: true,
      streams: { joints: { steering: 'steer', wheels: ['left', 'right'], wheel_radius_m: 0.15 } },
    });
  });

  it('may be two for speed and steering', () => {
    const steering = topic('steer', 'ackermann_msgs/msg/AckermannDriveStamped', 'steering');
    const topics = [steering, ODOM, SCAN];
    const chosen = firstChoice(topics);
    expect(chosen).toMatchObject({ wheel_odometry: '', steering: 'steer', speed: 'odom' });
    expect(streamsOf(topics, chosen)).toMatchObject({
      streams: { steering: { topic: 'steer' }, speed: { topic: 'odom' } },
    });
    expect(streamsOf(topics, { ...chosen, speed: '' })).toMatchObject({
      ok: false,
      field: 'speed',
    });
    expect(streamsOf([steering, ODOM], { ...chosen, lidar: '' })).toMatchObject({ field: 'lidar' });
    // Poses of the LiDAR do instead of scans.
    expect(streamsOf(topics, { ...chosen, lidar: 'odom' })).toMatchObject({
      streams: { lidar_odometry: { topic: 'odom' } },
    });
  });

  it('have the joints that the robot describes, with their gears unless others are typed', () => {
    const topics = [JOINTS, SCAN];
    const joints = {
      steering: 'steer',
      steering_right: 'steer_right',
      steering_gear: -1,
      wheels: ['left', 'right'],
      wheel_radius_m: 0.15,
    };
    const picked = (chosen = firstChoice(topics)) => {
      const of = streamsOf(topics, chosen);
      return of.ok ? overDescribed({ joints }, of.streams).joints : of.field;
    };
    expect(picked()).toBe('steering_joint');
    const filled = withJoints(firstChoice(topics), joints);
    expect(picked(filled)).toEqual(joints);
    const other = { steering: 'lift', wheels: ['left', 'right'], wheel_radius_m: 0.15 };
    expect(picked({ ...filled, steering_joint: 'lift' })).toEqual(other);
    const typed = { ...firstChoice(topics), steering_joint: 'lift' };
    expect(withJoints(typed, joints)).toMatchObject({
      steering_joint: 'lift',
      wheel_radius: '0.15',
    });
    expect(withJoints(typed, null)).toEqual(typed);
  });
});

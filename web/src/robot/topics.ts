/** Announced topics of a robot that carry the data for a calibration. */

import type { AnnouncedTopic, MessageType, RobotConfig } from '../api/types';

/** A topic as announced to the service. */
export type Topic = Pick<AnnouncedTopic, 'topic' | 'type' | 'suited_for'>;
type StreamName = Topic['suited_for'][number];

export interface TopicChoice {
  topic: string;
  type: MessageType;
}

/** Joints of a `JointState` for steering and wheels. */
export interface Joints {
  steering?: string;
  wheels?: string[];
  wheel_radius_m?: number;
}

/** The key `streams` of a robot's configuration. */
export interface Streams {
  wheel_odometry?: TopicChoice;
  steering?: TopicChoice;
  speed?: TopicChoice;
  scan?: TopicChoice;
  lidar_odometry?: TopicChoice;
  joints?: Joints;
}

/** Streams of a configuration that the service proposes. */
type DescribedStreams = NonNullable<RobotConfig['streams']>;

/** Choices and texts of a person, topics by name. */
export interface Chosen {
  /** Topic with both speed and steering; empty if these come on two topics. */
  wheel_odometry: string;
  steering: string;
  speed: string;
  /** Topic of scans, or of poses computed on the robot. */
  lidar: string;
  steering_joint: string;
  /** Names, separated by commas. */
  wheel_joints: string;
  wheel_radius: string;
}

export type Field = keyof Chosen;
export type Picked = { ok: true; streams: Streams } | { ok: false; field: Field; problem: string };

const JOINT_STATE = 'sensor_msgs/msg/JointState';
const RADIUS_MAX_M = 5;

/** Returns the topics suited for one of these streams. */
export function suited(topics: readonly Topic[], ...streams: StreamName[]): Topic[] {
  return topics.filter(({ suited_for }) => streams.some((stream) => suited_for.includes(stream)));
}

/** Returns the initial choice: the only suited topic of a stream, otherwise the first. */
export function firstChoice(topics: readonly Topic[]): Chosen {
  const first = (...streams: StreamName[]) => suited(topics, ...streams)[0]?.topic ?? '';
  const both = first('wheel_odometry');
  return {
    wheel_odometry: both,
    steering: both === '' ? first('steering') : '',
    speed: both === '' ? first('speed') : '',
    lidar: first('scan') || first('lidar_odometry'),
    steering_joint: '',
    wheel_joints: '',
    wheel_radius: '',
  };
}

/** Returns the joints that have to be named: those of steering, and those of the wheels. */
export function jointsAsked(
  topics: readonly Topic[],
  { wheel_odometry, steering, speed }: Chosen,
): { steering: boolean; wheels: boolean } {
  const isJoints = (name: string) =>
    name !== '' && topics.find(({ topic }) => topic === name)?.type === JOINT_STATE;
  return {
    steering: isJoints(wheel_odometry || steering),
    wheels: isJoints(wheel_odometry || speed),
  };
}

/**
 * Returns the topic of a choice. A topic is offered where it is suited, so its type is a known one.
 */
function sourceOf({ topic, type }: Topic): TopicChoice {
  return { topic, type: type as MessageType };
}

/** Returns the chosen streams, or the missing entry. */
export function streamsOf(topics: readonly Topic[], chosen: Chosen): Picked {
  const missing = (field: Field, problem: string): Picked => ({ ok: false, field, problem });
  const named = (name: string): TopicChoice | undefined => {
    const found = topics.find(({ topic }) => topic === name);
    return found && sourceOf(found);
  };
  const streams: Streams = {};
  const both = named(chosen.wheel_odometry);
  const [steering, speed] = [named(chosen.steering), named(chosen.speed)];
  if (both) {
    streams.wheel_odometry = both;
  } else {
    if (!steering) return missing('steering', 'Choose the topic that carries the steering angle.');
    if (!speed) return missing('speed', 'Choose the topic that carries the speed.');
    streams.steering = steering;
    streams.speed = speed;
  }
  const lidar = topics.find(({ topic }) => topic === chosen.lidar);
  if (!lidar) return missing('lidar', 'Choose the topic of the LiDAR.');
  const stream = lidar.suited_for.includes('scan') ? 'scan' : 'lidar_odometry';
  streams[stream] = sourceOf(lidar);

  const asked = jointsAsked(topics, chosen);
  const joints: Joints = {};
  if (asked.steering) {
    joints.steering = chosen.steering_joint.trim();
    if (!joints.steering) return missing('steering_joint', 'Name the joint that steers.');
  }
  if (asked.wheels) {
    joints.wheels = chosen.wheel_joints
      .split(',')
      .map((name) => name.trim())
      .filter(Boolean);
    if (joints.wheels.length === 0) {
      return missing('wheel_joints', 'Name the joint of a wheel, or of both with a comma between.');
    }
    const radius = Number(chosen.wheel_radius.trim().replace(',', '.'));
    if (chosen.wheel_radius.trim() === '' || !(radius > 0 && radius <= RADIUS_MAX_M)) {
      return missing('wheel_radius', `Type the wheels' radius in metres, such as 0.150.`);
    }
    joints.wheel_radius_m = radius;
  }
  if (asked.steering || asked.wheels) streams.joints = joints;
  return { ok: true, streams };
}

/** Returns the entries with the joints that the robot's own description names; what is typed stays. */
export function withJoints(chosen: Chosen, described: DescribedStreams['joints']): Chosen {
  const { steering, wheels, wheel_radius_m } = described ?? {};
  return {
    ...chosen,
    steering_joint: chosen.steering_joint || (steering ?? ''),
    wheel_joints: chosen.wheel_joints || (wheels ?? []).join(', '),
    wheel_radius: chosen.wheel_radius || (wheel_radius_m?.toString() ?? ''),
  };
}

/**
 * Returns the streams of a description with the chosen ones in their place. Joints that are chosen
 * as they are described keep what only the description knows, such as their gears.
 */
export function overDescribed(
  described: DescribedStreams | undefined,
  picked: Streams,
): DescribedStreams {
  const [known, named] = [described?.joints, picked.joints];
  const isSame = (key: keyof Joints) =>
    named?.[key] === undefined || String(named[key]) === String(known?.[key]);
  const all = (['steering', 'wheels', 'wheel_radius_m'] as const).every(isSame);
  return { ...described, ...picked, ...(known && all ? { joints: known } : {}) };
}

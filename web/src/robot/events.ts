/** What can happen to a robot, in words. */

import type { EventKind, ParameterName, RobotEvent } from '../api/types';
import { fixed, unitAfter } from '../units/format';
import { SHOWN } from '../units/parameters';
import type { EventMark } from './plot';

interface EventFace {
  word: string;
  tone: EventMark['tone'];
}

const KINDS: Record<EventKind, EventFace> = {
  calibration_changed: { word: 'Calibration changed', tone: 'bad' },
  calibration_confirmed: { word: 'Calibration confirmed', tone: 'quiet' },
  fault: { word: 'Fault', tone: 'bad' },
  reassembled: { word: 'Reassembled', tone: 'warn' },
  maintenance: { word: 'Maintenance', tone: 'warn' },
  power_on: { word: 'Switched on', tone: 'quiet' },
  session_started: { word: 'New session', tone: 'quiet' },
  service_started: { word: 'Service started', tone: 'quiet' },
  estimator_restarted: { word: 'Estimator restarted', tone: 'bad' },
  estimator_stopped: { word: 'Estimator stopped', tone: 'bad' },
  configured: { word: 'Vehicle given or changed', tone: 'quiet' },
  proposed: { word: 'Proposed', tone: 'quiet' },
  approved: { word: 'Approved', tone: 'quiet' },
  proposal_closed: { word: 'Proposal closed', tone: 'quiet' },
  offered: { word: 'Sent to the robot', tone: 'quiet' },
  applied: { word: 'Applied by the robot', tone: 'warn' },
  not_applied: { word: 'Not applied', tone: 'bad' },
  verified: { word: 'Verified by driving', tone: 'quiet' },
  verification_failed: { word: 'Verification failed', tone: 'bad' },
  inconclusive: { word: 'Not proven: too little motion', tone: 'quiet' },
  rolling_back: { word: 'Going back', tone: 'warn' },
  rolled_back: { word: 'Former values are back', tone: 'warn' },
  rollback_failed: { word: 'Roll-back failed', tone: 'bad' },
};

const CAUSES: Record<string, string> = {
  steering: 'The steering zero moved.',
  lidar_mount: 'The LiDAR moved on the vehicle.',
  vehicle: 'Wheels or wheelbase changed.',
  odometry: 'The LiDAR odometry failed.',
  unknown: 'The data do not tell what it came from.',
};

const SOURCES: Record<string, string> = {
  estimator: 'estimator',
  robot: 'robot',
  service: 'service',
  person: 'person',
};

export function eventFace(kind: string): EventFace {
  return KINDS[kind as EventKind] ?? { word: kind.replaceAll('_', ' '), tone: 'quiet' };
}

/** Who says so. */
export function eventSource({ source, author }: RobotEvent): string {
  return author || (SOURCES[source] ?? source);
}

/** What is known of an event beside its kind: cause, how far each parameter moved, the note. */
export function eventText({ details, note }: RobotEvent): string {
  const parts: string[] = [];
  const cause = details?.cause;
  if (typeof cause === 'string') parts.push(CAUSES[cause] ?? cause);
  const moved = changes(details?.change).map(([name, by]) => {
    const shown = SHOWN[name as ParameterName];
    if (!shown) return `${name} ${by}`;
    const value = fixed(by * shown.factor, shown.decimals);
    return `${shown.label} by ${value}${unitAfter(name as ParameterName)}`;
  });
  if (moved.length > 0) parts.push(`${moved.join(', ')}.`);
  if (note) parts.push(note);
  return parts.join(' ');
}

/** How far each parameter moved, in its wire unit. */
function changes(change: unknown): [name: string, by: number][] {
  if (typeof change !== 'object' || change === null) return [];
  return Object.entries(change).filter((entry): entry is [string, number] => {
    return typeof entry[1] === 'number';
  });
}

/** The marks of events on a chart. */
export function eventMarks(events: readonly RobotEvent[]): EventMark[] {
  return events.map((event) => ({
    t_s: Date.parse(event.time) / 1000,
    tone: eventFace(event.kind).tone,
  }));
}

/** Descriptions of a robot's events. */

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
  calibration_learned: { word: 'Calibration learned', tone: 'quiet' },
  fault: { word: 'Sensor fault', tone: 'bad' },
  reassembled: { word: 'Reassembled', tone: 'ink' },
  maintenance: { word: 'Maintenance', tone: 'ink' },
  power_on: { word: 'Switched on', tone: 'quiet' },
  session_started: { word: 'New session', tone: 'quiet' },
  service_started: { word: 'Service started', tone: 'quiet' },
  estimator_restarted: { word: 'Estimator restarted', tone: 'bad' },
  estimator_stopped: { word: 'Estimator stopped', tone: 'bad' },
  configured: { word: 'Vehicle configured', tone: 'quiet' },
  proposed: { word: 'Proposed', tone: 'quiet' },
  approved: { word: 'Approved', tone: 'quiet' },
  proposal_closed: { word: 'Proposal closed', tone: 'quiet' },
  proposal_refreshed: { word: 'Proposal refreshed', tone: 'quiet' },
  offered: { word: 'Sent to the robot', tone: 'quiet' },
  applied: { word: 'Applied by the robot', tone: 'ink' },
  not_applied: { word: 'Robot did not apply', tone: 'bad' },
  verified: { word: 'Verified', tone: 'quiet' },
  verification_failed: { word: 'Verification failed', tone: 'bad' },
  inconclusive: { word: 'Inconclusive: not enough driving', tone: 'quiet' },
  rolling_back: { word: 'Rolling back', tone: 'ink' },
  rolled_back: { word: 'Rolled back', tone: 'ink' },
  rollback_failed: { word: 'Rollback failed', tone: 'bad' },
};

const CAUSES: Record<string, string> = {
  steering: 'The steering zero moved.',
  lidar_mount: 'The LiDAR moved on the vehicle.',
  vehicle: 'Wheels or wheelbase changed.',
  odometry: 'The LiDAR odometry failed.',
  unknown: 'The data do not tell what it came from.',
};

/** Causes of a fault, which leaves the calibration unchanged. */
const FAULT_CAUSES: Record<string, string> = {
  steering: 'The steering reading stands still while the robot turns.',
  vehicle:
    'The LiDAR moved and the wheels did not: the robot was pushed, towed or lifted, or the speed reading failed.',
  odometry: 'The LiDAR sees too little to know how far the robot has come.',
  unknown: 'Wheels and LiDAR disagree, and the data do not tell why.',
};

/** Findings of events without a cause, since nothing moved. */
const FOUND: Partial<Record<EventKind, string>> = {
  calibration_confirmed: 'It agrees with the calibration of before.',
  calibration_learned: 'There was none before to compare it with.',
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

/** Returns the source of an event. */
export function eventSource({ source, author }: RobotEvent): string {
  return author || (SOURCES[source] ?? source);
}

/** Returns the details of an event: cause, change of each parameter, the note. */
export function eventText({ kind, details, note }: RobotEvent): string {
  const parts: string[] = [];
  const cause = details?.cause;
  const causes = kind === 'fault' ? FAULT_CAUSES : CAUSES;
  const said = FOUND[kind];
  if (said) parts.push(said);
  else if (typeof cause === 'string') parts.push(causes[cause] ?? cause);
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

/** Returns the change of each parameter, in its wire unit. */
function changes(change: unknown): [name: string, by: number][] {
  if (typeof change !== 'object' || change === null) return [];
  return Object.entries(change).filter((entry): entry is [string, number] => {
    return typeof entry[1] === 'number';
  });
}

/** Returns the marks of events on a chart. */
export function eventMarks(events: readonly RobotEvent[]): EventMark[] {
  return events.map((event) => {
    const { word, tone } = eventFace(event.kind);
    return { t_s: Date.parse(event.time) / 1000, tone, word, text: eventText(event) };
  });
}

/** Returns the names of events within `near_s` of a time, each once, oldest first. */
export function wordsAt(marks: readonly EventMark[], t_s: number, near_s: number): string[] {
  const near = marks.filter((mark) => Math.abs(mark.t_s - t_s) <= near_s);
  return [...new Set(near.toSorted((a, b) => a.t_s - b.t_s).map(({ word }) => word))];
}

/** True if both are the same event: one of the stream has no number, and may be completed later. */
export function isSame(a: RobotEvent, b: RobotEvent): boolean {
  return (
    a.kind === b.kind &&
    a.source === b.source &&
    Date.parse(a.time) === Date.parse(b.time) &&
    (a.source === 'estimator' || (a.note ?? '') === (b.note ?? ''))
  );
}

/**
 * Merges the events of a list, the newest first, with those received: one from the stream may have
 * no row yet, or more details than its row had when that was read.
 */
export function joined(list: readonly RobotEvent[], heard: readonly RobotEvent[]): RobotEvent[] {
  const rest = [...heard];
  const known = list.map((one) => {
    const at = rest.findIndex((other) => isSame(one, other));
    const [said] = at < 0 ? [] : rest.splice(at, 1);
    // One of the stream has no number: that of the row stays.
    return { ...one, ...said };
  });
  return [...rest, ...known];
}

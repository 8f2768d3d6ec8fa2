/** Detectable changes of a robot, in the words of its page. */

import type { Detection, DetectionState } from '../api/types';

const CAUSES = {
  steering: 'steering',
  lidar_mount: 'LiDAR mount',
  vehicle: 'wheels',
} as const satisfies Record<keyof Detection, string>;

/** Texts for the detection of one cause, after the words "watched for changes". */
const STATES: Record<DetectionState, string> = {
  watching: 'yes',
  first_estimate: 'not before the first estimate of this session',
  accuracy: 'not yet, the estimate is not accurate enough',
  scatter: 'no, the errors of this robot vary as much as a change would',
  motion: 'not yet, the robot has driven or turned too little',
  fault: 'not while a fault lasts',
};

/** Describes the detection in the order of the causes; in one text if it is the same for all. */
export function detectionText(detection: Detection): string {
  const groups = new Map<DetectionState, string[]>();
  for (const cause of Object.keys(CAUSES) as (keyof Detection)[]) {
    const state = detection[cause];
    groups.set(state, [...(groups.get(state) ?? []), CAUSES[cause]]);
  }
  const parts = [...groups].map(([state, causes]) =>
    groups.size === 1 ? STATES[state] : `${causes.join(', ')}: ${STATES[state]}`,
  );
  return parts.join('; ');
}

/** True if a change of every cause would be detected. */
export function isWatchingAll(detection: Detection): boolean {
  return Object.values(detection).every((state) => state === 'watching');
}

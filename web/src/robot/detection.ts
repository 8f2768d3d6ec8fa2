/** Which changes of a robot would be noticed now, in the words of its page. */

import type { Detection, DetectionState } from '../api/types';

const CAUSES = {
  steering: 'steering',
  lidar_mount: 'LiDAR mount',
  vehicle: 'wheels',
} as const satisfies Record<keyof Detection, string>;

/** Whether a change of one cause would be detected, after the words "watched for changes". */
const STATES: Record<DetectionState, string> = {
  watching: 'yes',
  first_estimate: 'not before the first estimate of this session',
  accuracy: 'not yet, the estimate is not accurate enough',
  scatter: 'no, the errors of this robot vary as much as a change would',
  motion: 'not yet, the robot has driven or turned too little',
  fault: 'not while a fault lasts',
};

/** What is watched, in the order of the causes; one answer where it is the same for all. */
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

/** Whether a change of every cause would be noticed. */
export function isWatchingAll(detection: Detection): boolean {
  return Object.values(detection).every((state) => state === 'watching');
}

/** Report of a person that parts of a robot were removed and mounted again. */

import { post } from '../api/client';
import type { NewEvent, RobotEvent } from '../api/types';
import { robotUrl } from '../fleet/fleet.svelte';

/** Largest length of a report's note. */
export const NOTE_MAX = 1000;

/** Returns a new key of a report: one that is sent twice with the same key counts once. */
export function reportKey(): string {
  const bytes = crypto.getRandomValues(new Uint8Array(16));
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, '0')).join('');
}

/** Reports that a robot was reassembled; throws a `Refusal` with the reason in a sentence. */
export async function reportReassembly(robot: string, note: string, key: string): Promise<void> {
  const event: NewEvent = { kind: 'reassembled', note: note.trim() };
  await post<RobotEvent>(`${robotUrl(robot)}/events`, event, key);
}

/** The policy in the form: texts that people type. */

import type { Policy, Tolerance } from '../api/types';

export const TOLERANCES = [
  'propose_beyond',
  'verify_within',
  'two_approvers_beyond',
  'approve_within',
] as const;
export type ToleranceKey = (typeof TOLERANCES)[number];

export const PARTS = [
  ['steering_offset_deg', 'Steering', '°'],
  ['lidar_yaw_deg', 'LiDAR yaw', '°'],
  ['lidar_position_mm', 'LiDAR x, y', 'mm'],
] as const satisfies readonly (readonly [keyof Tolerance, string, string])[];

/** The numbers beside the tolerances: key, words, unit. */
export const NUMBERS = [
  ['propose_sigmas', 'Minimum significance', 'sigma'],
  ['stable_for_s', 'Stable for at least', 's'],
  ['expires_after_s', 'A proposal expires after', 's'],
  ['confirm_within_s', 'Revert if unconfirmed after', 's'],
  ['offer_valid_s', 'An offer to a robot ends after', 's'],
  ['verify_after_m', 'Verified after driving', 'm'],
  ['verify_within_s', 'Give up verification after', 's'],
  ['steering_offset_max_deg', 'Largest plausible steering offset', '°'],
  ['lidar_distance_max_m', 'Largest plausible LiDAR distance', 'm'],
] as const satisfies readonly (readonly [keyof Policy, string, string])[];

/** Key under which unsaved edits are kept. */
export const DRAFT = 'policy';

/** Editable texts, by `key` or `key.part`, and checkboxes. */
export interface Draft {
  typed: Record<string, string>;
  propose: boolean;
  roll_back: boolean;
}

export type Read = { ok: true; policy: Policy } | { ok: false; field: string; problem: string };

/** Converts the policy to texts. */
export function draftOf(policy: Policy): Draft {
  const typed: Record<string, string> = {};
  for (const key of TOLERANCES) {
    for (const [part] of PARTS) typed[`${key}.${part}`] = String(policy[key]?.[part] ?? '');
  }
  for (const [key] of NUMBERS) typed[key] = String(policy[key]);
  return { typed, propose: policy.propose, roll_back: policy.roll_back };
}

/**
 * Converts the texts to a policy, or returns the first that is not a number. The service checks the
 * limits.
 */
export function policyOf({ typed, propose, roll_back }: Draft): Read {
  let wrong: { field: string; problem: string } | undefined;
  const number = (field: string): number => {
    const text = (typed[field] ?? '').trim().replace(',', '.');
    const value = Number(text);
    if (text === '' || !Number.isFinite(value)) {
      wrong ??= { field, problem: `"${typed[field] ?? ''}" is not a number.` };
    }
    return value;
  };
  const tolerance = (key: ToleranceKey): Tolerance => ({
    steering_offset_deg: number(`${key}.steering_offset_deg`),
    lidar_yaw_deg: number(`${key}.lidar_yaw_deg`),
    lidar_position_mm: number(`${key}.lidar_position_mm`),
  });
  const never = PARTS.every(([part]) => (typed[`approve_within.${part}`] ?? '').trim() === '');
  const policy: Policy = {
    propose,
    propose_beyond: tolerance('propose_beyond'),
    verify_within: tolerance('verify_within'),
    two_approvers_beyond: tolerance('two_approvers_beyond'),
    approve_within: never ? null : tolerance('approve_within'),
    propose_sigmas: number('propose_sigmas'),
    stable_for_s: number('stable_for_s'),
    expires_after_s: number('expires_after_s'),
    confirm_within_s: number('confirm_within_s'),
    offer_valid_s: number('offer_valid_s'),
    verify_after_m: number('verify_after_m'),
    verify_within_s: number('verify_within_s'),
    steering_offset_max_deg: number('steering_offset_max_deg'),
    lidar_distance_max_m: number('lidar_distance_max_m'),
    roll_back,
  };
  return wrong ? { ok: false, ...wrong } : { ok: true, policy };
}

import { describe, expect, it } from 'vitest';
import type { Policy } from '../api/types';
import { draftOf, policyOf } from './policy';

const tolerance = (deg: number, mm: number) => ({
  steering_offset_deg: deg,
  lidar_yaw_deg: deg,
  lidar_position_mm: mm,
});
const POLICY: Policy = {
  approve_within: null,
  propose: true,
  propose_beyond: tolerance(0.15, 10),
  propose_sigmas: 3,
  stable_for_s: 10,
  two_approvers_beyond: tolerance(5, 50),
  steering_offset_max_deg: 15,
  lidar_distance_max_m: 30,
  expires_after_s: 86_400,
  confirm_within_s: 600,
  offer_valid_s: 86_400,
  verify_within: tolerance(0.15, 10),
  verify_after_m: 60,
  verify_within_s: 86_400,
  roll_back: true,
};

describe('the policy in a form', () => {
  it('comes out as it went in', () => {
    expect(policyOf(draftOf(POLICY))).toEqual({ ok: true, policy: POLICY });
    const automatic = { ...POLICY, approve_within: tolerance(0.2, 5) };
    expect(policyOf(draftOf(automatic))).toEqual({ ok: true, policy: automatic });
  });

  it('takes what people type, a decimal comma too', () => {
    const draft = draftOf(POLICY);
    draft.typed['propose_beyond.lidar_yaw_deg'] = ' 0,3 ';
    draft.roll_back = false;
    const read = policyOf(draft);
    expect(read.ok && read.policy.propose_beyond.lidar_yaw_deg).toBe(0.3);
    expect(read.ok && read.policy.roll_back).toBe(false);
  });

  it('names the first field that is no number; a half-filled tolerance is one', () => {
    const draft = draftOf(POLICY);
    draft.typed['approve_within.lidar_yaw_deg'] = '0.1';
    expect(policyOf(draft)).toMatchObject({
      ok: false,
      field: 'approve_within.steering_offset_deg',
    });
    draft.typed['verify_within.lidar_position_mm'] = 'ten';
    expect(policyOf(draft)).toMatchObject({ field: 'verify_within.lidar_position_mm' });
  });
});

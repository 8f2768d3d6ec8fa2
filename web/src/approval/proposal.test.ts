import { describe, expect, it } from 'vitest';
import type { Proposal, Robot } from '../api/types';
import {
  approvalsNeeded,
  decidedOf,
  evidenceOf,
  largestOf,
  lastDone,
  stillChosen,
  whyNotMine,
  withoutBase,
} from './proposal';
import { presentOf } from './present';

const proposal = (given: Partial<Proposal>): Proposal =>
  ({
    id: 1,
    version: 1,
    proposed_by: 'fleetcal',
    approvals: [],
    revision: { origin: 'estimator', evidence: null },
    ...given,
  }) as Proposal;

describe('a proposal', () => {
  it('is not approved by its proposer, nor twice by the same person', () => {
    expect(whyNotMine(proposal({}), 'ada')).toBe('');
    expect(whyNotMine(proposal({ proposed_by: 'ada' }), 'ada')).toContain('somebody else');
    const agreed = proposal({ approvals: [{ by: 'ada', at: '2026-01-01T00:00:00Z' }] });
    expect(whyNotMine(agreed, 'ada')).toContain('You approved');
    expect(whyNotMine(agreed, 'bob')).toBe('');
  });

  it('says what it rests on', () => {
    const evidence = {
      from: '2026-01-01T00:00:00Z',
      to: '2026-01-01T00:02:00Z',
      distance_m: 120.4,
    };
    const revision = { origin: 'estimator', evidence } as Proposal['revision'];
    expect(evidenceOf(proposal({ revision }))).toBe('120 m in 2 min');
    expect(evidenceOf(proposal({}))).toBe('none');
  });

  it('drops out of what was chosen when it changes', () => {
    const chosen = new Map([
      [1, 1],
      [2, 1],
    ]);
    const waiting = [proposal({ id: 1, version: 2 }), proposal({ id: 2 }), proposal({ id: 3 })];
    expect(stillChosen(waiting, chosen).map(({ id }) => id)).toEqual([2]);
  });
});

const at = (minute: number) => `2026-01-01T00:${String(minute).padStart(2, '0')}:00Z`;
const values = (steering_offset_rad: number, lidar_x_m = 1) => ({
  steering_offset_rad,
  lidar_x_m,
  lidar_y_m: 0,
  lidar_yaw_rad: 0,
});
const revision = (to: ReturnType<typeof values>, sigma = 0.001) =>
  ({
    values: to,
    sigmas: values(sigma, sigma),
    evidence: { distance_m: 34 },
  }) as Proposal['revision'];

describe('a decision', () => {
  it('is told as what was done last', () => {
    const half = proposal({
      state: 'proposed',
      approvals_needed: 2,
      approvals: [{ by: 'ada', at: at(1) }],
    });
    expect(lastDone(half)).toBe('awaiting approval, with 1 of 2 approvals, the last by ada');
    expect(lastDone({ ...half, approvals: [] })).toBe('awaiting approval');
    expect(lastDone({ ...half, state: 'approved' })).toBe('approved by ada');
    const closing = { by: 'bob', at: at(2), reason: 'loose' };
    expect(lastDone({ ...half, state: 'rejected', closing })).toBe('rejected by bob');
  });

  it('stands in the list by when it was made', () => {
    const decided = decidedOf([
      proposal({ id: 3, state: 'rejected', closing: { by: 'ada', at: at(18) } }),
      proposal({ id: 2, state: 'approved', approvals: [{ by: 'ada', at: at(27) }] }),
      proposal({ id: 1, state: 'proposed' }),
    ]);
    expect(decided.map(({ id }) => id)).toEqual([2, 3]);
  });

  it('needs as many people as the policy in force says', () => {
    const two = { steering_offset_deg: 1, lidar_yaw_deg: 1, lidar_position_mm: 50 };
    const large = proposal({
      approvals_needed: 1,
      base: values(0),
      revision: revision(values(0.03)),
    });
    expect(approvalsNeeded(large, null, undefined)).toBe(1);
    expect(approvalsNeeded(large, null, two)).toBe(2);
    expect(approvalsNeeded(large, values(0.029), two)).toBe(1);
    expect(approvalsNeeded({ ...large, approvals_needed: 2 }, values(0.029), two)).toBe(2);
  });
});

describe('several proposals', () => {
  it('are summed up by the largest change of each value', () => {
    const of = (robot: string, offset: number, x: number) =>
      proposal({ robot, base: values(0), revision: revision(values(offset, x)) });
    const largest = largestOf([of('a', 0.01, 1.02), of('b', -0.03, 1.001)]);
    expect(largest.map(({ name, robot }) => [name, robot]).slice(0, 2)).toEqual([
      ['steering_offset', 'b'],
      ['lidar_x', 'a'],
    ]);
    expect(largest[0]?.change).toBeCloseTo(-0.03);
  });

  it('name those of which nobody knows how much they change', () => {
    const of = (robot: string, base: ReturnType<typeof values> | null) =>
      proposal({ robot, base, revision: revision(values(0.01)) });
    const both = [of('a', null), of('b', values(0))];
    expect(withoutBase(both).map(({ robot }) => robot)).toEqual(['a']);
    expect(largestOf([of('a', null)])).toEqual([]);
  });
});

describe('the present estimate', () => {
  const robot = (offset: number, reassembly_open = false): Robot => {
    const parameter = (value: number) => ({ value, sigma: 0.0002 });
    return {
      state: 'calibrated',
      calibration: { in_use: null },
      estimate: {
        reassembly_open,
        parameters: {
          steering_offset: parameter(offset),
          lidar_x: parameter(1),
          lidar_y: parameter(0),
          lidar_yaw: parameter(0),
        },
      },
    } as Robot;
  };
  const proposed = proposal({ revision: revision(values(0.03)) });

  it('says whether what is proposed still holds, and by how many sigmas', () => {
    const still = presentOf(proposed, robot(0.0304));
    expect(still).toMatchObject({ holds: true });
    expect(still?.sigmas).toBeCloseTo(0.4);
    // By the word of the service alone: it knows more than the four values.
    const outdated = { ...proposed, outdated: 'the present estimate differs from the proposal' };
    expect(presentOf(outdated, robot(0.0342))).toMatchObject({ holds: false });
    expect(presentOf(proposed, robot(0.0342))).toMatchObject({ holds: true });
    expect(presentOf(outdated, robot(0.0304))).toMatchObject({ holds: false });
  });

  it('holds nothing against an estimate that is not known', () => {
    expect(presentOf(proposed, robot(0.03, true))).toMatchObject({
      holds: null,
      reassembled: true,
    });
    const learning = { ...robot(0.0342), state: 'learning' as const };
    expect(presentOf(proposed, learning)).toMatchObject({ holds: null, reassembled: false });
  });

  it('says nothing of values that nobody measured, or without an estimate', () => {
    const typed = proposal({ revision: { ...revision(values(0.03)), evidence: null } });
    expect(presentOf(typed, robot(0.03))).toBeUndefined();
    expect(presentOf(proposed, undefined)).toBeUndefined();
  });
});

import { describe, expect, it } from 'vitest';
import type { Deployment, DeploymentState, Robot } from '../api/types';
import { progressText, stepsOf, verifying } from './progress';

const deployment = (state: DeploymentState, given: Partial<Deployment> = {}): Deployment =>
  ({
    state,
    proposal: 3,
    created: '2026-01-01T00:00:00Z',
    offered: '2026-01-01T00:00:01Z',
    applied: '2026-01-01T00:00:02Z',
    closed: null,
    verification: null,
    ...given,
  }) as Deployment;

const driven = { driven_m: 37.4, needed_m: 60 };
const told = (one: Deployment) => stepsOf(one, driven).map(({ word, state }) => [word, state]);

describe('a decision on its way', () => {
  it('is followed from the approval to the verification', () => {
    expect(told(deployment('queued'))).toEqual([
      ['Approved', 'done'],
      ['Send', 'now'],
      ['Apply', 'ahead'],
      ['Verify', 'ahead'],
    ]);
    expect(told(deployment('offered'))[2]).toEqual(['Apply', 'now']);
    expect(told(deployment('verifying'))).toEqual([
      ['Approved', 'done'],
      ['Sent', 'done'],
      ['Applied', 'done'],
      ['Verifying, 37 of 60 m', 'now'],
    ]);
  });

  it('stays readable when it has ended', () => {
    const verification = { distance_m: 61.2 } as NonNullable<Deployment['verification']>;
    const closed = '2026-01-01T00:01:00Z';
    const verified = stepsOf(deployment('verified', { verification, closed }), driven);
    expect(verified.at(-1)).toEqual({ word: 'Verified over 61 m', state: 'done', at: closed });
    expect(told(deployment('refused'))).toEqual([
      ['Approved', 'done'],
      ['Sent', 'done'],
      ['Refused by the robot', 'failed'],
    ]);
    expect(told(deployment('rolled_back', { proposal: null })).at(0)).toEqual([
      'Requested',
      'done',
    ]);
    expect(told(deployment('rolling_back')).at(-1)).toEqual(['Rolling back', 'now']);
  });

  it('says when the way is driven and the estimate cannot tell yet', () => {
    expect(verifying({ driven_m: 59.9, needed_m: 60 })).toBe('Verifying, 59 of 60 m');
    expect(verifying({ driven_m: 84, needed_m: 60 })).toBe(
      'Verifying, 84 m driven, not yet certain',
    );
    expect(verifying({ driven_m: null, needed_m: 60 })).toBe('Verifying');
  });

  it('stands in the list in a few words', () => {
    const robot = (state: DeploymentState | null) =>
      ({ verification_distance_m: 12, calibration: { deployment: state } }) as Robot;
    expect(progressText(robot('verifying'), 60)).toBe('Verifying, 12 of 60 m');
    expect(progressText(robot('queued'), 60)).toBe('Queued for sending');
    expect(progressText(robot('verified'), 60)).toBe('');
    expect(progressText(robot(null), 60)).toBe('');
  });
});

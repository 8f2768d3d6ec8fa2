import { describe, expect, it } from 'vitest';
import type { Deployment, InUse, Shadow } from '../api/types';
import { returned } from './rollback';

const use = (generation: number, revision: number | null): InUse => ({
  generation,
  revision,
  since: `2026-01-0${generation + 1}T00:00:00Z`,
  values: { steering_offset_rad: generation / 100, lidar_x_m: 1, lidar_y_m: 0, lidar_yaw_rad: 0 },
});
const ref = (generation: number, revision: number) => ({ generation, revision, sha256: '' });
const deployment = (generation: number, given: Partial<Deployment> = {}): Deployment =>
  ({
    offer: ref(generation, generation + 10),
    state: 'verified',
    closed: `2026-02-0${generation}T00:00:00Z`,
    applied: `2026-01-0${generation + 1}T00:00:00Z`,
    proposal: generation,
    base: null,
    ...given,
  }) as Deployment;
const shadow = (given: Partial<Shadow>): Shadow => ({ verified: [], ...given }) as Shadow;

describe('what a rollback brings back', () => {
  it('is what the robot used before the deployment that is under way', () => {
    const live = deployment(2, { state: 'verifying', closed: null, base: use(1, 11) });
    const found = returned(shadow({ deployment: live, in_use: use(2, 12) }), [live, deployment(1)]);
    expect(found).toMatchObject({ generation: 1, verified: '2026-02-01T00:00:00Z' });
    expect(found?.values?.steering_offset_rad).toBe(0.01);
  });

  it('is the last verified calibration that is not in use, else the one before', () => {
    const records = shadow({
      in_use: use(3, 13),
      before: use(2, 12),
      verified: [ref(1, 11), ref(3, 13)],
    });
    const deployments = [deployment(3), deployment(2, { state: 'inconclusive' }), deployment(1)];
    // Its values stand in the proposal that it was approved by.
    expect(returned(records, deployments)).toMatchObject({
      generation: 1,
      values: null,
      proposal: 1,
      verified: '2026-02-01T00:00:00Z',
    });
    expect(returned({ ...records, verified: [ref(3, 13)] }, deployments)).toMatchObject({
      generation: 2,
      verified: null,
    });
  });

  it('says that factory values were never verified', () => {
    const records = shadow({ in_use: use(1, 11), before: use(0, null), verified: [ref(1, 11)] });
    expect(returned(records, [deployment(1)])).toMatchObject({
      generation: 0,
      since: null,
      verified: null,
    });
  });

  it('is nothing where nothing was used before', () => {
    expect(returned(shadow({ in_use: use(1, 11) }), [])).toBeNull();
  });
});

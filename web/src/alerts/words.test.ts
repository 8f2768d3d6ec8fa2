import { describe, expect, it } from 'vitest';
import type { Robot } from '../api/types';
import { STANDINGS } from '../fleet/standing';
import { KINDS, kindFace, STATES } from './words';

describe('the words of alerts', () => {
  it('never name a kind and a state alike', () => {
    const kinds = Object.values(KINDS).map(({ word }) => word);
    for (const { word } of Object.values(STATES)) expect(kinds).not.toContain(word);
  });

  it('name a robot as the fleet does', () => {
    const robot = (reported_generation: number | null) =>
      ({ calibration: { reported_generation } }) as Robot;
    expect(kindFace({ kind: 'drift' }, robot(0))).toBe(STANDINGS.uncalibrated);
    expect(kindFace({ kind: 'drift' }, robot(2))).toBe(STANDINGS.drift);
    expect(kindFace({ kind: 'no_data' }, undefined)).toBe(STANDINGS.no_data);
  });
});

import { describe, expect, it } from 'vitest';
import type { Robot } from '../api/types';
import { STANDINGS } from '../fleet/standing';
import { KINDS, kindFace, STATES, subjectOf } from './words';

describe('the words of alerts', () => {
  it('never name a kind and a state alike', () => {
    const kinds = Object.values(KINDS).map(({ word }) => word);
    for (const { word } of Object.values(STATES)) expect(kinds).not.toContain(word);
  });

  it('give each kind a shape of its own', () => {
    const shapes = Object.values(KINDS).map(({ shape }) => shape);
    expect(new Set(shapes).size).toBe(shapes.length);
  });

  it('say whose an alert is', () => {
    expect(subjectOf({ robot: 'agv_1', robots: [] })).toBe('agv_1');
    expect(subjectOf({ robot: null, robots: ['a', 'b'] })).toBe('2 robots');
    expect(subjectOf({ robot: null, robots: ['a'] })).toBe('1 robot');
    expect(subjectOf({ robot: null, robots: [] })).toBe('Instances of the service');
  });

  it('name a robot as the fleet does', () => {
    const robot = (reported_generation: number | null) =>
      ({ calibration: { reported_generation } }) as Robot;
    expect(kindFace({ kind: 'drift' }, robot(0))).toBe(STANDINGS.uncalibrated);
    expect(kindFace({ kind: 'drift' }, robot(2))).toBe(STANDINGS.drift);
    expect(kindFace({ kind: 'no_data' }, undefined)).toBe(STANDINGS.no_data);
  });
});

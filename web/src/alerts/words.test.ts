import { describe, expect, it } from 'vitest';
import type { Standing } from '../api/types';
import { CONNECTIONS } from '../fleet/connection';
import { STANDINGS } from '../fleet/standing';
import { KINDS, STATES, subjectOf } from './words';

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
    expect(subjectOf({ robot: null, robots: [] })).toBe('Service');
  });

  it('name a robot as the fleet does, whatever became of it since', () => {
    const kinds = Object.entries(KINDS).filter(([kind]) => kind in STANDINGS);
    expect(kinds.length).toBeGreaterThan(10);
    // Silence is a matter of the connection.
    const faces = { ...STANDINGS, no_data: CONNECTIONS.silent };
    for (const [kind, face] of kinds) expect(face).toBe(faces[kind as Standing]);
    expect(KINDS.uncalibrated.word).not.toBe(KINDS.drift.word);
  });
});

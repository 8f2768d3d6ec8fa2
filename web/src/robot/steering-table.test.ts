import { describe, expect, it } from 'vitest';
import type { SteeringTable } from '../api/types';
import { correctionsOf, draw, steeringCsv } from './steering-table';

const rad = (deg: number) => (deg * Math.PI) / 180;
const table: SteeringTable = {
  status: 'informative',
  points: [
    { measured_rad: rad(-20), true_rad: rad(-19.5), sigma_rad: rad(0.1) },
    { measured_rad: 0, true_rad: 0, sigma_rad: rad(0.02) },
    { measured_rad: rad(20), true_rad: rad(19), sigma_rad: rad(0.2) },
  ],
};

describe('a steering table', () => {
  it('is a correction of each measured angle, in degrees', () => {
    const [right, zero, left] = correctionsOf(table);
    expect(right?.measured_deg).toBeCloseTo(-20);
    expect(right?.correction_deg).toBeCloseTo(0.5);
    expect(zero?.correction_deg).toBeCloseTo(0);
    expect(left?.correction_deg).toBeCloseTo(-1);
    expect(left?.sigma_deg).toBeCloseTo(0.2);
  });

  it('is drawn with left steering on the left and zero in the middle', () => {
    const { dots, zero_y, most_deg, band } = draw(correctionsOf(table), 200, 100);
    expect(zero_y).toBe(50);
    expect(most_deg).toBeCloseTo(1.4);
    expect(dots.map(([x]) => Math.round(x))).toEqual([200, 100, 0]);
    expect(dots[0]?.[1]).toBeLessThan(50);
    expect(dots[2]?.[1]).toBeGreaterThan(50);
    expect(band).toMatch(/^M.*Z$/);
  });

  it('of one point or none is drawn without a number that is none', () => {
    for (const points of [[], table.points.slice(0, 1)]) {
      const { line, band, most_deg } = draw(correctionsOf({ ...table, points }), 200, 100);
      expect(`${line}${band}${most_deg}`).not.toMatch(/NaN|Infinity/);
    }
  });

  it('is a file in SI units, with its status', () => {
    const needs = 'turns to\nthe right';
    const [status, head, first] = steeringCsv({ ...table, needs }).split('\n');
    expect(status).toBe('# Status: informative. Missing: turns to the right.');
    expect(steeringCsv(table)).toMatch(/^# Status: informative\.\n/);
    expect(head).toBe('measured_rad,true_rad,sigma_rad');
    expect(first).toBe('-0.34906585,-0.34033920,0.00174533');
  });
});

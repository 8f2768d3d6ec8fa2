import { describe, expect, it } from 'vitest';
import type { Parameter, Robot } from '../api/types';
import type { Manoeuvre } from './guide';
import { leftOf, metresFor, shareOf } from './left';

const parameter = (sigma: number, status: Parameter['status']): Parameter => ({
  value: 0,
  sigma,
  unit: 'm',
  status,
  needs: status === 'learning' ? 'a turn' : null,
});

describe('a bar', () => {
  it('is full for what the service calls known, and for nothing else', () => {
    expect(shareOf(parameter(0.01, 'learning'), 0.005)).toBe(0.5);
    expect(shareOf(parameter(0.006, 'converged'), 0.005)).toBe(1);
    expect(shareOf(parameter(0.001, 'learning'), 0.005)).toBeLessThan(1);
    expect(shareOf(parameter(0, 'unobservable'), 0.005)).toBe(0);
  });
});

describe('the way left', () => {
  it('grows with the information that is missing', () => {
    // A manoeuvre of 10 m halves the sigma: it brings three times the information there was.
    expect(metresFor(0.02, 0.01, 0.01, 10)).toBeCloseTo(10);
    // Twice as much again costs five of it.
    expect(metresFor(0.02, 0.005, 0.01, 10)).toBeCloseTo(50);
    expect(metresFor(0.004, 0.005, 0.003, 10)).toBe(0);
    expect(metresFor(0.02, 0.005, 0.02, 10)).toBeNull();
  });

  const limits = { steering_offset: 0.001, lidar_x: 0.005, lidar_y: 0.005, lidar_yaw: 0.002 };
  const manoeuvre = (distance_m: number, duration_s: number, x: number, y: number) =>
    ({
      instruction: 'a turn',
      distance_m,
      duration_s,
      sigma_after: { steering_offset: 0.0005, lidar_x: x, lidar_y: y, lidar_yaw: 0.001 },
    }) as Manoeuvre;
  const robot = (x: Parameter, y: Parameter) =>
    ({
      estimate: {
        parameters: {
          steering_offset: parameter(0.0005, 'converged'),
          lidar_x: x,
          lidar_y: y,
          lidar_yaw: parameter(0.001, 'fixed'),
        },
      },
    }) as unknown as Robot;

  it('is the longest of the ways by the best manoeuvre for each value', () => {
    const items = [manoeuvre(10, 12, 0.005, 0.01), manoeuvre(20, 30, 0.01, 0.005)];
    const both = robot(parameter(0.01, 'learning'), parameter(0.01, 'learning'));
    const left = leftOf(both, items, limits);
    expect(left?.distance_m).toBeCloseTo(20);
    expect(left?.duration_s).toBeCloseTo(30);
    const one = robot(parameter(0.01, 'learning'), parameter(0.002, 'converged'));
    expect(leftOf(one, items, limits)?.distance_m).toBeCloseTo(10);
    expect(left?.isLeast).toBe(false);
  });

  it('is a least where a value needs something else than a manoeuvre', () => {
    const items = [manoeuvre(10, 12, 0.005, 0.005)];
    const other = { ...parameter(0.02, 'learning'), needs: 'more driving' };
    const left = leftOf(robot(parameter(0.01, 'learning'), other), items, limits);
    expect(left).toMatchObject({ isLeast: true, distance_m: expect.closeTo(10) });
    expect(leftOf(robot(parameter(0.001, 'converged'), other), items, limits)).toBeNull();
  });

  it('is not known where no manoeuvre leads there or no sigma tells', () => {
    const items = [manoeuvre(10, 12, 0.005, 0.01)];
    const both = robot(parameter(0.01, 'learning'), parameter(0.01, 'learning'));
    const beyond = robot(parameter(0.001, 'learning'), parameter(0.002, 'converged'));
    expect(leftOf(beyond, items, limits)).toBeNull();
    expect(leftOf(both, items, null)).toBeNull();
    const known = robot(parameter(0.001, 'converged'), parameter(0.002, 'converged'));
    expect(leftOf(known, items, limits)).toBeNull();
  });
});

import { describe, expect, it } from 'vitest';
import {
  fixed,
  formatAge,
  formatEstimate,
  formatMoment,
  formatSaid,
  formatSigma,
  formatValue,
  signed,
} from './format';

describe('numbers', () => {
  it('has a true minus sign and no negative zero', () => {
    expect(fixed(-1.25, 1)).toBe('\u22121.3');
    expect(fixed(-0.0004, 3)).toBe('0.000');
    expect(signed(-0.0004, 3)).toBe('0.000');
    expect(signed(0.0004, 3)).toBe('0.000');
    expect(signed(2, 1)).toBe('+2.0');
  });

  it('says so when a number is none', () => {
    expect(fixed(Number.NaN, 2)).toBe('not known');
  });

  it('shows degrees and millimetres', () => {
    expect(formatValue('steering_offset', Math.PI / 180)).toBe('+1.000');
    expect(formatValue('lidar_x', 0.4341)).toBe('+434.1');
    expect(formatValue('wheelbase', 1.2)).toBe('1200.0');
    expect(formatValue('speed_scale', 1.0081)).toBe('1.0081');
    expect(formatEstimate('lidar_yaw', -Math.PI / 360, 0.0001)).toBe('\u22120.500 ± 0.006°');
    expect(formatEstimate('lidar_y', 0.0123, 0.0004)).toBe('+12.3 ± 0.4\u00a0mm');
  });

  it('drops decimals that a large sigma makes meaningless', () => {
    expect(formatSigma('lidar_x', 0.0006)).toBe('0.6');
    expect(formatSigma('lidar_x', 2)).toBe('2000');
    expect(formatSigma('lidar_x', 50)).toBe('> 9999');
    expect(formatSigma('lidar_yaw', 0.4)).toBe('22.9');
  });
});

describe('moments', () => {
  it('of the past are never ahead, and what is due never in 0 s', () => {
    expect(formatMoment(1_400, 1_000, false)).toBe('now');
    expect(formatMoment(5_000, 1_000, false)).toBe('now');
    expect(formatMoment(1_000, 91_000, false)).toBe('1 min ago');
    expect(formatMoment(1_400, 1_000, true)).toBe('in 1 s');
    expect(formatMoment(61_000, 1_000, true)).toBe('in 60 s');
    expect(formatMoment(1_000, 11_000, true)).toBe('10 s ago');
  });
});

describe('times as people say them', () => {
  it('say no more than is needed to know which one it is', () => {
    const now = new Date(2026, 0, 2, 12, 0).getTime();
    const said = (...at: [number, number, number, number, number]) =>
      formatSaid(new Date(...at).getTime(), now);
    expect(said(2026, 0, 2, 9, 5)).toBe('09:05');
    expect(said(2026, 0, 1, 22, 14)).toBe('yesterday 22:14');
    expect(said(2025, 11, 31, 22, 14)).toBe('31 Dec 2025 22:14');
    expect(said(2026, 0, 3, 9, 5)).toBe('3 Jan 09:05');
  });
});

describe('ages', () => {
  it('grow into larger units', () => {
    expect(formatAge(-500)).toBe('now');
    expect(formatAge(2_999)).toBe('now');
    expect(formatAge(3_000)).toBe('3 s ago');
    expect(formatAge(90_000)).toBe('1 min ago');
    expect(formatAge(5_400_000)).toBe('1 h ago');
    expect(formatAge(3 * 86_400_000)).toBe('3 d ago');
  });
});

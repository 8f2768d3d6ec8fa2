import { describe, expect, it } from 'vitest';
import { pinched, shifted, SPAN_MAX_S, SPAN_MIN_S, zoomed } from './zoom';

const END_S = 1_000;

describe('a zoom', () => {
  it('keeps the time under the pointer where it is', () => {
    expect(zoomed([100, 200], 125, 0.5, END_S)).toEqual([112.5, 162.5]);
    expect(zoomed([100, 200], 125, 2, END_S)).toEqual([75, 275]);
  });

  it('has limits, and no future', () => {
    const [from_s, to_s] = zoomed([100, 120], 110, 1e-6, END_S);
    expect(to_s - from_s).toBeCloseTo(SPAN_MIN_S);
    const far = zoomed([100, 900], 500, 1e12, END_S);
    expect([far[1] - far[0], far[1]]).toEqual([SPAN_MAX_S, END_S]);
    expect(zoomed([800, 1_000], 800, 2, END_S)).toEqual([600, 1_000]);
  });
});

describe('fingers', () => {
  it('keep the times that they are on', () => {
    // Twice as far apart: half the time, and the middle stays.
    expect(pinched([0, 100], [0.25, 0.75], [0, 1], END_S)).toEqual([25, 75]);
    // Both moved to the right: an earlier time is under them.
    expect(pinched([100, 200], [0.25, 0.75], [0.35, 0.85], END_S)).toEqual([90, 190]);
  });

  it('on one place do not divide by zero', () => {
    const [from_s, to_s] = pinched([0, 100], [0.5, 0.5], [0.5, 0.5], END_S);
    expect(Number.isFinite(from_s) && to_s > from_s).toBe(true);
  });
});

describe('a shift', () => {
  it('ends with the data', () => {
    expect(shifted([100, 200], -50, END_S)).toEqual([50, 150]);
    expect(shifted([850, 950], 500, END_S)).toEqual([900, 1_000]);
  });
});

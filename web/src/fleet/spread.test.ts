import { describe, expect, it } from 'vitest';
import { dotsOf, summaryOf } from './spread';

describe('the spread of a fleet', () => {
  it('has a dot for each robot that is known, to the side of its sign', () => {
    const dots = dotsOf([-3, null, 0, 0.4]);
    expect(dots).toHaveLength(3);
    expect(dots.map(({ at }) => Math.sign(at))).toEqual([-1, 0, 1]);
    expect(dots.map(({ beyond }) => beyond)).toEqual([true, false, false]);
  });

  it('stacks dots of one place, and not for ever', () => {
    expect(dotsOf([0.1, 0.1, 0.1]).map(({ row }) => row)).toEqual([0, 1, 2]);
    expect(Math.max(...dotsOf(Array<number>(500).fill(2)).map(({ row }) => row))).toBe(4);
  });

  it('is summed up', () => {
    expect(summaryOf([-3, null, 0.5, 0.1])).toEqual({ known: 3, beyond: 1, median: 0.1 });
    expect(summaryOf([1, 2])).toMatchObject({ median: 1.5, beyond: 1 });
    expect(summaryOf([null])).toEqual({ known: 0, beyond: 0, median: null });
  });
});

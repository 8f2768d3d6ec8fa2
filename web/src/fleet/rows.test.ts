import { describe, expect, it } from 'vitest';
import { ROW_HEIGHT_PX, rowsInView } from './rows';

describe('rows in view', () => {
  it('are all of a short list', () => {
    expect(rowsInView(6, -200, 900)).toEqual({ first: 0, end: 6 });
    expect(rowsInView(0, -200, 900)).toEqual({ first: 0, end: 0 });
  });

  it('are what is seen of a long one, and some more to each side', () => {
    const { first, end } = rowsInView(500, 100 * ROW_HEIGHT_PX, 10 * ROW_HEIGHT_PX);
    expect(first).toBeLessThanOrEqual(92);
    expect(first).toBeGreaterThan(84);
    expect(end).toBeGreaterThanOrEqual(118);
    expect(end).toBeLessThan(126);
  });

  it('are the last ones when a filter has made the list short under the reader', () => {
    const { first, end } = rowsInView(30, 480 * ROW_HEIGHT_PX, 900);
    expect(end).toBe(30);
    expect(first).toBeLessThan(30);
  });

  it('do not change with every line', () => {
    const at = (line: number) => rowsInView(500, line * ROW_HEIGHT_PX, 900);
    expect(at(101)).toEqual(at(100));
  });
});

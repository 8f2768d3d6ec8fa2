import { describe, expect, it } from 'vitest';
import { AXIS_FONT, timeLabels, valueLabels } from './axes';

describe('the font of the axes', () => {
  it('keeps its size at every pixel ratio', () => {
    // As the chart library scales it: the digits before `px`, whatever stands before them.
    for (const ratio of [1, 1.5, 2, 3]) {
      const scaled = AXIS_FONT.replace(/(\d+)px/, (_, size) => `${Math.round(size * ratio)}px`);
      const [, size] = /^(\d+)px "/.exec(scaled) ?? [];
      expect(Number(size) / ratio, `${scaled} at ratio ${ratio}`).toBe(12);
    }
  });
});

describe('the labels of the axes', () => {
  it('are as fine as their steps', () => {
    const at_s = new Date(2026, 10, 27, 22, 14, 5).getTime() / 1000;
    expect(timeLabels([at_s], 5)).toEqual(['22:14:05']);
    expect(timeLabels([at_s], 60)).toEqual(['22:14']);
    expect(timeLabels([at_s], 86_400)).toEqual(['27 Nov']);
    expect(valueLabels([-0.5, 0, 0.25], 0.25)).toEqual(['\u22120.50', '0.00', '0.25']);
  });
});

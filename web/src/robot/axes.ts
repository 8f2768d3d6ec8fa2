/** Font, padding and labels of a chart's axes. */

import { fixed } from '../units/format';

/** Font in whole pixels: the chart library multiplies the digits before `px` by the pixel ratio. */
export const AXIS_FONT = '12px "Inter Variable", system-ui, sans-serif';

/**
 * Padding of the plot, px: top, right, bottom, left. Half of a time with seconds fits to the right.
 */
export const PADDING = [8, 30, 0, 0] as const;

const DAY_S = 86_400;

const two = (value: number) => String(value).padStart(2, '0');

/** Returns the labels of a time axis, with the precision of its steps. */
export function timeLabels(splits: number[], step_s: number): string[] {
  return splits.map((split) => {
    const date = new Date(split * 1000);
    const day = `${date.getDate()} ${date.toLocaleString('en-GB', { month: 'short' })}`;
    if (step_s >= 300 * DAY_S) return String(date.getFullYear());
    if (step_s >= DAY_S) return day;
    const minute = `${two(date.getHours())}:${two(date.getMinutes())}`;
    if (step_s >= 60) return minute === '00:00' ? day : minute;
    return `${minute}:${two(date.getSeconds())}`;
  });
}

/** True for 1, 2 and 5 times a power of ten: the round values of a logarithmic axis. */
function isRound(value: number): boolean {
  const first = value / 10 ** Math.floor(Math.log10(value) + 1e-9);
  return [1, 2, 5].some((round) => Math.abs(first - round) < 1e-6);
}

/** Returns the labels of a logarithmic axis; those that would touch others are null. */
export function logLabels(splits: readonly (number | null)[]): string[] {
  return splits.map((split) =>
    split === null || !isRound(split) ? '' : String(Number(split.toPrecision(3))),
  );
}

/** Returns the lines of a logarithmic grid: the powers of ten, and over few of them 2 and 5 too. */
export function logLines(splits: readonly number[]): (number | null)[] {
  const decades = Math.log10((splits.at(-1) ?? 1) / (splits[0] ?? 1));
  const isLine = (value: number) =>
    isRound(value) && (decades < 2 || Math.abs(Math.log10(value) % 1) < 1e-6);
  return splits.map((split) => (isLine(split) ? split : null));
}

/** Returns the labels of a value axis, with as many decimals as its steps need. */
export function valueLabels(splits: number[], step: number): string[] {
  let decimals = 0;
  while (decimals < 6 && Math.abs(step - Number(step.toFixed(decimals))) > step * 1e-6) decimals++;
  return splits.map((split) => fixed(split, decimals));
}

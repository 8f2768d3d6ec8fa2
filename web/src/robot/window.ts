/** Stretch of a robot's history that its charts show, stored in the address. */

export interface Range {
  key: string;
  label: string;
  length_s: number;
}

const MINUTE = 60;
const HOUR = 3600;
const DAY = 86_400;

export const RANGES: readonly Range[] = [
  { key: '5m', label: '5 min', length_s: 5 * MINUTE },
  { key: '1h', label: '1 h', length_s: HOUR },
  { key: '1d', label: '1 day', length_s: DAY },
  { key: '1w', label: '1 week', length_s: 7 * DAY },
  { key: '90d', label: '90 days', length_s: 90 * DAY },
  { key: '5y', label: '5 years', length_s: 5 * 365 * DAY },
];

const DEFAULT = RANGES[1] as Range;

/** Largest length of a range that follows the time; a longer one is read again periodically. */
export const LIVE_MAX_S = HOUR;

/** A window that ends now (`to_s` null), or one that the reader selected. */
export type Window =
  { kind: 'range'; range: Range } | { kind: 'cut'; from_s: number; to_s: number };

/** Returns the window in an address; an unreadable one is the last hour. */
export function windowOf(query: URLSearchParams): Window {
  const from_s = Date.parse(query.get('from') ?? '') / 1000;
  const to_s = Date.parse(query.get('to') ?? '') / 1000;
  if (Number.isFinite(from_s) && Number.isFinite(to_s) && from_s < to_s) {
    return { kind: 'cut', from_s, to_s };
  }
  const key = query.get('range');
  return { kind: 'range', range: RANGES.find((range) => range.key === key) ?? DEFAULT };
}

/** True if two windows cover the same time. */
export function sameWindow(a: Window, b: Window): boolean {
  if (a.kind === 'range') return b.kind === 'range' && a.range.key === b.range.key;
  return b.kind === 'cut' && a.from_s === b.from_s && a.to_s === b.to_s;
}

/**
 * Returns the time that the charts show, in seconds since 1970. A range ends at `end_s` and begins
 * with the first data, so that a robot that has just begun fills its charts.
 */
export function extent(
  window: Window,
  end_s: number,
  first_s: number | undefined,
): [from_s: number, to_s: number] {
  if (window.kind === 'cut') return [window.from_s, window.to_s];
  const from_s = end_s - window.range.length_s;
  if (first_s === undefined) return [from_s, end_s];
  const margin_s = Math.max(2, (end_s - first_s) * 0.01);
  const begun_s = Math.min(first_s - margin_s, end_s - MINUTE);
  return [Math.max(from_s, begun_s), end_s];
}

/** Stretches of time under the fingers, the wheel and the keys of a chart. */

export type Span = readonly [from_s: number, to_s: number];

/** Shortest stretch of time that a chart shows, s. */
export const SPAN_MIN_S = 10;
/** Longest stretch of time that a chart shows: as long as history is kept, s. */
export const SPAN_MAX_S = 5 * 365 * 86_400;

/** Factor by which one key press or double click changes the stretch. */
export const STEP = 2;

/**
 * Returns a stretch that is `factor` times as long and has `at_s` at the same place. It ends at
 * `end_s` at the latest.
 */
export function zoomed([from_s, to_s]: Span, at_s: number, factor: number, end_s: number): Span {
  const length_s = Math.min(Math.max((to_s - from_s) * factor, SPAN_MIN_S), SPAN_MAX_S);
  const share = (at_s - from_s) / (to_s - from_s);
  return ended(at_s - share * length_s, length_s, end_s);
}

/** Returns a stretch of the same length, `by_s` later. */
export function shifted([from_s, to_s]: Span, by_s: number, end_s: number): Span {
  return ended(from_s + by_s, to_s - from_s, end_s);
}

/**
 * Returns the stretch in which the times that were under two fingers are under them again. Places
 * are shares of the width, from 0 to 1.
 */
export function pinched(
  [from_s, to_s]: Span,
  before: readonly [number, number],
  now: readonly [number, number],
  end_s: number,
): Span {
  const length_s = to_s - from_s;
  const apart = Math.max(Math.abs(now[1] - now[0]), 0.02);
  const factor = Math.abs(before[1] - before[0]) / apart;
  const at_s = from_s + (length_s * (before[0] + before[1])) / 2;
  const long_s = Math.min(Math.max(length_s * factor, SPAN_MIN_S), SPAN_MAX_S);
  return ended(at_s - (long_s * (now[0] + now[1])) / 2, long_s, end_s);
}

/** Returns a stretch that begins at a time, or earlier where it would end after `end_s`. */
function ended(from_s: number, length_s: number, end_s: number): Span {
  const to_s = Math.min(from_s + length_s, end_s);
  return [to_s - length_s, to_s];
}

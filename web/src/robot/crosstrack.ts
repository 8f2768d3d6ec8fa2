/** A robot's cross-track errors before and after a calibration. */

import type { CrossTrackErrors, CrossTrackItem } from '../api/types';

/** One bar: its ends, mm, and its share of all errors. */
export interface Bar {
  from_mm: number;
  to_mm: number;
  before: number;
  after: number;
}

export interface BeforeAfter {
  /** Former calibration; null while the robot has used only one. */
  before: CrossTrackItem | null;
  after: CrossTrackItem;
  bars: Bar[];
}

/** Number of empty bars kept at the sides, so that a histogram does not touch its frame. */
const MARGIN_BARS = 2;

/** Returns the present calibration and the one before it; null while nothing was reported. */
export function beforeAfter({ items, bin_width_m, from_m }: CrossTrackErrors): BeforeAfter | null {
  const used = items.filter(({ count }) => count > 0);
  const after = used.at(-1);
  if (!after) return null;
  const before = used.at(-2) ?? null;
  const filled = after.bins.flatMap((count, i) =>
    count > 0 || (before?.bins[i] ?? 0) > 0 ? [i] : [],
  );
  const first = Math.max(0, (filled[0] ?? 0) - MARGIN_BARS);
  const last = Math.min(after.bins.length - 1, (filled.at(-1) ?? 0) + MARGIN_BARS);
  const bars: Bar[] = [];
  for (let i = first; i <= last; i++) {
    bars.push({
      from_mm: (from_m + i * bin_width_m) * 1000,
      to_mm: (from_m + (i + 1) * bin_width_m) * 1000,
      before: before ? (before.bins[i] ?? 0) / before.count : 0,
      after: (after.bins[i] ?? 0) / after.count,
    });
  }
  return { before, after, bars };
}

/** Returns a CSV file of all calibrations. */
export function crossTrackCsv({ items, bin_width_m, from_m }: CrossTrackErrors): string {
  const head = [
    'from_m',
    'to_m',
    ...items.map(({ generation }) => `count_generation_${generation}`),
  ];
  const rows = (items[0]?.bins ?? []).map((_, i) => [
    (from_m + i * bin_width_m).toFixed(3),
    (from_m + (i + 1) * bin_width_m).toFixed(3),
    ...items.map(({ bins }) => bins[i] ?? 0),
  ]);
  return [head, ...rows].map((row) => row.join(',')).join('\r\n') + '\r\n';
}

/** Effect of the present calibration on the robot's path following. */
export interface Gain {
  /** RMS with the former calibration, mm; null while the robot has used only one. */
  before_mm: number | null;
  /** RMS with the present one, mm. */
  now_mm: number;
  /** Reduction, as a share; below zero for an increase. */
  less: number | null;
}

/** Returns the gain from the errors of both; null while nothing was reported. */
export function gainOf(found: BeforeAfter | null): Gain | null {
  if (!found) return null;
  const now_mm = found.after.rms_m * 1000;
  const before_mm = found.before ? found.before.rms_m * 1000 : null;
  return { before_mm, now_mm, less: before_mm ? 1 - now_mm / before_mm : null };
}

/** Innovations of the filter and their normalised squares, in the form for charts. */

import type { Consistency, HistoryDocument, Innovation } from '../api/types';
import { fixed } from '../units/format';
import { BAND_SIGMAS, beginOfData, type Columns, GAP_MIN_S, GAP_STEPS } from './series';

/** Values over time; the arrays are equally long. */
export interface Points {
  t_s: number[];
  value: number[];
  /** Lower and upper end of the range of right values; equally long. */
  low: number[];
  high: number[];
}

export const NO_POINTS: Points = { t_s: [], value: [], low: [], high: [] };

/** Axes of an innovation, in the order of its numbers. */
export const AXES = [
  { label: 'Innovation forwards', unit: 'mm', factor: 1000, decimals: 1, wireUnit: 'm' },
  { label: 'Innovation to the left', unit: 'mm', factor: 1000, decimals: 1, wireUnit: 'm' },
  { label: 'Innovation in yaw', unit: '°', factor: 180 / Math.PI, decimals: 3, wireUnit: 'rad' },
] as const;

export type InnovationAxis = (typeof AXES)[number];

/** Adds a value. */
function add(points: Points, t_s: number, value: number, low: number, high: number): void {
  points.t_s.push(t_s);
  points.value.push(value);
  points.low.push(low);
  points.high.push(high);
}

/** Returns the NIS of a history. */
export function nisOf(answer: Pick<HistoryDocument, 'bucket_s' | 'time' | 'count' | 'nis'>): {
  t_s: number[];
  nis: number[];
} {
  const found: { t_s: number[]; nis: number[] } = { t_s: [], nis: [] };
  beginOfData(answer).forEach((t_s, i) => {
    const nis = answer.nis[i] ?? null;
    if (nis === null) return;
    found.t_s.push(t_s);
    found.nis.push(nis);
  });
  return found;
}

/**
 * Returns NIS with the range that right models give. An estimate's range is that of one mean over its
 * window; means of several windows spread less, so they are given without a range.
 */
export function nisPoints(
  { t_s, nis }: { t_s: readonly number[]; nis: readonly number[] },
  range: readonly number[] | null | undefined,
): Points {
  const [low = Number.NaN, high = Number.NaN] = range ?? [];
  const points: Points = { t_s: [], value: [], low: [], high: [] };
  t_s.forEach((at_s, i) => add(points, at_s, nis[i] ?? Number.NaN, low, high));
  return points;
}

/** Returns innovations with a new one, as the service keeps them: a clock that went back begins again. */
export function continued(
  kept: readonly Innovation[],
  next: Innovation,
  most: number,
): readonly Innovation[] {
  const last_ns = kept.at(-1)?.stamp_ns ?? Number.NEGATIVE_INFINITY;
  if (last_ns === next.stamp_ns) return kept;
  return last_ns > next.stamp_ns ? [next] : [...kept, next].slice(-most);
}

/** Returns one axis of innovations within a stretch of time, in its shown unit. */
export function innovationPoints(
  innovations: readonly Innovation[],
  axis: number,
  [from_s, to_s]: readonly [number, number],
): Points {
  const points: Points = { t_s: [], value: [], low: [], high: [] };
  const factor = AXES[axis]?.factor ?? 1;
  for (const { stamp_ns, residual, sigma } of innovations) {
    const t_s = stamp_ns / 1e9;
    if (t_s < from_s || t_s > to_s) continue;
    const band = (sigma[axis] ?? Number.NaN) * factor * BAND_SIGMAS;
    add(points, t_s, (residual[axis] ?? Number.NaN) * factor, -band, band);
  }
  return points;
}

/** Returns the columns of a chart: the band is the range of right values. */
export function pointColumns(points: Points, bucket_s: number): Columns {
  const gap_s = Math.max(GAP_MIN_S, GAP_STEPS * bucket_s);
  const out: Columns = [[], [], [], [], [], []];
  const finite = (value: number | undefined) =>
    value !== undefined && Number.isFinite(value) ? value : null;
  const push = (t_s: number, values: (number | null)[]) => {
    out[0].push(t_s);
    values.forEach((value, i) => (out[i + 1] as (number | null)[]).push(value));
  };
  let before_s = Number.POSITIVE_INFINITY;
  points.t_s.forEach((t_s, i) => {
    if (t_s - before_s > gap_s) push(before_s + gap_s / 2, [null, null, null, null, null]);
    before_s = t_s;
    const band = [finite(points.high[i]), finite(points.low[i])];
    push(t_s, [...band, null, null, finite(points.value[i])]);
  });
  return out;
}

/** Returns the values of an axis that has all points and their range of right values. */
export function pointRange(points: Points, isLog: boolean): [number, number] {
  const all = [...points.value, ...points.low, ...points.high].filter(
    (value) => Number.isFinite(value) && (!isLog || value > 0),
  );
  if (all.length === 0) return isLog ? [0.1, 10] : [-1, 1];
  const least = all.reduce((a, b) => Math.min(a, b));
  const most = all.reduce((a, b) => Math.max(a, b));
  if (isLog) return [least / 1.5, most * 1.5];
  const margin = Math.max((most - least) * 0.08, 1e-9);
  return [least - margin, most + margin];
}

/** Returns how large the errors are, as a multiple of the expected size. */
export function errorsOverExpected({ nis_mean, nis_dof }: Consistency): number {
  return nis_dof > 0 ? Math.sqrt(nis_mean / nis_dof) : 0;
}

/** Returns in one sentence whether the model explains the data. */
export function fitSentence(consistency: Consistency): string {
  const times = `${fixed(errorsOverExpected(consistency), 1)} times as large as expected`;
  switch (consistency.fit) {
    case 'explained':
      return `The model explains the data: its errors are ${times}.`;
    case 'rough':
      return `The errors are ${times}: the robot moves or measures more roughly than configured, and the standard deviations are wider for it.`;
    case 'unexplained':
      return `The model does not explain the data: its errors are ${times}. Look at wheelbase, vehicle model, signs and stamps.`;
    default:
      return 'Too few updates yet to say whether the model explains the data.';
  }
}

/** Returns a CSV file of points, in SI units. */
export function pointsCsv(
  points: Points,
  { name, unit, factor }: { name: string; unit: string; factor: number },
): string {
  const column = (what: string) => `${name}${what}${unit === '' ? '' : `_${unit}`}`;
  const head = ['time_utc', column(''), column('_low'), column('_high')];
  const rows = points.t_s.map((t_s, i) => {
    const numbers = [points.value[i], points.low[i], points.high[i]];
    const si = numbers.map((value) => (Number.isFinite(value) ? (value ?? 0) / factor : ''));
    return [new Date(t_s * 1000).toISOString(), ...si].join(',');
  });
  return [head.join(','), ...rows, ''].join('\r\n');
}

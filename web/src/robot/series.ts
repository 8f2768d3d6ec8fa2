/** A stretch of history as the charts, the tables and the CSV files take it. */

import type { HistoryDocument, HistorySeries, ParameterName, ParameterStatus } from '../api/types';
import { SHOWN } from '../units/parameters';
import { appliedAt, type Step } from './applied';

/** One parameter over time, SI units and radians; the arrays are equally long. */
export interface Series {
  t_s: number[];
  mean: number[];
  min: number[];
  max: number[];
  sigma: number[];
  status: ParameterStatus[];
}

export const EMPTY: Series = { t_s: [], mean: [], min: [], max: [], sigma: [], status: [] };

/** One parameter of what the service answered; where it was fixed or off there are no points. */
export function seriesOf(times_s: readonly number[], given: HistorySeries): Series {
  const series: Series = { t_s: [], mean: [], min: [], max: [], sigma: [], status: [] };
  times_s.forEach((t_s, i) => {
    const mean = given.mean[i] ?? null;
    if (mean === null) return;
    series.t_s.push(t_s);
    series.mean.push(mean);
    series.min.push(given.min[i] ?? mean);
    series.max.push(given.max[i] ?? mean);
    series.sigma.push(given.sigma[i] ?? Number.NaN);
    series.status.push(given.status[i] ?? 'off');
  });
  return series;
}

/** Adds what has just come, and lets go what is older than `oldest_s`. */
export function append(
  series: Series,
  t_s: number,
  point: { value: number; sigma: number; status: ParameterStatus },
  oldest_s: number,
): void {
  series.t_s.push(t_s);
  series.mean.push(point.value);
  series.min.push(point.value);
  series.max.push(point.value);
  series.sigma.push(point.sigma);
  series.status.push(point.status);
  const keep = series.t_s.findIndex((t) => t >= oldest_s);
  if (keep > 0) for (const column of Object.values(series)) column.splice(0, keep);
}

/** How many sigmas the band reaches to each side. */
export const BAND_SIGMAS = 2;
/** A stretch without data is a gap when it is longer than this many steps, and than this time. */
const GAP_STEPS = 3;
const GAP_MIN_S = 4;

type Column = (number | null)[];

/** Columns for a chart, in shown units: time, band's top and bottom, highest, lowest, value. */
export type Columns = [number[], Column, Column, Column, Column, Column];

/** A first stretch that reaches so many times farther than the second holds more than a value. */
const MIXED_FACTOR = 5;

/**
 * What a chart draws; where data are missing stands a row of nulls, which it shows as a gap. An
 * unobservable value is only what was assumed before, so it is not drawn; the same goes for a
 * stretch in which it has become observable, whose mean is of both. Highest and lowest value
 * are those of converged stretches once there are any, and of none that is alone: while it is learnt
 * a value may be anywhere, and must not set the axis.
 */
export function columns(series: Series, name: ParameterName, bucket_s: number): Columns {
  const { factor } = SHOWN[name];
  const gap_s = Math.max(GAP_MIN_S, GAP_STEPS * bucket_s);
  const out: Columns = [[], [], [], [], [], []];
  const converges = series.status.includes('converged');
  let before_s = Number.POSITIVE_INFINITY;
  series.t_s.forEach((t_s, i) => {
    if (t_s - before_s > gap_s) push(out, [before_s + gap_s / 2, null, null, null, null, null]);
    before_s = t_s;
    const mean = (series.mean[i] ?? Number.NaN) * factor;
    const band = (series.sigma[i] ?? Number.NaN) * factor * BAND_SIGMAS;
    const status = series.status[i];
    if (status === 'unobservable' || isMixed(series, i, bucket_s, gap_s)) {
      push(out, [t_s, null, null, null, null, null]);
      return;
    }
    if ((converges && status !== 'converged') || isAlone(series, i, bucket_s, gap_s)) {
      push(out, [t_s, mean + band, mean - band, null, null, mean]);
      return;
    }
    const high = (series.max[i] ?? Number.NaN) * factor;
    const low = (series.min[i] ?? Number.NaN) * factor;
    push(out, [t_s, mean + band, mean - band, high, low, mean]);
  });
  return out;
}

/**
 * Whether the stretch holds the time before its value was observable too: it is the first after a
 * gap or after unobservable ones, and reaches much farther than the one that follows.
 */
function isMixed(series: Series, i: number, bucket_s: number, gap_s: number): boolean {
  const { t_s, min, max, mean, sigma, status } = series;
  const at = (column: readonly number[], k: number) => column[k] ?? Number.NaN;
  const goesOn = i > 0 && at(t_s, i) - at(t_s, i - 1) <= gap_s;
  if (bucket_s <= 1 || (goesOn && status[i - 1] !== 'unobservable')) return false;
  if (!(at(t_s, i + 1) - at(t_s, i) <= gap_s) || status[i + 1] === 'unobservable') return false;
  const band = BAND_SIGMAS * at(sigma, i + 1);
  const near = MIXED_FACTOR * Math.max(band, at(max, i + 1) - at(min, i + 1));
  const middle = at(mean, i + 1);
  return Math.max(Math.abs(at(max, i) - middle), Math.abs(at(min, i) - middle)) > near;
}

/** Whether bucket `i` has no neighbour within `gap_s` to compare its values with. */
function isAlone({ t_s }: Series, i: number, bucket_s: number, gap_s: number): boolean {
  const at = (k: number) => t_s[k] ?? Number.NaN;
  return bucket_s > 1 && !(at(i) - at(i - 1) <= gap_s) && !(at(i + 1) - at(i) <= gap_s);
}

/** Stretches in which the value was not observable, from the first to the last point of each. */
export function unknownStretches({ t_s, status }: Series): [from_s: number, to_s: number][] {
  const found: [number, number][] = [];
  t_s.forEach((at_s, i) => {
    if (status[i] !== 'unobservable') return;
    const last = status[i - 1] === 'unobservable' ? found.at(-1) : undefined;
    if (last) last[1] = at_s;
    else found.push([at_s, at_s]);
  });
  return found;
}

/** Points of the value's line without a neighbour, which no line would show. */
export function isolated([, , , , , mean]: Columns): number[] {
  const known = (i: number) => (mean[i] ?? null) !== null;
  return mean.flatMap((_, i) => (known(i) && !known(i - 1) && !known(i + 1) ? [i] : []));
}

/**
 * Where a lone point stands, s: `[from, middle, to]`. Its bucket says no more than that its values
 * are from somewhere in it, so it reaches over the bucket as far as `end_s`, where the chart ends.
 */
export function lonePlace(
  begin_s: number,
  bucket_s: number,
  end_s: number,
): [from_s: number, middle_s: number, to_s: number] {
  const to_s = bucket_s > 1 ? Math.max(begin_s, Math.min(begin_s + bucket_s, end_s)) : begin_s;
  return [begin_s, (begin_s + to_s) / 2, to_s];
}

function push(out: Columns, row: [number, ...(number | null)[]]): void {
  out.forEach((column, i) => (column as Column).push(row[i] ?? null));
}

/** Which values a chart's axis covers: all of them, or the last ones so that little moves show. */
export type Focus = 'all' | 'latest';

/** The share of the points that `latest` looks at. */
const LATEST_SHARE = 0.2;

/**
 * Lowest and highest value of the axis, in the shown unit. The band may run out of it; `levels` are
 * in it where all values are.
 */
export function axisRange(
  columns: Columns,
  smallestSpan: number,
  focus: Focus,
  levels: readonly number[] = [],
): [number, number] {
  const [, top, bottom, high, low, mean] = columns;
  const begin = focus === 'all' ? 0 : Math.floor(mean.length * (1 - LATEST_SHARE));
  let least = Number.POSITIVE_INFINITY;
  let most = Number.NEGATIVE_INFINITY;
  for (let i = begin; i < mean.length; i++) {
    least = Math.min(least, low[i] ?? least);
    most = Math.max(most, high[i] ?? most);
  }
  if (!(least <= most)) {
    for (const value of mean.slice(begin)) {
      least = Math.min(least, value ?? least);
      most = Math.max(most, value ?? most);
    }
  }
  if (mean.at(-1) !== null && mean.at(-2) != null) {
    least = Math.min(least, bottom.at(-1) ?? least);
    most = Math.max(most, top.at(-1) ?? most);
  }
  if (focus === 'all') {
    least = Math.min(least, ...levels);
    most = Math.max(most, ...levels);
  }
  if (!(least <= most)) return [-smallestSpan / 2, smallestSpan / 2];
  const span = Math.max((most - least) * 1.16, smallestSpan);
  const middle = (least + most) / 2;
  return [middle - span / 2, middle + span / 2];
}

/** A CSV file of a series: SI units and radians, all digits, UTC. */
export function csv(series: Series, name: ParameterName, applied: readonly Step[] = []): string {
  const { wireUnit } = SHOWN[name];
  const column = (what: string) => `${name}${what}_${wireUnit}`;
  const head = ['time_utc', column(''), column('_sigma'), column('_min'), column('_max')];
  head.push(column('_applied'), 'status');
  const rows = series.t_s.map((t_s, i) =>
    [
      new Date(t_s * 1000).toISOString(),
      series.mean[i],
      series.sigma[i],
      series.min[i],
      series.max[i],
      appliedAt(applied, t_s) ?? '',
      series.status[i],
    ].join(','),
  );
  return [head.join(','), ...rows, ''].join('\r\n');
}

/** Every parameter of an answer as a series. */
export function allSeries(
  answer: Pick<HistoryDocument, 'time' | 'series'>,
): Map<ParameterName, Series> {
  const times_s = answer.time.map((time) => Date.parse(time) / 1000);
  return new Map(answer.series.map((given) => [given.parameter, seriesOf(times_s, given)]));
}

/** The index of the point nearest to a time; null for an empty series. */
export function nearest(times_s: readonly number[], t_s: number): number | null {
  if (times_s.length === 0) return null;
  let low = 0;
  let high = times_s.length - 1;
  while (low < high) {
    const middle = (low + high) >> 1;
    if ((times_s[middle] ?? 0) < t_s) low = middle + 1;
    else high = middle;
  }
  const before = times_s[low - 1];
  return before !== undefined && t_s - before < (times_s[low] ?? 0) - t_s ? low - 1 : low;
}

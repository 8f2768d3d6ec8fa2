/** A stretch of history, in the form for charts, tables and CSV files. */

import type { HistoryDocument, HistorySeries, ParameterName, ParameterStatus } from '../api/types';
import { SHOWN } from '../units/parameters';
import { appliedAt, type Step } from './applied';

/**
 * One parameter over time, SI units and radians; the arrays are equally long. A time is where the
 * data of its stretch begin.
 */
export interface Series {
  t_s: number[];
  mean: number[];
  min: number[];
  max: number[];
  sigma: number[];
  status: ParameterStatus[];
}

export const EMPTY: Series = { t_s: [], mean: [], min: [], max: [], sigma: [], status: [] };

/**
 * Returns one parameter of the service's answer; times at which it was fixed or off have no points.
 */
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

/** Appends new points, and removes those older than `oldest_s`. */
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

/** Half width of the band, in sigmas. */
export const BAND_SIGMAS = 2;
/** Number of steps beyond which a stretch without data is a gap, if it also exceeds this time. */
export const GAP_STEPS = 3;
export const GAP_MIN_S = 4;

type Column = (number | null)[];

/** Columns for a chart, in shown units: time, band's top and bottom, highest, lowest, value. */
export type Columns = [number[], Column, Column, Column, Column, Column];

/** Ratio of the ranges of the first and second stretch beyond which the first is mixed. */
const MIXED_FACTOR = 5;

/**
 * Returns the columns of a chart; missing data are a row of nulls, displayed as a gap. An
 * unobservable value is only the earlier assumption, so it is not drawn; neither is a stretch in
 * which it has become observable, whose mean mixes both. Highest and lowest value are those of
 * converged stretches as soon as there are any, without isolated ones: a value that is still
 * converging may be anywhere, and must not determine the axis.
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
 * True if the stretch also contains the time before its value was observable: it is the first after
 * a gap or after unobservable ones, and its range is much larger than that of the next.
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

/** True if bucket `i` has no neighbour within `gap_s` for comparison. */
function isAlone({ t_s }: Series, i: number, bucket_s: number, gap_s: number): boolean {
  const at = (k: number) => t_s[k] ?? Number.NaN;
  return bucket_s > 1 && !(at(i) - at(i - 1) <= gap_s) && !(at(i + 1) - at(i) <= gap_s);
}

/** Returns the stretches in which the value was not observable, from first to last point. */
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

/** Returns the points of the value's line without a neighbour, which a line would not show. */
export function isolated([, , , , , mean]: Columns): number[] {
  const known = (i: number) => (mean[i] ?? null) !== null;
  return mean.flatMap((_, i) => (known(i) && !known(i - 1) && !known(i + 1) ? [i] : []));
}

/**
 * Returns the extent of an isolated point, s: `[from, middle, to]`. Its values are from anywhere in
 * its bucket, so it extends over the bucket as far as `end_s`, the end of the chart.
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

/** Values covered by a chart's axis: all of them, or the latest so that small changes show. */
export type Focus = 'all' | 'latest';

/** Share of the points that `latest` covers. */
const LATEST_SHARE = 0.2;

/**
 * Returns the lowest and highest value of the axis, in the shown unit. The band may exceed it;
 * `levels` are included if all values are.
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

/** Returns a CSV file of a series: SI units and radians, all digits, UTC. */
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

/** Returns every parameter of an answer as a series. */
export function allSeries(
  answer: Pick<HistoryDocument, 'bucket_s' | 'time' | 'count' | 'series'>,
): Map<ParameterName, Series> {
  const times_s = beginOfData(answer);
  return new Map(answer.series.map((given) => [given.parameter, seriesOf(times_s, given)]));
}

/**
 * Returns the time at which the data of each stretch begin, s. In the first stretch of a line they
 * go on into the next one, so that the seconds of data are those before its end.
 */
export function beginOfData({
  bucket_s,
  time,
  count,
}: Pick<HistoryDocument, 'bucket_s' | 'time' | 'count'>): number[] {
  const begins_s = time.map((one) => Date.parse(one) / 1000);
  return begins_s.map((begin_s, i) => {
    const isFirst = begins_s[i - 1] !== begin_s - bucket_s;
    const goesOn = begins_s[i + 1] === begin_s + bucket_s;
    return isFirst && goesOn ? begin_s + bucket_s - (count[i] ?? bucket_s) : begin_s;
  });
}

/** Returns the index of the point nearest to a time; null for an empty series. */
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

/** Another robot, or an earlier time of the same one, on the same charts; the address names it. */

import type { ParameterName } from '../api/types';
import { SHOWN } from '../units/parameters';
import type { OtherLine } from './plot';
import { columns, type Series } from './series';

export type With = { kind: 'robot'; id: string } | { kind: 'earlier'; key: string; by_s: number };

/** Earlier times, by the key in the address. */
export const EARLIER = [
  { key: '-1h', label: 'an hour before', by_s: 3600 },
  { key: '-1d', label: 'a day before', by_s: 86_400 },
  { key: '-1w', label: 'a week before', by_s: 7 * 86_400 },
] as const;

/** Returns what an address puts beside a robot's history. An id never begins with a minus. */
export function withOf(query: URLSearchParams, robot: string): With | null {
  const key = query.get('with') ?? '';
  const earlier = EARLIER.find((one) => one.key === key);
  if (earlier) return { kind: 'earlier', key, by_s: earlier.by_s };
  return key === '' || key.startsWith('-') || key === robot ? null : { kind: 'robot', id: key };
}

/** Returns its name. */
export function wordOf(other: With): string {
  if (other.kind === 'robot') return other.id;
  return EARLIER.find(({ key }) => key === other.key)?.label ?? other.key;
}

/** Returns the key of its address. */
export function keyOf(other: With | null): string {
  if (other === null) return '';
  return other.kind === 'robot' ? other.id : other.key;
}

/** Returns a series as a line beside another, `by_s` later. */
export function otherLine(
  series: Series,
  name: ParameterName,
  { bucket_s, by_s, word }: { bucket_s: number; by_s: number; word: string },
): OtherLine {
  const [times, , , , , mean] = columns(series, name, bucket_s);
  const points = times.map((t_s, i) => ({ t_s: t_s + by_s, value: mean[i] ?? null }));
  return { points, word };
}

/** Returns the value of a line at a time, in the wire unit; null without one nearby. */
export function otherAt(
  { points }: OtherLine,
  name: ParameterName,
  t_s: number,
  near_s: number,
): number | null {
  let best: { t_s: number; value: number | null } | undefined;
  for (const point of points) {
    if (point.value === null) continue;
    if (!best || Math.abs(point.t_s - t_s) < Math.abs(best.t_s - t_s)) best = point;
  }
  if (!best || best.value === null || Math.abs(best.t_s - t_s) > near_s) return null;
  return best.value / SHOWN[name].factor;
}

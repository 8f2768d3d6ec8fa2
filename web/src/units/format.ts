/** Formats of numbers and times for people. The wire has SI units and radians. */

import type { ParameterName } from '../api/types';
import { SHOWN } from './parameters';

const MINUS = '\u2212';

/**
 * Formats `value` with a fixed number of decimals, a true minus sign, and never a negative zero.
 */
export function fixed(value: number, decimals: number): string {
  if (!Number.isFinite(value)) return 'not known';
  const text = Math.abs(value).toFixed(decimals);
  return value < 0 && Number(text) !== 0 ? MINUS + text : text;
}

/** Formats as {@link fixed}, with a plus sign for positive values, so that signs line up. */
export function signed(value: number, decimals: number): string {
  const text = fixed(value, decimals);
  return value > 0 && Number(text) !== 0 ? `+${text}` : text;
}

/** Formats a parameter's value in its shown unit, without the unit. */
export function formatValue(name: ParameterName, value: number): string {
  const { factor, decimals, unit } = SHOWN[name];
  return unit === '' || name === 'wheelbase'
    ? fixed(value * factor, decimals)
    : signed(value * factor, decimals);
}

/** Formats a sigma in its shown unit; a large one loses its decimals, which are not significant. */
export function formatSigma(name: ParameterName, sigma: number): string {
  const { factor, decimals } = SHOWN[name];
  const shown = sigma * factor;
  if (shown >= 10_000) return '> 9999';
  if (shown >= 1000) return shown.toFixed(0);
  return fixed(shown, shown >= 10 ? Math.min(decimals, 1) : decimals);
}

/** Returns the unit after a number: with a space before all but the degree sign. */
export function unitAfter(name: ParameterName): string {
  const { unit } = SHOWN[name];
  return unit === '°' || unit === '' ? unit : `\u00a0${unit}`;
}

/** Formats a value that can stand alone in a sentence: `+1.234 ± 0.012°`. */
export function formatEstimate(name: ParameterName, value: number, sigma: number): string {
  return `${formatValue(name, value)} ± ${formatSigma(name, sigma)}${unitAfter(name)}`;
}

/** Formats a count: `12,345`. */
export function formatCount(count: number): string {
  return count.toLocaleString('en-GB').replaceAll(',', '\u202f');
}

/** Formats a distance: `84 m` or `1.24 km`. */
export function formatDistance(metres: number): string {
  return metres < 1000 ? `${metres.toFixed(0)} m` : `${(metres / 1000).toFixed(2)} km`;
}

/** Formats an age in its largest meaningful unit. Below `fresh_ms` it is simply `now`. */
export function formatAge(age_ms: number, fresh_ms = 3000): string {
  if (age_ms < fresh_ms) return 'now';
  const seconds = Math.floor(age_ms / 1000);
  if (seconds < 90) return `${seconds} s ago`;
  const minutes = Math.floor(seconds / 60);
  if (minutes < 90) return `${minutes} min ago`;
  const hours = Math.floor(minutes / 60);
  if (hours < 48) return `${hours} h ago`;
  return `${Math.floor(hours / 24)} d ago`;
}

/**
 * Formats a past time, or a future one that `isDue`. A past event is never ahead, however the
 * clocks of the service and of the reader differ; a due one may be over.
 */
export function formatMoment(time_ms: number, now_ms: number, isDue: boolean): string {
  const ahead_ms = time_ms - now_ms;
  if (isDue && ahead_ms > 0) return `in ${formatSpan(Math.max(ahead_ms, 1000))}`;
  return formatAge(-ahead_ms);
}

/** Formats a duration in its largest meaningful unit. */
export function formatSpan(span_ms: number): string {
  const seconds = Math.round(span_ms / 1000);
  if (seconds < 90) return `${seconds} s`;
  const minutes = Math.round(seconds / 60);
  if (minutes < 90) return `${minutes} min`;
  const hours = Math.round(minutes / 60);
  return hours < 48 ? `${hours} h` : `${Math.round(hours / 24)} d`;
}

const clock = new Intl.DateTimeFormat('en-GB', {
  hour: '2-digit',
  minute: '2-digit',
  second: '2-digit',
  timeZoneName: 'short',
});

const dated = new Intl.DateTimeFormat('en-GB', {
  year: 'numeric',
  month: 'short',
  day: '2-digit',
  hour: '2-digit',
  minute: '2-digit',
  second: '2-digit',
  timeZoneName: 'short',
});

/** Formats a time of today: `14:03:22 CET`. */
export function formatClock(time_ms: number): string {
  return clock.format(time_ms);
}

/** Formats any time: `21 Nov 2026, 14:03:22 CET`. */
export function formatTime(time_ms: number): string {
  return dated.format(time_ms);
}

const minute = new Intl.DateTimeFormat('en-GB', { hour: '2-digit', minute: '2-digit' });
const day = new Intl.DateTimeFormat('en-GB', { day: 'numeric', month: 'short' });
const dayOfYear = new Intl.DateTimeFormat('en-GB', {
  day: 'numeric',
  month: 'short',
  year: 'numeric',
});

/** Returns a time as people say it: `22:14` today, `yesterday 22:14`, `21 Nov 22:14`, `21 Nov 2025 22:14`. */
export function formatSaid(time_ms: number, now_ms: number): string {
  const at = new Date(time_ms);
  const today = new Date(now_ms);
  const clockTime = minute.format(at);
  if (at.toDateString() === today.toDateString()) return clockTime;
  const before = new Date(today.getFullYear(), today.getMonth(), today.getDate() - 1);
  if (at.toDateString() === before.toDateString()) return `yesterday ${clockTime}`;
  const sameYear = at.getFullYear() === today.getFullYear();
  return `${(sameYear ? day : dayOfYear).format(at)} ${clockTime}`;
}

/** Returns the name of the reader's time zone. */
export function zoneName(): string {
  return Intl.DateTimeFormat().resolvedOptions().timeZone;
}

/** A robot's past week, read when its row becomes visible. */

import { get } from '../api/client';
import type { DeploymentPage, HistoryDocument, Robot, Shadow } from '../api/types';
import { type AppliedStep, appliedSteps } from '../robot/applied';
import { now } from '../ui/time.svelte';
import { CALIBRATED } from '../units/parameters';
import { robotUrl } from './fleet.svelte';

const WEEK_S = 7 * 86_400;
/** Span shown instead of a week for a robot whose history is too short, s. */
const YOUNG_S = 3 * 3600;
const POINTS_MAX = 168;
const POINTS_MIN = 3;
/** Age at which a week is read again. */
const FRESH_MS = 10 * 60_000;
/** Age at which a shorter span is read again. */
const FRESH_YOUNG_MS = 30_000;
/**
 * Number of simultaneous readings: the rows of a fleet must not delay the page's other requests.
 */
const READS_MAX = 2;
/** Number of deployments read for a week; an older one is known from the base of the next. */
const DEPLOYMENTS_MAX = 20;
/** Distance from the view within which rows are read in advance. */
const MARGIN = '200px';

export class Week {
  history = $state.raw<HistoryDocument>();
  /** Applied calibrations over time; empty for a robot without deployments. */
  applied = $state.raw<readonly AppliedStep[]>([]);
  read_ms = 0;
  asked = false;

  get young(): boolean {
    const { from, to } = this.history ?? {};
    return (
      from !== undefined && to !== undefined && Date.parse(to) - Date.parse(from) < WEEK_S * 500
    );
  }
}

/**
 * Span of every line, s: a week as soon as one of the robots is older than the shorter span, so that
 * all lines cover the same time.
 */
class Span {
  s = $state(YOUNG_S);

  get words(): string {
    return this.s === WEEK_S ? '7 d' : '3 h';
  }
}

export const span = new Span();

const weeks = new Map<string, Week>();
const rows = new WeakMap<Element, { week: Week; robot: Robot }>();
const queue: { week: Week; robot: Robot }[] = [];
let reads = 0;

/** Returns the week of a robot, which may still have to be read. */
export function weekOf(id: string): Week {
  const week = weeks.get(id) ?? new Week();
  weeks.set(id, week);
  return week;
}

async function readApplied(week: Week, { id, calibration }: Robot): Promise<void> {
  if (calibration.desired_generation == null) return;
  const [shadow, deployments] = await Promise.all([
    get<Shadow>(`${robotUrl(id)}/shadow`),
    get<DeploymentPage>(`${robotUrl(id)}/deployments?limit=${DEPLOYMENTS_MAX}`),
  ]);
  week.applied = appliedSteps(shadow.body, [], deployments.body.items);
}

async function read(week: Week, robot: Robot): Promise<void> {
  await readApplied(week, robot);
  const end_s = robot.estimate ? robot.estimate.stamp_ns / 1e9 : now.current() / 1000;
  for (const span_s of [WEEK_S, YOUNG_S]) {
    const query = new URLSearchParams({
      parameter: CALIBRATED.join(','),
      from: new Date((end_s - span_s) * 1000).toISOString(),
      to: new Date(end_s * 1000).toISOString(),
      max_points: String(POINTS_MAX),
    });
    week.history = (await get<HistoryDocument>(`${robotUrl(robot.id)}/history?${query}`)).body;
    if (week.history.time.length < POINTS_MIN) continue;
    span.s = Math.max(span.s, span_s);
    return;
  }
}

function work(): void {
  while (reads < READS_MAX) {
    const next = queue.shift();
    if (!next) return;
    const { week, robot } = next;
    reads++;
    read(week, robot)
      // A row without its week is still a row; it is asked for again when it is seen again.
      .catch(() => undefined)
      .finally(() => {
        reads--;
        week.asked = false;
        week.read_ms = Date.now();
        work();
      });
  }
}

function want(row: { week: Week; robot: Robot }): void {
  const { week } = row;
  const fresh_ms = week.young ? FRESH_YOUNG_MS : FRESH_MS;
  if (week.asked || Date.now() - week.read_ms < fresh_ms) return;
  week.asked = true;
  queue.push(row);
  work();
}

let observer: IntersectionObserver | undefined;
/** Visible rows, whose weeks are read again. */
const seen = new Set<Element>();
let again: ReturnType<typeof setInterval> | undefined;

function see(element: Element, isSeen: boolean): void {
  const row = rows.get(element);
  if (isSeen) seen.add(element);
  else seen.delete(element);
  if (isSeen && row) want(row);
  if (seen.size === 0) {
    clearInterval(again);
    again = undefined;
  }
  again ??= seen.size === 0 ? undefined : setInterval(wantSeen, FRESH_YOUNG_MS);
}

function wantSeen(): void {
  for (const element of seen) {
    const row = rows.get(element);
    if (row) want(row);
  }
}

function observe(element: Element): void {
  observer ??= new IntersectionObserver(
    (entries) => {
      for (const { isIntersecting, target } of entries) see(target, isIntersecting);
    },
    { rootMargin: MARGIN },
  );
  observer.observe(element);
}

/** Reads the week of `robot` while its element is visible. */
export function whenSeen(
  element: Element,
  robot: Robot,
): { update(robot: Robot): void; destroy(): void } {
  const keep = (one: Robot) => rows.set(element, { week: weekOf(one.id), robot: one });
  keep(robot);
  observe(element);
  return {
    update: keep,
    destroy: () => {
      observer?.unobserve(element);
      see(element, false);
    },
  };
}
